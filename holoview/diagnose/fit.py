"""Local least-squares fits of one effect or of several together, scans of an effect's range, and what improves a fit.

FreeParameters  the free parameters of a set of effects as one vector, in units of their priors
CandidateFit    causes with their values, and the cost
local_fit       a fit from starting values: Levenberg–Marquardt, and a downhill simplex for hard edges
scan_effect     the range of one effect, point by point, and fits from the best points: derivatives at the identity show
                the cause of a small error, but a large one decorrelates the speckle
refit_with_longer_steps, refine_hard_edges, search_along_axes, drop_negligible_values
                each takes a fit and returns one that costs no more; only `drop_negligible_values` may return one that
                costs slightly more, with fewer parameters

The solvers are `numerics.least_squares` and `numerics.nelder_mead`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.config import FitConfig, StepConfig
from holoview.diagnose.likelihood import Comparison
from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import ListParameter, Parameter
from holoview.numerics.minimise import (
    Minimum,
    ResidualFunction,
    ResidualPart,
    ResidualVector,
    SearchDomain,
    Vector,
    axis_scan,
    jacobian,
    levenberg_marquardt,
    minimise_along_axis,
    nelder_mead,
)
from holoview.util.errors import UserError

FittedValues = dict[str, dict[str, Any]]
"""{effect id: {parameter: value}}; the value of a list of numbers is a tuple."""


@dataclass(frozen=True)
class FreeParameters:
    """What a fit varies: (effect id, parameter) pairs, in which entries of a list are parameters of their own.

    A component of the vector is the value over its prior, or the value's square over the prior's where images depend on
    the square.
    """

    entries: tuple[tuple[str, Parameter], ...]

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def identity(self) -> Vector:
        """The vector at which no effect changes anything."""
        return np.array([p.to_fit(p.identity) / _scale(p) for _, p in self.entries])

    def pack(self, values: Mapping[str, Mapping[str, Any]]) -> Vector:
        """The vector of values; parameters that aren't given are at their identity."""
        return np.array([p.to_fit(p.read(values.get(e, {}))) / _scale(p) for e, p in self.entries])

    def unpack(self, x: Vector, base: Mapping[str, Mapping[str, Any]] | None = None) -> FittedValues:
        """Values by effect and parameter; `base` gives those that aren't varied."""
        result: FittedValues = {effect: dict(values) for effect, values in (base or {}).items()}
        for (effect, p), number in zip(self.entries, x, strict=True):
            result[effect] = p.written(result.get(effect, {}), float(p.from_fit(float(number) * _scale(p))))
        return result

    def bounds(self, steps: StepConfig) -> SearchDomain:
        """The bounds of the vector, and steps of its forward differences."""
        lower = [(0.0 if p.even_symmetric else p.to_fit(p.low)) / _scale(p) for _, p in self.entries]
        upper = [p.to_fit(p.high) / _scale(p) for _, p in self.entries]
        lengths = [
            steps.hard_edge if p.non_smooth else steps.even if p.even_symmetric else steps.regular
            for _, p in self.entries
        ]
        return SearchDomain(
            np.array(lower), np.array(upper), np.array(lengths), np.array([p.even_symmetric for _, p in self.entries])
        )

    def value_derivatives(self, x: Vector) -> Vector:
        """∂value/∂x at x, which turns the vector's uncertainty into the values'."""
        derivatives = []
        for (_, p), number in zip(self.entries, x, strict=True):
            if p.even_symmetric:
                derivatives.append(0.5 * p.prior / max(float(number), 1e-6) ** 0.5)
            else:
                derivatives.append(p.prior)
        return np.array(derivatives)


def free_parameters_of(
    effects: Sequence[Effect],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    include_fine: bool = False,
) -> FreeParameters:
    """The parameters of effects, and the entries of their lists at `values`; without `fine` ones unless asked for."""
    listed = [(e.id, p) for e in effects for p in e.parameters if include_fine or not p.secondary]
    given = values or {}
    return FreeParameters(tuple((e, free) for e, p in listed for free in p.free_entries(p.read(given.get(e, {})))))


def has_list(effect: Effect) -> bool:
    """Whether an effect states lists of numbers."""
    return any(isinstance(p, ListParameter) for p in effect.parameters)


def number_count(effect: Effect) -> float:
    """How many numbers an effect states; infinitely many with a list, which has any number of them."""
    return math.inf if has_list(effect) else len(free_parameters_of([effect]))


def identity_values(effect: Effect) -> dict[str, Any]:
    """The values at which an effect changes nothing."""
    return {p.name: p.identity for p in effect.parameters}


def _scale(parameter: Parameter) -> float:
    return parameter.prior**2 if parameter.even_symmetric else parameter.prior


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


def scan_effect(
    effect: Effect,
    comparison: Comparison,
    base: FittedValues,
    starts: Sequence[Mapping[str, float]],
    config: FitConfig,
) -> list[CandidateFit]:
    """The effect at its identity and at `starts` on top of `base`, the lowest cost first; nothing is fitted.

    Where several parameters have a scan of their own, a second cycle varies each from the best point of the first.
    """
    causes, identity = (*base, effect.id), identity_values(effect)
    points = [dict(identity), *({**identity, **point} for point in starts)]
    fits = _evaluate_points(comparison, causes, base, effect.id, points)
    several = sum(p.scan is not None for p in effect.parameters) > 1
    if several and fits[0].cost < config.second_cycle_cost * cost_at_identity(fits, effect):
        best = fits[0].values[effect.id]
        combined = [{**best, **_off_identity(point, identity)} for point in points[1:]]
        fresh = [point for point in combined if point not in points]
        fits = sorted([*fits, *_evaluate_points(comparison, causes, base, effect.id, fresh)], key=lambda f: f.cost)
    return fits


def cost_at_identity(fits: Sequence[CandidateFit], effect: Effect) -> float:
    """The cost of the point of a scan at which the effect is off."""
    identity = identity_values(effect)
    return next(f.cost for f in fits if f.values[effect.id] == identity)


def fit_from_scan(
    effect: Effect,
    comparison: Comparison,
    base: FittedValues,
    fits: Sequence[CandidateFit],
    config: FitConfig,
    max_starts: int | None = None,
) -> CandidateFit:
    """The best local fit of one effect, its base unchanged, from the best points of a scan.

    Of an effect with many parameters from one, which is the best on all captures of the comparison: a few of them can't
    tell opposite wedges apart.
    """
    if sum(not p.secondary for p in effect.parameters) >= config.single_start_parameters:
        best_few = [f for f in fits if np.isfinite(f.cost)][: config.compared_starts]
        starts = sorted(best_few, key=lambda s: cost_or_inf(comparison, s.values))[:1]
    else:
        starts = _separated_starts(fits, effect, config, config.starts if max_starts is None else max_starts)
    best = min((local_fit([effect], s.values, comparison, config) for s in starts), key=lambda f: f.cost)
    return CandidateFit((*base, effect.id), best.values, best.cost)


def fit_rival_parameters(
    effect: Effect, comparison: Comparison, base: FittedValues, fits: Sequence[CandidateFit], config: FitConfig
) -> CandidateFit:
    """The best local fit of one effect, its base unchanged, of all parameters together from the best of one alone.

    Each parameter is fitted alone from its best point of a scan.
    """
    identity, alone = identity_values(effect), []
    for p in effect.parameters:
        own = [f for f in fits if _off_identity(f.values[effect.id], identity).keys() == {p.name}]
        fixed = frozenset((effect.id, other.name) for other in effect.parameters if other is not p)
        alone += [local_fit([effect], f.values, comparison, config, fixed=fixed) for f in own[:1]]
    best = min(alone, key=lambda f: f.cost)
    together = local_fit([effect], best.values, comparison, config)
    return CandidateFit((*base, effect.id), together.values, together.cost)


def find_hard_edges(effect: Effect, fit: CandidateFit, comparison: Comparison, config: FitConfig) -> CandidateFit:
    """A point of a scan with the effect's hard edges found by a simplex; unchanged where the effect has none."""
    free = free_parameters_of([effect], fit.values)
    edges = hard_edge_mask(free)
    if not edges.any():
        return fit
    function, start = residuals_and_start(free, fit, comparison)
    bounds = free.bounds(config.steps)
    minimum = nelder_mead(function, start, bounds, edges, config.scan_edge_size, config.edge_evaluations)
    return CandidateFit(fit.causes, free.unpack(minimum.x, fit.values), minimum.cost)


def _evaluate_points(
    comparison: Comparison, causes: tuple[str, ...], base: FittedValues, own: str, points: Sequence[dict[str, float]]
) -> list[CandidateFit]:
    """The effect `own` at each point on top of the base, the lowest cost first."""
    fits = []
    for point in points:
        values = {**base, own: dict(point)}
        fits.append(CandidateFit(causes, values, cost_or_inf(comparison, values)))
    return sorted(fits, key=lambda f: f.cost)


def _off_identity(point: Mapping[str, float], identity: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in point.items() if value != identity[name]}


def _separated_starts(
    fits: Sequence[CandidateFit], effect: Effect, config: FitConfig, max_starts: int
) -> list[CandidateFit]:
    """The best points of a scan with finite costs that aren't neighbours."""
    chosen: list[CandidateFit] = []
    for fit in fits:
        separate = all(_scan_distance(fit, other, effect) > config.start_separation for other in chosen)
        if np.isfinite(fit.cost) and separate:
            chosen.append(fit)
        if len(chosen) == max_starts:
            break
    return chosen


def _scan_distance(a: CandidateFit, b: CandidateFit, effect: Effect) -> float:
    """The largest difference of a parameter in steps of its scan; of different lists infinite."""
    steps = {p.name: p.scan[2] if p.scan else p.prior for p in effect.parameters}
    first, second = a.values[effect.id], b.values[effect.id]
    if any(isinstance(value, tuple) for value in first.values()):
        return 0.0 if first == second else math.inf
    return max(abs(first[name] - second[name]) / step for name, step in steps.items())


def refit_with_longer_steps(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """Few parameters fitted again with longer difference steps, which see past the jumps of irises on a grid."""
    if len(free_parameters_of(effects, fit.values)) > config.few_parameters:
        return fit
    longer = refit(effects, fit.values, comparison, config, step_factor=config.longer_step_factor)
    return min(fit, longer, key=lambda f: f.cost)


def refine_hard_edges(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """Hard edges by a large simplex, then all parameters by least squares, then hard edges by a small simplex."""
    free = free_parameters_of(effects, fit.values)
    edges = hard_edge_mask(free)
    if not edges.any():
        return fit
    (function, start), bounds = residuals_and_start(free, fit, comparison), free.bounds(config.steps)
    best = nelder_mead(function, start, bounds, edges, config.first_edge_size, config.edge_evaluations)
    if not edges.all():
        smooth = levenberg_marquardt(
            function,
            best.x,
            bounds,
            iterations=config.edge_iterations,
            tolerance=config.edge_tolerance,
            parts=residual_parts(free, fit.values, comparison),
        )
        best = min(best, smooth, key=lambda m: m.cost)
    best = nelder_mead(function, best, bounds, edges, config.last_edge_size, config.edge_evaluations)
    return CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)


def search_along_axes(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """While χ² exceeds the noise: a search along each axis of effects with few parameters, then a fit from there."""
    free = free_parameters_of(effects, fit.values)
    counts = Counter(effect for effect, _ in free.entries)
    axes = [i for i, (effect, _) in enumerate(free.entries) if counts[effect] <= config.few_parameters]
    if not axes or fit.cost < config.axis_max_chi2 * comparison.pixel_count:
        return fit
    (function, best), bounds = residuals_and_start(free, fit, comparison), free.bounds(config.steps)
    offsets = np.linspace(-config.axis_reach, config.axis_reach, config.axis_points)
    for axis in axes:
        step = float(bounds.step[axis])
        best = min(best, axis_scan(function, best.x, bounds, axis, step * offsets), key=lambda m: m.cost)
        spacing = 2 * step * config.axis_reach / (config.axis_points - 1)
        moved = minimise_along_axis(function, best.x, bounds, axis, spacing, evaluations=config.axis_evaluations)
        best = min(best, moved, key=lambda m: m.cost)
    if best.cost >= fit.cost:
        return fit
    found = CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)
    return min(found, refit(effects, found.values, comparison, config), key=lambda f: f.cost)


def drop_negligible_values(
    effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison, config: FitConfig
) -> CandidateFit:
    """Sets negligible values to their identity unless the captures insist on them, and fits the others again."""
    values, cost, fixed = fit.values, fit.cost, set()
    for e, p in free_parameters_of(effects, fit.values, include_fine=True).entries:
        away = abs(p.read(values.get(e, {})) - p.identity)  # NaN for entries of lists, which have no identity
        if not 0.0 < away < config.negligible * p.prior:
            continue
        without = {**values, e: p.written(values[e], p.identity)}
        allowed = cost + config.insistence * max(1.0, cost / comparison.pixel_count)
        if (cost_without := cost_or_inf(comparison, without)) < allowed:
            values, cost = without, cost_without
            fixed.add((e, p.name))
    if not fixed:
        return fit
    fitted = refit(effects, values, comparison, config, fixed=frozenset(fixed))
    return CandidateFit(fit.causes, fitted.values, fitted.cost)
