"""Local least-squares fits of one effect, or of several together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.config import FitConfig
from holoview.diagnose.free_parameters import FittedValues, FreeParameters, free_parameters_of
from holoview.model.effects.effect import Effect
from holoview.numerics.least_squares import (
    Minimum,
    ResidualFunction,
    ResidualPart,
    ResidualVector,
    Vector,
    jacobian,
    levenberg_marquardt,
)
from holoview.numerics.nelder_mead import nelder_mead
from holoview.util.errors import UserError

FixedParameters = frozenset[tuple[str, str]]


@dataclass(frozen=True)
class CandidateFit:
    """Causes with their values, and the cost (Σ residual²) in the comparison that they were fitted in."""

    causes: tuple[str, ...]
    values: FittedValues
    cost: float

    @property
    def parameter_count(self) -> int:
        """How many numbers it states."""
        numbers = [x for values in self.values.values() for x in values.values()]
        return sum(len(x) if isinstance(x, tuple) else 1 for x in numbers)

    def without(self, name: str) -> CandidateFit:
        """The same values with one cause off; the others aren't fitted again, and the cost is unknown (infinite)."""
        values = {cause: own for cause, own in self.values.items() if cause != name}
        return CandidateFit(tuple(cause for cause in self.causes if cause != name), values, float("inf"))


def cost_or_inf(comparison: Comparison, values: Mapping[str, Mapping[str, float]]) -> float:
    """Σ residual²; infinite for values that no bench can have (a gap below zero, say)."""
    try:
        return float(comparison.fit_gains(values).squares.sum())
    except UserError:
        return float("inf")


def local_fit(
    effects: Sequence[Effect],
    start: FittedValues,
    comparison: Comparison,
    config: FitConfig,
    *,
    iterations: int | None = None,
    tolerance: float | None = None,
    include_fine: bool = False,
    step_factor: float = 1.0,
    fixed: FixedParameters = frozenset(),
) -> CandidateFit:
    """Levenberg–Marquardt on all parameters of the effects, then a downhill simplex if all of them are hard edges.

    iterations, tolerance: those of `config` when None. include_fine: vary the fine parameters too. step_factor: of the
    difference steps. fixed: (effect, parameter) pairs that keep their start.
    """
    free = free_parameters_of(effects, start, include_fine=include_fine)
    varied = FreeParameters(tuple((e, p) for e, p in free.entries if (e, p.name) not in fixed))
    values, cost = start, cost_or_inf(comparison, start)
    if len(varied):
        function = residual_function(varied, start, comparison)
        bounds = varied.bounds(config.steps).with_longer_steps(step_factor)
        minimum = levenberg_marquardt(
            function,
            varied.pack(start),
            bounds,
            iterations=config.iterations if iterations is None else iterations,
            tolerance=config.tolerance if tolerance is None else tolerance,
            parts=residual_parts(varied, start, comparison),
        )
        edges = hard_edge_mask(varied)
        if edges.all() and minimum.cost < config.edge_max_cost * cost:
            minimum = nelder_mead(function, minimum, bounds, edges, config.first_edge_size, config.edge_evaluations)
        values, cost = varied.unpack(minimum.x, start), minimum.cost
    return CandidateFit(tuple(e.id for e in effects), values, cost)


def refit(
    effects: Sequence[Effect],
    values: FittedValues,
    comparison: Comparison,
    config: FitConfig,
    *,
    step_factor: float = 1.0,
    fixed: FixedParameters = frozenset(),
) -> CandidateFit:
    """A short, precise local fit from values that were fitted before."""
    return local_fit(
        effects,
        values,
        comparison,
        config,
        iterations=config.refit_iterations,
        tolerance=config.final_tolerance,
        step_factor=step_factor,
        fixed=fixed,
    )


def residual_function(free: FreeParameters, base: FittedValues, comparison: Comparison) -> ResidualFunction:
    """The residuals as a function of the vector; infeasible parameters give those of `infeasible_residual`."""

    def function(x: Vector) -> ResidualVector:
        try:
            return comparison.residual(free.unpack(x, base))
        except UserError:
            return comparison.infeasible_residual

    return function


def residual_parts(free: FreeParameters, base: FittedValues, comparison: Comparison) -> list[ResidualPart]:
    """As `residual_function`, of some captures at a time where there are many pixels."""
    return [ResidualPart(where, residual_function(free, base, part)) for where, part in comparison.parts()]


def effect_jacobian(
    effect: Effect,
    values: FittedValues,
    comparison: Comparison,
    residual: NDArray[np.float32],
    config: FitConfig,
    *,
    step_factor: float = 1.0,
) -> NDArray[np.float32]:
    """Derivatives (parameter, pixel) of the residuals by the effect's parameters at `values`, in units of the priors.

    residual: the residuals at `values`. step_factor: of the difference steps.
    """
    free = free_parameters_of([effect], values)
    bounds = free.bounds(config.steps).with_longer_steps(step_factor)
    return jacobian(residual_function(free, values, comparison), free.pack(values), residual, bounds)


def residuals_and_start(
    free: FreeParameters, fit: CandidateFit, comparison: Comparison
) -> tuple[ResidualFunction, Minimum]:
    """The residuals as a function of the free parameters, and a fit as a point of that function."""
    start = Minimum(free.pack(fit.values), fit.cost, comparison.residual(fit.values), 0)
    return residual_function(free, fit.values, comparison), start


def hard_edge_mask(free: FreeParameters) -> NDArray[np.bool_]:
    """Which parameters move hard edges, where residuals jump and have no useful derivative."""
    return np.array([p.non_smooth for _, p in free.entries], dtype=bool)
