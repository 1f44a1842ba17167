"""Local least-squares fits of one effect or of several together, scans of an effect's range, and improvements of a fit.

FreeParameters  the free parameters of a set of effects as one vector, in units of their priors
CandidateFit    causes with their values, and the cost
local_fit       a fit from starting values: Levenberg–Marquardt, and a downhill simplex for hard edges
scan_effect     the range of one effect, point by point, and fits from the best points: a large error decorrelates the
                speckle, so that derivatives at the identity don't show its cause
refit_with_longer_steps, search_within_steps, refine_hard_edges, search_along_axes, drop_negligible_values
                return a fit that costs no more; only `drop_negligible_values` may return a fit that costs slightly
                more, with fewer parameters

The solvers are those of `numerics.minimise`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.diagnose.likelihood import Comparison
from holoview.light.model.effects.effect import Effect, ListParameter, Parameter
from holoview.light.numerics.minimise import (
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

_STEP_REGULAR = 0.02
"""[prior] Of parameters that images depend on smoothly. Evidence: small enough for a slope, large enough for images in
single precision."""
_STEP_EVEN = 0.1
"""[prior²] Of parameters whose square images depend on. Evidence: images are nearly linear in the square; smaller steps
are lost in the jumps of irises on a grid."""
_STEP_HARD_EDGE = 0.4  # [prior] Of parameters that move a hard edge. Evidence: the edge passes over many samples.
FIT_ITERATIONS = 6  # [1] Levenberg–Marquardt iterations of a fit. Evidence: the search study.
_FIT_TOLERANCE = 2e-3
"""[1] A fit ends when an iteration lowers the cost by less than this share. Evidence: the search study."""
_REFIT_ITERATIONS = 3  # [1] Iterations of a fit from values that were fitted before.
FINAL_TOLERANCE = 1e-4  # [1] Tolerance of the last joint fit and of refits.
_SCAN_STARTS = 2
"""[1] Points of a scan from which an effect is fitted. Evidence: the search study fitted from the best point or two."""
_SINGLE_START_PARAMETERS = 4  # [parameters] Effects with so many or more are fitted from one point.
_COMPARED_STARTS = 4
"""[1] Of an effect that is fitted from one point, so many points are compared on all captures of the fit. Evidence:
measured: for fringes on a modulator, two captures preferred the opposite wedge."""
_START_SEPARATION = 1.5
"""[scan steps] Points this near to a better point aren't starts of their own. Evidence: they are its neighbours in the
scan."""
_SECOND_CYCLE_COST = 0.99
"""[1] Parameters are scanned a second time if the first cycle left less than this share of the cost. Evidence: the
search study used two cycles for Zernike terms."""
_NEGLIGIBLE_SHARE = 0.02
"""[prior] Values this near to the identity are set to it unless the captures insist. Evidence: fewer parameters, and an
image that isn't rotated at all needs no interpolation."""
_INSISTENCE = 9.0
"""[Δχ²] The captures insist on a value if the identity costs more. Evidence: derivation: 3 σ of one parameter."""
_LONGER_STEP_FACTOR = 5.0
"""[1] Fits with few parameters are repeated with steps so many times longer. Evidence: where irises on a grid jump,
short differences find no slope."""
_FEW_PARAMETERS = 2  # [parameters] So many are few: the fit is repeated with longer steps, and axes are searched.
_BACKWARD = -1.0
"""[1] Factor of the difference steps. Evidence: measured: without a fit with backward steps before the scan, one second
line of 14 was named beside fringes that weren't there."""
_WITHIN_STEP = np.linspace(-1.0, 1.0, 17)
"""[steps] Points of a scan where light passes edges. Evidence: a reason: derivatives are blind within a step."""
_SHORT_STEPS = (0.25, -0.25)
"""[1] Factors of the difference steps of fits from the best of them, forward and backward. Evidence: measured: from 32
points within 0.3 nm of eight second lines, without noise, fits ended within 1 of the least of χ²; without
the last one once 3 above it, and without the scan once 588."""
_AXIS_MAX_CHI2 = 1.01  # [χ²/n] Axes are searched while χ²/n is above.
_AXIS_REACH = 10.0  # [steps] An axis is searched this far either way.
_AXIS_POINTS = 17  # [points] Of the scan of an axis.
_AXIS_EVALUATIONS = 10  # [1] Evaluations of the golden section that follows.
_EDGE_MAX_COST = 0.9  # [1] Hard edges are searched exactly if the fit left less than this share of the cost.
_SCAN_EDGE_SIZE = 1.0  # [prior] First simplex for hard edges after a scan.
_FIRST_EDGE_SIZE = 0.5  # [prior] First simplex for hard edges after a fit.
_LAST_EDGE_SIZE = 0.05  # [prior] Last simplex for hard edges.
_EDGE_EVALUATIONS = 100  # [1] Evaluations of one simplex search.
EDGE_EVALUATIONS = 2 * _EDGE_EVALUATIONS  # [1] Of `refine_hard_edges`, at most.
_EDGE_ITERATIONS = 3  # [1] Iterations of the fit of other parameters between two simplex searches.
_EDGE_TOLERANCE = 1e-3  # [1] Tolerance of that fit.

FittedValues = dict[str, dict[str, Any]]
"""{effect id: {parameter: value}}; the value of a list of numbers is a tuple."""


@dataclass(frozen=True)
class FreeParameters:
    """The numbers that a fit varies: pairs (effect id, parameter), where entries of a list are parameters of their own.

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

    def bounds(self) -> SearchDomain:
        """The bounds of the vector, and steps of its forward differences."""
        lower = [(0.0 if p.even_symmetric else p.to_fit(p.low)) / _scale(p) for _, p in self.entries]
        upper = [p.to_fit(p.high) / _scale(p) for _, p in self.entries]
        lengths = [
            _STEP_HARD_EDGE if p.non_smooth else _STEP_EVEN if p.even_symmetric else _STEP_REGULAR
            for _, p in self.entries
        ]
        return SearchDomain(
            np.array(lower), np.array(upper), np.array(lengths), np.array([p.even_symmetric for _, p in self.entries])
        )

    def value_derivatives(self, x: Vector) -> Vector:
        """∂value/∂x at x, by which the vector's uncertainty becomes that of the values."""
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
    """The parameters of effects, and the entries of their lists at `values`; of the secondary parameters those that an
    earlier fit has freed, which aren't at their identity, or all if asked for."""
    given = values or {}
    listed = [
        (e.id, p)
        for e in effects
        for p in e.parameters
        if include_fine or not p.secondary or p.read(given.get(e.id, {})) != p.identity
    ]
    return FreeParameters(tuple((e, free) for e, p in listed for free in p.free_entries(p.read(given.get(e, {})))))


def has_list(effect: Effect) -> bool:
    """Whether an effect states lists of numbers."""
    return any(isinstance(p, ListParameter) for p in effect.parameters)


def number_count(effect: Effect) -> float:
    """The count of numbers that an effect states; infinite with a list, which has any number of entries."""
    return math.inf if has_list(effect) else len(free_parameters_of([effect]))


def identity_values(effect: Effect) -> dict[str, Any]:
    """The values at which an effect changes nothing."""
    return {p.name: p.identity for p in effect.parameters}


def _scale(parameter: Parameter) -> float:
    return parameter.prior**2 if parameter.even_symmetric else parameter.prior


FixedParameters = frozenset[tuple[str, str]]


@dataclass(frozen=True)
class CandidateFit:
    """Causes with their values, and the cost (Σ residual²) in the comparison that they were fitted in.

    is_final: whether nothing more is gained on the rougher captures, from whose derivatives intervals follow then.
    """

    causes: tuple[str, ...]
    values: FittedValues
    cost: float
    is_final: bool = False

    @property
    def parameter_count(self) -> int:
        """The count of numbers that the causes state."""
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
    *,
    iterations: int = FIT_ITERATIONS,
    tolerance: float = _FIT_TOLERANCE,
    include_fine: bool = False,
    step_factor: float = 1.0,
    fixed: FixedParameters = frozenset(),
) -> CandidateFit:
    """Levenberg–Marquardt on all parameters of the effects, then a downhill simplex if all of them are hard edges.

    iterations, tolerance: of least squares. include_fine: vary all secondary parameters. step_factor: of the
    difference steps. fixed: (effect, parameter) pairs that keep their start.
    """
    free = free_parameters_of(effects, start, include_fine=include_fine)
    varied = FreeParameters(tuple((e, p) for e, p in free.entries if (e, p.name) not in fixed))
    values, cost = start, cost_or_inf(comparison, start)
    if len(varied):
        function = residual_function(varied, start, comparison)
        bounds = varied.bounds().with_steps(step_factor)
        minimum = levenberg_marquardt(
            function,
            varied.pack(start),
            bounds,
            iterations=iterations,
            tolerance=tolerance,
            parts=residual_parts(varied, start, comparison),
        )
        edges = hard_edge_mask(varied)
        if edges.all() and minimum.cost < _EDGE_MAX_COST * cost:
            minimum = nelder_mead(function, minimum, bounds, edges, _FIRST_EDGE_SIZE, _EDGE_EVALUATIONS)
        values, cost = varied.unpack(minimum.x, start), minimum.cost
    return CandidateFit(tuple(e.id for e in effects), values, cost)


def refit(
    effects: Sequence[Effect],
    values: FittedValues,
    comparison: Comparison,
    *,
    step_factor: float = 1.0,
    fixed: FixedParameters = frozenset(),
) -> CandidateFit:
    """A short, precise local fit from values that were fitted before."""
    return local_fit(
        effects,
        values,
        comparison,
        iterations=_REFIT_ITERATIONS,
        tolerance=FINAL_TOLERANCE,
        step_factor=step_factor,
        fixed=fixed,
    )


def residual_function(free: FreeParameters, base: FittedValues, comparison: Comparison) -> ResidualFunction:
    """The residuals as a function of the vector; values that no bench can have give `infeasible_residual`."""

    def function(x: Vector) -> ResidualVector:
        try:
            return comparison.residual(free.unpack(x, base))
        except UserError:
            return comparison.infeasible_residual

    return function


def residual_parts(free: FreeParameters, base: FittedValues, comparison: Comparison) -> list[ResidualPart]:
    """As `residual_function`, for some captures at a time where there are many pixels."""
    return [ResidualPart(where, residual_function(free, base, part)) for where, part in comparison.parts()]


def effect_jacobian(
    effect: Effect,
    values: FittedValues,
    comparison: Comparison,
    residual: NDArray[np.float32],
    *,
    step_factor: float = 1.0,
) -> NDArray[np.float32]:
    """Derivatives (parameter, pixel) of the residuals by the effect's parameters at `values`, in units of the priors.

    residual: the residuals at `values`. step_factor: of the difference steps.
    """
    free = free_parameters_of([effect], values)
    bounds = free.bounds().with_steps(step_factor)
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
) -> list[CandidateFit]:
    """The effect at its identity and at `starts` on top of `base`, the lowest cost first; nothing is fitted.

    Where several parameters have a scan of their own, a second cycle varies each from the best point of the first.
    """
    causes, identity = (*base, effect.id), identity_values(effect)
    points = [dict(identity), *({**identity, **point} for point in starts)]
    fits = _evaluate_points(comparison, causes, base, effect.id, points)
    several = sum(p.scan is not None for p in effect.parameters) > 1
    if several and fits[0].cost < _SECOND_CYCLE_COST * cost_at_identity(fits, effect):
        best = fits[0].values[effect.id]
        combined = [{**best, **_off_identity(point, identity)} for point in points[1:]]
        fresh = [point for point in combined if point not in points]
        fits = sorted([*fits, *_evaluate_points(comparison, causes, base, effect.id, fresh)], key=lambda f: f.cost)
    return fits


def scan_upwards(
    effect: Effect, comparison: Comparison, base: FittedValues, starts: Sequence[Mapping[str, float]]
) -> list[CandidateFit]:
    """As `scan_effect`, but from the first of `starts` on only as long as the cost falls."""
    causes, identity = (*base, effect.id), identity_values(effect)
    fits = _evaluate_points(comparison, causes, base, effect.id, [dict(identity)])
    for start in starts:
        (further,) = _evaluate_points(comparison, causes, base, effect.id, [{**identity, **start}])
        fits.append(further)
        if further.cost >= min(fit.cost for fit in fits[:-1]):
            break
    return sorted(fits, key=lambda fit: fit.cost)


def cost_at_identity(fits: Sequence[CandidateFit], effect: Effect) -> float:
    """The cost of the point of a scan at which the effect is off."""
    identity = identity_values(effect)
    return next(f.cost for f in fits if f.values[effect.id] == identity)


def fit_from_scan(
    effect: Effect,
    comparison: Comparison,
    base: FittedValues,
    fits: Sequence[CandidateFit],
    max_starts: int = _SCAN_STARTS,
) -> CandidateFit:
    """The best local fit of one effect, its base unchanged, from the best points of a scan.

    An effect with many parameters is fitted from one point, the best on all captures of the comparison: a few captures
    can't tell opposite wedges apart.
    """
    if sum(not p.secondary for p in effect.parameters) >= _SINGLE_START_PARAMETERS:
        best_few = [f for f in fits if np.isfinite(f.cost)][:_COMPARED_STARTS]
        starts = sorted(best_few, key=lambda s: cost_or_inf(comparison, s.values))[:1]
    else:
        starts = _separated_starts(fits, effect, max_starts)
    best = min((local_fit([effect], s.values, comparison) for s in starts), key=lambda f: f.cost)
    return CandidateFit((*base, effect.id), best.values, best.cost)


def fit_rival_parameters(
    effect: Effect, comparison: Comparison, base: FittedValues, fits: Sequence[CandidateFit]
) -> CandidateFit:
    """The best local fit of one effect, its base unchanged: of all parameters together, from the best fit of one
    parameter.

    Each parameter is fitted alone from its best point of a scan.
    """
    identity, alone = identity_values(effect), []
    for p in effect.parameters:
        own = [f for f in fits if _off_identity(f.values[effect.id], identity).keys() == {p.name}]
        fixed = frozenset((effect.id, other.name) for other in effect.parameters if other is not p)
        alone += [local_fit([effect], f.values, comparison, fixed=fixed) for f in own[:1]]
    best = min(alone, key=lambda f: f.cost)
    together = local_fit([effect], best.values, comparison)
    return CandidateFit((*base, effect.id), together.values, together.cost)


def find_hard_edges(effect: Effect, fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """A point of a scan with the effect's hard edges found by a simplex; unchanged where the effect has none."""
    free = free_parameters_of([effect], fit.values)
    edges = hard_edge_mask(free)
    if not edges.any():
        return fit
    function, start = residuals_and_start(free, fit, comparison)
    bounds = free.bounds()
    minimum = nelder_mead(function, start, bounds, edges, _SCAN_EDGE_SIZE, _EDGE_EVALUATIONS)
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


def _separated_starts(fits: Sequence[CandidateFit], effect: Effect, max_starts: int) -> list[CandidateFit]:
    """The best points of a scan with finite costs that aren't neighbours."""
    chosen: list[CandidateFit] = []
    for fit in fits:
        separate = all(_scan_distance(fit, other, effect) > _START_SEPARATION for other in chosen)
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


def refit_with_longer_steps(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """A fit with few parameters, repeated with longer difference steps, which reach past the jumps of irises on a
    grid."""
    if len(free_parameters_of(effects, fit.values)) > _FEW_PARAMETERS:
        return fit
    longer = refit(effects, fit.values, comparison, step_factor=_LONGER_STEP_FACTOR)
    return min(fit, longer, key=lambda f: f.cost)


def search_within_steps(
    effects: Sequence[Effect],
    fit: CandidateFit,
    comparison: Comparison,
    *,
    iterations: int = _REFIT_ITERATIONS,
    tolerance: float = FINAL_TOLERANCE,
) -> CandidateFit:
    """Where light passes edges of stops: a fit with steps backward, a scan of a step either way, fits with short steps.

    A sample of the grid that passes an edge changes the images by a field of its own, nearly orthogonal to those of
    other samples. The residuals hold the fields of the samples between the present value and the true one, and a
    difference those of the samples within its step. So it sees the true value only if the step goes that way, and a
    longer step than needed hides it behind samples beyond.
    """
    free = free_parameters_of(effects, fit.values)
    axes = [i for i, (_, p) in enumerate(free.entries) if p.passes_edges]
    if not axes:
        return fit

    def fitted(start: CandidateFit, factor: float) -> CandidateFit:
        again = local_fit(
            effects, start.values, comparison, iterations=iterations, tolerance=tolerance, step_factor=factor
        )
        return min(start, again, key=lambda f: f.cost)

    fit = fitted(fit, _BACKWARD)
    (function, best), bounds = residuals_and_start(free, fit, comparison), free.bounds()
    for axis in axes:
        offsets = bounds.step_at(best.x, axis) * _WITHIN_STEP
        best = min(best, axis_scan(function, best.x, bounds, axis, offsets), key=lambda m: m.cost)
    fit = CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)
    for factor in _SHORT_STEPS:
        fit = fitted(fit, factor)
    return fit


def refine_hard_edges(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """Hard edges by a large simplex, then all parameters by least squares, then hard edges by a small simplex."""
    free = free_parameters_of(effects, fit.values)
    edges = hard_edge_mask(free)
    if not edges.any():
        return fit
    (function, start), bounds = residuals_and_start(free, fit, comparison), free.bounds()
    best = nelder_mead(function, start, bounds, edges, _FIRST_EDGE_SIZE, _EDGE_EVALUATIONS)
    if not edges.all():
        smooth = levenberg_marquardt(
            function,
            best.x,
            bounds,
            iterations=_EDGE_ITERATIONS,
            tolerance=_EDGE_TOLERANCE,
            parts=residual_parts(free, fit.values, comparison),
        )
        best = min(best, smooth, key=lambda m: m.cost)
    best = nelder_mead(function, best, bounds, edges, _LAST_EDGE_SIZE, _EDGE_EVALUATIONS)
    return CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)


def search_along_axes(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """While χ² exceeds the noise: a search along each axis of effects with few parameters, then a fit from there."""
    free = free_parameters_of(effects, fit.values)
    counts = Counter(effect for effect, _ in free.entries)
    axes = [i for i, (effect, _) in enumerate(free.entries) if counts[effect] <= _FEW_PARAMETERS]
    if not axes or fit.cost < _AXIS_MAX_CHI2 * comparison.pixel_count:
        return fit
    (function, best), bounds = residuals_and_start(free, fit, comparison), free.bounds()
    offsets = np.linspace(-_AXIS_REACH, _AXIS_REACH, _AXIS_POINTS)
    for axis in axes:
        step = abs(bounds.step_at(best.x, axis))
        best = min(best, axis_scan(function, best.x, bounds, axis, step * offsets), key=lambda m: m.cost)
        spacing = 2 * step * _AXIS_REACH / (_AXIS_POINTS - 1)
        moved = minimise_along_axis(function, best.x, bounds, axis, spacing, evaluations=_AXIS_EVALUATIONS)
        best = min(best, moved, key=lambda m: m.cost)
    if best.cost >= fit.cost:
        return fit
    found = CandidateFit(fit.causes, free.unpack(best.x, fit.values), best.cost)
    return min(found, refit(effects, found.values, comparison), key=lambda f: f.cost)


def drop_negligible_values(effects: Sequence[Effect], fit: CandidateFit, comparison: Comparison) -> CandidateFit:
    """Sets negligible values to their identity unless the captures insist on them, and fits the others again."""
    values, cost, fixed = fit.values, fit.cost, set()
    for e, p in free_parameters_of(effects, fit.values, include_fine=True).entries:
        away = abs(p.read(values.get(e, {})) - p.identity)  # NaN for entries of lists, which have no identity
        if not 0.0 < away < _NEGLIGIBLE_SHARE * p.prior:
            continue
        without = {**values, e: p.written(values[e], p.identity)}
        allowed = cost + _INSISTENCE * max(1.0, cost / comparison.pixel_count)
        if (cost_without := cost_or_inf(comparison, without)) < allowed:
            values, cost = without, cost_without
            fixed.add((e, p.name))
    if not fixed:
        return fit
    fitted = refit(effects, values, comparison, fixed=frozenset(fixed))
    return CandidateFit(fit.causes, fitted.values, fitted.cost)
