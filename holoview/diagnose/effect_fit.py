"""The best values of one effect, or of several together: a scan over its range, then a local fit.

A tangent at the identity value tells the cause of small errors. Large ones decorrelate the speckle, and the true value
is then found only by looking along the effect's range: `scan`. Hard edges have no slopes: minimisation along one axis.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.free_parameters import FittedValues, FreeParameters, free_parameters_of
from holoview.model.effects.effect import Effect
from holoview.numerics.least_squares import (
    Minimum,
    ResidualFunction,
    ResidualVector,
    Vector,
    axis_scan,
    jacobian,
    levenberg_marquardt,
    minimise_along_axis,
)
from holoview.numerics.nelder_mead import nelder_mead
from holoview.util.errors import UserError

FixedParameters = frozenset[tuple[str, str]]

_LOCAL_STARTS, _MANY = 2, 4
_NEGLIGIBLE = 0.02  # of the prior; so small a value stays at its identity unless the captures insist
_INSISTS = 9.0  # Δχ² of a parameter: 3 σ
_STRETCH, _FEW = 5.0, 2
_AT_FLOOR, _REACH, _POINTS, _ALONG = 1.01, 10.0, 17, 10  # χ²/n; steps of a difference; evaluations
_EDGES_FOUND = 0.9  # of the cost at the start: then it is worth finding them exactly
_FAR_EDGE, _FIRST_EDGE, _LAST_EDGE, _EDGE_EVALUATIONS = 1.0, 0.5, 0.05, 100  # of the prior
_SHARP_ITERATIONS = 3
_GAIN_OF_A_CYCLE = 0.99  # a second round over the parameters is worth it when the first lowered the cost below this


@dataclass(frozen=True)
class CandidateFit:
    """Causes with values, and their cost (Σ residual²) in the comparison that they were fitted in."""

    causes: tuple[str, ...]
    values: FittedValues
    cost: float

    @property
    def parameter_count(self) -> int:
        """How many numbers it takes."""
        return sum(len(values) for values in self.values.values())

    def without(self, name: str) -> CandidateFit:
        """The same with one cause off, as it is: neither fitted nor compared again."""
        values = {cause: own for cause, own in self.values.items() if cause != name}
        return CandidateFit(tuple(cause for cause in self.causes if cause != name), values, float("inf"))


def cost_or_inf(comparison: Comparison, values: Mapping[str, Mapping[str, float]]) -> float:
    """Σ residual², infinite where such a bench can't be (a gap below zero, say)."""
    try:
        return float(comparison.fit_gains(values).squares.sum())
    except UserError:
        return float("inf")


def scan_effect(
    effect: Effect, comparison: Comparison, base: FittedValues, starts: Sequence[Mapping[str, float]]
) -> list[CandidateFit]:
    """Trials at the identity and at `starts` on top of `base`, best first.

    Where several parameters have a scan of their own, a second round varies each from the best point of the first.
    """
    causes = (*base, effect.id)
    identity = {p.name: p.identity for p in effect.parameters}
    points = [dict(identity), *({**identity, **p} for p in starts)]
    trials = _evaluate_points(comparison, causes, base, effect.id, points)
    several = sum(p.scan is not None for p in effect.parameters) > 1
    if several and trials[0].cost < _GAIN_OF_A_CYCLE * cost_at_identity(trials, effect):
        best = trials[0].values[effect.id]
        more = [{**best, **_off_identity(point, identity)} for point in points[1:]]
        fresh = [point for point in more if point not in points]
        trials = sorted([*trials, *_evaluate_points(comparison, causes, base, effect.id, fresh)], key=lambda t: t.cost)
    return trials


def cost_at_identity(fits: Sequence[CandidateFit], effect: Effect) -> float:
    """The cost of the trial in which the effect is off."""
    identity = {p.name: p.identity for p in effect.parameters}
    return next(t.cost for t in fits if t.values[effect.id] == identity)


def local_fit(
    effects: Sequence[Effect],
    start: FittedValues,
    comparison: Comparison,
    *,
    iterations: int = 6,
    tolerance: float = 2e-3,
    include_fine: bool = False,
    step_factor: float = 1.0,
    fixed: FixedParameters = frozenset(),
) -> CandidateFit:
    """Levenberg–Marquardt on all parameters of the effects from `start`, then a simplex where all are hard edges.

    fine: the fine ones too. stretch: of the steps of its differences. held: (effect, parameter) that stay as they are.
    """
    free = free_parameters_of(effects, include_fine=include_fine)
    varied = FreeParameters(tuple((e, p) for e, p in free.entries if (e, p.name) not in fixed))
    values, cost = start, cost_or_inf(comparison, start)
    if len(varied):
        function, bounds = residual_function(varied, start, comparison), varied.bounds().with_longer_steps(step_factor)
        minimum = levenberg_marquardt(function, varied.pack(start), bounds, iterations=iterations, tolerance=tolerance)
        if _hard_edge_mask(varied).all() and minimum.cost < _EDGES_FOUND * cost:
            minimum = nelder_mead(function, minimum, bounds, _hard_edge_mask(varied), _FIRST_EDGE, _EDGE_EVALUATIONS)
        values, cost = varied.unpack(minimum.x, start), minimum.cost
    return CandidateFit(tuple(e.id for e in effects), values, cost)


def fit_from_scan(
    effect: Effect,
    comparison: Comparison,
    base: FittedValues,
    fits: Sequence[CandidateFit],
    max_starts: int = _LOCAL_STARTS,
) -> CandidateFit:
    """Local fits of the effect alone from the best points of a scan."""
    fits = [local_fit([effect], t.values, comparison) for t in _separated_starts(fits, effect, max_starts)]
    best = min(fits, key=lambda t: t.cost)
    return CandidateFit((*base, effect.id), best.values, best.cost)


def residual_function(free: FreeParameters, base: FittedValues, comparison: Comparison) -> ResidualFunction:
    """The residuals as a function of the vector; a bench that can't be answers with the residuals of no light."""

    def function(x: Vector) -> ResidualVector:
        try:
            return comparison.residual(free.unpack(x, base))
        except UserError:
            return comparison.infeasible_residual

    return function


def effect_jacobian(
    effect: Effect, values: FittedValues, comparison: Comparison, residual: np.ndarray, *, step_factor: float = 1.0
) -> np.ndarray:
    """Slopes (parameter, pixel) of the residuals by the effect's parameters at `values`, in units of the priors.

    stretch: of the steps of its differences.
    """
    free = free_parameters_of([effect])
    bounds = free.bounds().with_longer_steps(step_factor)
    return jacobian(residual_function(free, values, comparison), free.pack(values), residual, bounds)


def _evaluate_points(
    comparison: Comparison, causes: tuple[str, ...], base: FittedValues, own: str, points: Sequence[dict[str, float]]
) -> list[CandidateFit]:
    trials = []
    for point in points:
        values = {**base, own: dict(point)}
        trials.append(CandidateFit(causes, values, cost_or_inf(comparison, values)))
    return sorted(trials, key=lambda t: t.cost)


def _off_identity(point: Mapping[str, float], identity: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in point.items() if value != identity[name]}


def _separated_starts(fits: Sequence[CandidateFit], effect: Effect, starts: int) -> list[CandidateFit]:
    """The best trials to start from: finite, not next to each other in the scan; one where there are many numbers."""
    chosen: list[CandidateFit] = []
    starts = starts if sum(not p.fine for p in effect.parameters) < _MANY else 1
    for trial in fits:
        if np.isfinite(trial.cost) and all(_scan_distance(trial, other, effect) > 1.5 for other in chosen):
            chosen.append(trial)
        if len(chosen) == starts:
            break
    return chosen


def _scan_distance(a: CandidateFit, b: CandidateFit, effect: Effect) -> float:
    """The largest difference of a parameter in steps of its scan."""
    steps = {p.name: p.scan[2] if p.scan else p.prior for p in effect.parameters}
    first, second = a.values[effect.id], b.values[effect.id]
    return max(abs(first[name] - second[name]) / step for name, step in steps.items())


def find_hard_edges(effect: Effect, fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """A trial of a scan with the effect's hard edges looked for by a simplex; as it is where it has none."""
    free = free_parameters_of([effect])
    sharp = _hard_edge_mask(free)
    if not sharp.any():
        return fit
    function, start = _residuals_and_start(free, fit, comparison)
    found = nelder_mead(function, start, free.bounds(), sharp, _FAR_EDGE, _EDGE_EVALUATIONS)
    return CandidateFit(fit.causes, free.unpack(found.x, fit.values), found.cost)


def refine_hard_edges(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """Parameters with hard edges by a simplex, then by a smaller one; the others fitted again between the two."""
    free = free_parameters_of(effects)
    sharp = _hard_edge_mask(free)
    if not sharp.any():
        return fit
    (function, start), bounds = _residuals_and_start(free, fit, comparison), free.bounds()
    best = nelder_mead(function, start, bounds, sharp, _FIRST_EDGE, _EDGE_EVALUATIONS)
    if not sharp.all():
        found = levenberg_marquardt(function, best.x, bounds, iterations=_SHARP_ITERATIONS, tolerance=1e-3)
        best = min(best, found, key=lambda m: m.cost)
    best = nelder_mead(function, best, bounds, sharp, _LAST_EDGE, _EDGE_EVALUATIONS)
    return CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)


def _residuals_and_start(
    free: FreeParameters, fit: CandidateFit, comparison: Comparison
) -> tuple[ResidualFunction, Minimum]:
    """The residuals as a function of the unknowns, and where a trial lies in it."""
    at = Minimum(free.pack(fit.values), fit.cost, comparison.residual(fit.values), 0)
    return residual_function(free, fit.values, comparison), at


def _hard_edge_mask(free: FreeParameters) -> NDArray[np.bool_]:
    return np.array([p.sharp for _, p in free.entries], dtype=bool)


def refit_with_longer_steps(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """Few parameters once more with longer steps: where edges of irises jump, short differences find no slope."""
    if len(free_parameters_of(effects)) > _FEW:
        return fit
    longer = local_fit(effects, fit.values, comparison, iterations=3, tolerance=1e-4, step_factor=_STRETCH)
    return min(fit, longer, key=lambda t: t.cost)


def search_along_axes(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """What stopped short of the floor, along each axis of effects with few parameters; fitted again from there."""
    free = free_parameters_of(effects)
    each = Counter(effect for effect, _ in free.entries)
    axes = [i for i, (effect, _) in enumerate(free.entries) if each[effect] <= _FEW]
    if not axes or fit.cost < _AT_FLOOR * comparison.pixel_count:
        return fit
    (function, found), bounds = _residuals_and_start(free, fit, comparison), free.bounds()
    for axis in axes:
        step = float(bounds.step[axis])
        near = axis_scan(function, found.x, bounds, axis, step * np.linspace(-_REACH, _REACH, _POINTS))
        found = min(found, near, key=lambda m: m.cost)
        spacing = 2 * step * _REACH / (_POINTS - 1)
        moved = minimise_along_axis(function, found.x, bounds, axis, spacing, evaluations=_ALONG)
        found = min(found, moved, key=lambda m: m.cost)
    if found.cost >= fit.cost:
        return fit
    again = local_fit(effects, free.unpack(found.x, fit.values), comparison, iterations=3, tolerance=1e-4)
    return min(CandidateFit(fit.causes, free.unpack(found.x, fit.values), found.cost), again, key=lambda t: t.cost)


def drop_negligible_values(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """Without negligible values that the captures don't insist on, the others fitted again.

    Fewer numbers say the same; and a picture that isn't turned at all needs no interpolation.
    """
    values, cost, held = fit.values, fit.cost, set()
    for e, p in free_parameters_of(effects, include_fine=True).entries:
        away = abs(values.get(e, {}).get(p.name, p.identity) - p.identity)
        if not 0.0 < away < _NEGLIGIBLE * p.prior:
            continue
        without = {**values, e: {**values[e], p.name: p.identity}}
        if (less := cost_or_inf(comparison, without)) < cost + _INSISTS * max(1.0, cost / comparison.pixel_count):
            values, cost = without, less
            held.add((e, p.name))
    if not held:
        return fit
    fitted = local_fit(effects, values, comparison, iterations=3, tolerance=1e-4, fixed=frozenset(held))
    return CandidateFit(fit.causes, fitted.values, fitted.cost)
