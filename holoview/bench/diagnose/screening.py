"""First look at every effect, on the smoothest captures, on top of causes that are already known.

The method depends on the relative error of the model. Small: derivatives at the identity predict the gain of each
effect, and only the most promising effects are fitted. Medium: every effect is fitted from its identity. Large: every
effect is scanned over its range first, since decorrelated speckle has no derivative that points to the true value.

One queue, ordered by the estimated cost of each effect's search, is worked off in batches, so that the caller can stop
once an effect explains everything. At the end of a round the caller looks at the fits found, and may search further
causes before the queue goes on with effects that cost more.

The cost of a prediction is the number of fields that it adds incoherently: bandwidth, an extended source and flicker
make one image of many fields (wavelengths × directions × moments).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from holoview.bench.diagnose.capture_split import spread_over_wavelengths
from holoview.bench.diagnose.config import USUAL_SAMPLES
from holoview.bench.diagnose.fit import (
    CandidateFit,
    FittedValues,
    cost_at_identity,
    cost_or_inf,
    effect_jacobian,
    find_hard_edges,
    fit_from_scan,
    fit_rival_parameters,
    identity_values,
    local_fit,
    scan_effect,
    scan_upwards,
)
from holoview.bench.diagnose.likelihood import Comparison, GainFit, Values
from holoview.bench.diagnose.search_context import SearchContext, field_samples
from holoview.bench.diagnose.starts.fringes import FringeStarts, ModulatorFringeStarts
from holoview.bench.diagnose.starts.picture import (
    DisplacementStarts,
    GhostStarts,
    PlaneStarts,
    SmearStarts,
    StartingValues,
    StartProvider,
)
from holoview.bench.diagnose.starts.stuck import StuckStarts, is_stuck_effect
from holoview.light.model.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS, Effect, StartKind
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback, no_progress

ALL_KINDS = frozenset(StartKind)
_SEEN_KINDS = ALL_KINDS - {StartKind.DISPLACEMENT}
"""Starting values that residuals show at once, of effects without a derivative at their identity."""
_STUCK_COST = 6000.0
"""[fields] Cost of the search for stuck pixels. Evidence: measured: where a gap and a shift had decorrelated the
speckle, it took more than a minute with 128 × 96 modulator pixels, and minutes with a million samples."""
_DEAR_SHARE = 0.3
"""[1] Of the budget of fields: effects whose search may take more begin a round of their own. Evidence: on a Fourier
bench of 1024 × 768 pixels an extended source and stuck pixels do; up to 200 × 200 pixels nothing does."""
_DECISIVE_TANGENT_GAIN = 0.5
"""[1] Once one effect's derivatives explain this share of the cost, derivatives by effects of very many fields aren't
computed. Evidence: measured: on a Fourier bench of 1024 × 768 pixels an extended source took 28 s, all others 11 s, of
which undiffracted light explained 0.68."""
TANGENT_MAX_ERROR = 0.05
"""[error] Below it tangents rank the effects. Evidence: the screening study: tangents ranked the cause first for 31 of
31 faults at errors of 0.003 to 0.03, and for 30 of 31 at 0.15."""
LOCAL_MAX_ERROR = 0.35
"""[error] Below it every effect is fitted from its identity before any scan. Evidence: the screening study: tangents
ranked the cause first for 26 of 31 faults at 0.5, for 8 of 31 at 1."""
_BLOCK = 1 << 18  # [pixels] Whose derivatives are orthogonalised at a time.
_MIN_INDEPENDENCE = 1e-10
"""[1] Of the largest squared length, below which a direction is rounding. Evidence: derivation: single precision."""
_TANGENT_FITS = 8
"""[effects] The best by their tangents are fitted. Evidence: the screening study: on smooth captures the cause was
among the first 5; 3 more as a margin."""
_TANGENT_FITS_AT_ONCE = 4
"""[effects] Of these, fitted between two decisions whether to stop. Evidence: of pairs, the second cause was mostly
among the first two; a multiple of two keeps two processes busy."""
_COSTLY_STEP_FACTOR = 20.0
"""[1] Difference steps of costly effects are so many times longer. Evidence: over short steps an iris on a grid passes
over whole samples, which changes the light more than the effect does."""
_NO_SCAN_CHI2 = 2.0
"""[χ²/n] Near the truth, no range is scanned if the model is this close. Evidence: nothing lies beyond the reach of
tangents there."""
SCAN_CAPTURES = 2  # [captures] A scan compares.
_COSTLY_SCAN_POINTS = 3  # [points] Of the scan of a costly effect, as its cost is estimated.
_COSTLY_MAX_COST = 0.9
"""[1] A costly effect is fitted if a point of its scan leaves less than this share of the cost without it."""
_LOCAL_ITERATIONS = 4
"""[1] Levenberg–Marquardt iterations of a local fit in a screening; the search study needed at most 6 for complete
fits."""
_POINTS_PER_PARAMETER = 3
"""[points] A local fit counts as so many points of a scan for each parameter. Only the order in which effects are tried
depends on this constant and the next three."""
_UPSTREAM_COST = 4.0  # [1] Relative cost of a field where the effect acts before the camera.
_CAMERA_POSE_COST = 0.2  # [1] Relative cost of a prediction where the effect acts on the camera.
_DOWNSTREAM_COST = 2.0  # [1] Relative cost of a prediction where the effect acts on anything else.
COSTLY_FIELDS = 5
"""[fields] A capture whose prediction adds so many or more is costly. Evidence: the search study summed a bandwidth at
5 Gauss–Hermite points."""
VERY_COSTLY_FIELDS = 25
"""[fields] A capture with so many or more is very costly. Evidence: 5², for the two dimensions of a source."""
_COSTLY_EXCESS_SHARE = 0.4
"""[1] Costly fits are pursued if their excess is below this share of the best simple fit's. Evidence: lost contrast
imitates whatever is unknown."""
_COSTLY_CHANCE = 5.0
"""[√n] Costly fits are also pursued if Σ residual² exceeds the n pixels by less than this many √n. Evidence:
derivation: 3.5 σ of χ², whose standard deviation is √(2n)."""


def field_count(context: SearchContext, values: Values) -> int:
    """Number of fields whose intensities a prediction of one capture adds with these effects; 1 for values that no
    bench can have."""
    system, moments = context.system, 1
    nominal_lines = len(system.wavelengths_m)
    for name, own in values.items():
        effect = context.effects[name]
        try:
            complete = effect.parameter_values(own)
            system, moments = effect.actual_system(system, complete), moments * len(effect.exposure_samples(complete))
        except UserError:
            return 1
    return len(system.wavelengths_m) // nominal_lines * len(system.source.directions_rad) * moments


def largest_field_count(context: SearchContext, effect: Effect) -> int:
    """Fields of one capture at the last point of an effect's scan."""
    points = list(effect.starting_points(context.system))
    return field_count(context, {effect.id: points[-1]}) if points else 1


def _doubling_points(context: SearchContext, effect: Effect) -> list[dict[str, float]]:
    """Points of a very costly effect's scan, of few fields first, each about twice as far as the one before."""
    points = sorted(effect.starting_points(context.system), key=lambda point: field_count(context, {effect.id: point}))
    return [points[2**k - 1] for k in range(len(points).bit_length())]


def prediction_cost(context: SearchContext, values: Values) -> float:
    """Estimated cost of a prediction of one capture, in fields of usual size; a smaller field costs as much as one."""
    samples = field_samples(context.data.captures, context.sampling)
    return max(1.0, samples / USUAL_SAMPLES) * field_count(context, values)


def changes_light(effect: Effect) -> bool:
    """Whether an effect acts before the camera, so that each of its values needs fields of its own."""
    return any(effect.overrides(hook) for hook in (*BENCH_HOOKS, *MODULATOR_HOOKS) if hook != "laser_power")


def search_cost(context: SearchContext, effect: Effect) -> float:
    """Estimated cost of the search of an effect, in fields, which orders the queue.

    Points of its scan × fields of a prediction × a factor for where it acts on the light; of a very costly effect those
    that a scan from small values on looks at; for stuck pixels the cost of their starting values.
    """
    if is_stuck_effect(effect):
        return _STUCK_COST
    points = len(list(effect.starting_points(context.system))) + _POINTS_PER_PARAMETER * len(effect.parameters)
    if changes_light(effect):
        if (largest := largest_field_count(context, effect)) < VERY_COSTLY_FIELDS:
            return points * (_UPSTREAM_COST * largest)
        few = _doubling_points(context, effect)[:_COSTLY_SCAN_POINTS]
        fields = [field_count(context, {effect.id: point}) for point in few]
        fitted = _POINTS_PER_PARAMETER * len(effect.parameters) * fields[len(fields) // 2]
        return _UPSTREAM_COST * (sum(fields) + fitted)
    on_camera = any(effect.overrides(hook) for hook in CAMERA_HOOKS)
    return points * (_CAMERA_POSE_COST if on_camera else _DOWNSTREAM_COST)


def is_dear(context: SearchContext, effect: Effect) -> bool:
    """Whether the search of an effect may take a large part of the budget of fields."""
    return search_cost(context, effect) > _DEAR_SHARE * usual_budget(context)


def usual_budget(context: SearchContext) -> float:
    """Fields of a search that isn't thorough, in pictures of this size."""
    return context.config.budget.fields_for(field_samples(context.data.captures, context.sampling))


def is_very_costly(context: SearchContext, fit: CandidateFit) -> bool:
    """Whether a prediction with these values adds very many fields."""
    return field_count(context, fit.values) >= VERY_COSTLY_FIELDS


def without_costly_fits(
    context: SearchContext, fits: Sequence[CandidateFit], comparison: Comparison
) -> list[CandidateFit]:
    """The fits in their order; of the costly fits only those that leave clearly less than all others.

    Lost contrast imitates every unknown error, so many fields are worth computing only where nothing simpler explains
    as much.
    """
    costly = {id(f): field_count(context, f.values) >= COSTLY_FIELDS for f in fits}
    if not any(costly.values()):
        return list(fits)
    left = {id(f): cost_or_inf(comparison, f.values) - comparison.pixel_count for f in fits}
    simple = [left[id(f)] for f in fits if not costly[id(f)]]
    by_chance = _COSTLY_CHANCE * comparison.pixel_count**0.5
    limit = max(_COSTLY_EXCESS_SHARE * min(simple, default=math.inf), by_chance)
    return [f for f in fits if left[id(f)] <= limit or not costly[id(f)]]


class SuggestedStarts:
    """The starting values of all kinds; each kind is looked for once, and only where an effect declares it."""

    def __init__(self, context: SearchContext, base: FittedValues, comparison: Comparison) -> None:
        self._context, self._base, self._comparison = context, base, comparison
        self._found: dict[StartKind, StartProvider] = {}

    def of(self, effects: Iterable[Effect], kinds: Collection[StartKind] = ALL_KINDS) -> StartProvider:
        """Starting values of some kinds for some effects. Quantities that effects share are computed here, not in each
        job."""
        for kind in {kind for effect in effects for kind in effect.start_kinds if kind in kinds} - self._found.keys():
            self._found[kind] = self._makers[kind]()
        return partial(_starts_of, {kind: found for kind, found in self._found.items() if kind in kinds})

    @cached_property
    def _fitted(self) -> GainFit:
        return self._comparison.fit_gains(self._base)

    @property
    def _makers(self) -> dict[StartKind, Callable[[], StartProvider]]:
        context, base, comparison = self._context, self._base, self._comparison
        return {
            StartKind.DISPLACEMENT: lambda: DisplacementStarts(base, comparison),
            StartKind.GHOST: lambda: GhostStarts(self._fitted, comparison),
            StartKind.SMEAR: lambda: SmearStarts(self._fitted, comparison),
            StartKind.CAMERA_FRINGES: lambda: FringeStarts(self._fitted, comparison),
            StartKind.MODULATOR_FRINGES: lambda: ModulatorFringeStarts(context, base, comparison),
            StartKind.PLANES: lambda: PlaneStarts(context, base),
            StartKind.STUCK_PIXELS: lambda: StuckStarts(context, base, comparison),
        }


def _starts_of(providers: Mapping[StartKind, StartProvider], effect: Effect) -> StartingValues:
    return [start for kind in effect.start_kinds if kind in providers for start in providers[kind](effect)]


EffectFitter = Callable[[Effect], CandidateFit]


@dataclass(frozen=True)
class Batch:
    """Fits of some effects of the queue, the best first. ends_round: whether the queue goes on with effects that cost
    much more, or with another method, so that the caller looks at the fits found first.
    """

    fits: Sequence[CandidateFit]
    ends_round: bool = False


_END_OF_ROUND = Batch((), ends_round=True)


def screen_effects(
    context: SearchContext, base: FittedValues, effects: Sequence[Effect], progress: ProgressCallback, note: str
) -> Iterator[Batch]:
    """The queue: batches of fits, each of one effect on top of `base`, with costs of one comparison.

    Fits that gain nothing are left out. With a small error of the model, and with a medium error beside other causes:
    the most promising effects by their derivatives, then scans if more than a little is left. With a medium error
    without other causes: local fits, then scans. With a large error: scans alone.
    """
    error = context.relative_model_error(base)
    screening = _Screening(context, base, error, progress, note)
    ordered = sorted({*effects}, key=lambda e: (search_cost(context, e), e.id))
    if error < (LOCAL_MAX_ERROR if base else TANGENT_MAX_ERROR):
        yield from screening.nearby_fits(ordered)
        yield _END_OF_ROUND
        unbiased = context.data_weighted_comparison(context.split.coarse, 0.0)
        if cost_or_inf(unbiased, base) < _NO_SCAN_CHI2 * unbiased.pixel_count:
            return
    elif error < LOCAL_MAX_ERROR:
        yield from screening.local_fits(ordered)
        yield _END_OF_ROUND
    yield from screening.range_fits(ordered)
    yield _END_OF_ROUND


def fit_over_range(
    context: SearchContext, base: FittedValues, effect: Effect, further_starts: Sequence[dict[str, float]]
) -> CandidateFit:
    """One effect on top of `base`, scanned over its range. further_starts: points beyond those that images suggest."""
    screening = _Screening(context, base, context.relative_model_error(base), no_progress, "")
    suggested = screening.starts.of([effect])
    return screening.fitter.scan_and_fit(lambda one: [*further_starts, *suggested(one)], effect)


@dataclass(frozen=True)
class _EffectFitter:
    """Fits one effect on top of a base; its methods are jobs, which a worker process can run.

    comparison: the coarse captures, on which fits are compared. scan_comparison: the few captures on which a scan is
    computed.
    """

    context: SearchContext
    base: FittedValues
    comparison: Comparison
    scan_comparison: Comparison

    def local_fit(self, effect: Effect, *, with_base: bool = False) -> CandidateFit:
        """A local fit from the identity; from a scan for an effect that is costly or has rival parameters.

        with_base: fit the base too, where no scan is needed.
        """
        if self._is_costly(effect):
            return self._fit_costly(effect, 1.0)
        if effect.has_rival_parameters:
            return self.scan_and_fit(_no_starts, effect)
        start = {**self.base, effect.id: identity_values(effect)}
        varied = [*(self._base_effects() if with_base else []), effect]
        fit = local_fit(varied, start, self.comparison, iterations=_LOCAL_ITERATIONS)
        return CandidateFit((*self.base, effect.id), fit.values, fit.cost)

    def _base_effects(self) -> list[Effect]:
        return [self.context.effects[name] for name in self.base]

    def nearby_fit(self, effect: Effect) -> CandidateFit:
        """A local fit from the identity, together with the base. Instead a fit over the effect's range, on top of the
        base, where some parameters show only together with others, or where an effect with a scan could imitate this
        effect.
        """
        is_imitated = any(effect.id in other.degenerate_limit for other in self.context.effects.values())
        if is_imitated or self._has_dormant_parameters(effect):
            return self.scan_and_fit(_no_starts, effect)
        return self.local_fit(effect, with_base=True)

    def _has_dormant_parameters(self, effect: Effect) -> bool:
        """Whether parameters have slopes where a scan begins, but none at the identity: a fit from the identity misses
        them. An example is the wavelength of a second line, which changes nothing while the line has no light.
        """
        first = next(iter(effect.starting_points(self.context.system)), None)
        asleep = ~self._moves_prediction(effect, identity_values(effect))
        return first is not None and bool(asleep.any()) and bool((asleep & self._moves_prediction(effect, first)).any())

    def _moves_prediction(self, effect: Effect, values: dict[str, float]) -> NDArray[np.bool_]:
        """Whether residuals depend, at these values, on each parameter of the effect that isn't fine."""
        at = {**self.base, effect.id: values}
        residual = self.scan_comparison.residual(at)
        slopes = effect_jacobian(effect, at, self.scan_comparison, residual)
        return np.asarray(slopes.any(axis=1))

    def scan_and_fit(self, starts: StartProvider, effect: Effect) -> CandidateFit:
        """A scan on a few captures, then local fits on all coarse captures. starts: further points beside the
        scan's."""
        if self._is_costly(effect):
            return self._fit_costly(effect, _COSTLY_MAX_COST)
        points = [*starts(effect), *effect.starting_points(self.context.system)]
        scan = scan_effect(effect, self.scan_comparison, self.base, points)
        if effect.has_rival_parameters:
            return fit_rival_parameters(effect, self.comparison, self.base, scan)
        first = find_hard_edges(effect, scan[0], self.scan_comparison)
        return fit_from_scan(effect, self.comparison, self.base, [first, *scan[1:]])

    def _is_costly(self, effect: Effect) -> bool:
        return largest_field_count(self.context, effect) >= COSTLY_FIELDS

    def tangent_space(self) -> NDArray[np.float32]:
        """Orthonormal changes (number, pixel) of the residuals by the base's own parameters."""
        residual, slopes = self.comparison.residual(self.base), [np.empty((0, 0), np.float32)]
        for effect in self._base_effects():
            slopes.append(effect_jacobian(effect, self.base, self.comparison, residual))
        if not any(len(rows) for rows in slopes):
            return np.empty((0, residual.size), np.float32)
        return _orthonormal(np.concatenate([rows for rows in slopes if len(rows)]))

    def tangent_gain(self, residual: NDArray[np.float32], base: NDArray[np.float32], effect: Effect) -> float:
        """The fall of Σ residual² by the effect, and the base with it, if residuals depend on them linearly.

        residual: with the base. base: its `tangent_space`. With derivatives J and residual r both projected onto its
        complement, the fall is gᵀ(JJᵀ)⁺g, g = J·r: beside a cause that stands for a part of the effect, the effect
        alone could gain little.
        """
        start = {**self.base, effect.id: identity_values(effect)}
        factor = _COSTLY_STEP_FACTOR if self._is_costly(effect) else 1.0
        slopes = effect_jacobian(effect, start, self.comparison, residual, step_factor=factor)
        shared = slopes @ base.T
        slopes -= shared @ base
        normal = (slopes @ slopes.T).astype(np.float64)
        right = (slopes @ residual).astype(np.float64)  # the part of the residual along the base is orthogonal to them
        return float(right @ np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right)

    def _fit_costly(self, effect: Effect, max_cost: float) -> CandidateFit:
        """The best of a few points, fitted once, on a few captures; of very many fields the smallest points first.

        The fit is begun only where a point leaves no more than a share `max_cost` of the cost without the effect.
        """
        if largest_field_count(self.context, effect) >= VERY_COSTLY_FIELDS:
            scan = scan_upwards(effect, self.scan_comparison, self.base, _doubling_points(self.context, effect))
        else:
            points, count = list(effect.starting_points(self.context.system)), _COSTLY_SCAN_POINTS
            points = [points[(2 * k + 1) * len(points) // (2 * count)] for k in range(count)]
            scan = scan_effect(effect, self.scan_comparison, self.base, points)
        if scan[0].cost > max_cost * cost_at_identity(scan, effect):
            return CandidateFit((*self.base, effect.id), scan[0].values, float("inf"))
        fit = fit_from_scan(effect, self.scan_comparison, self.base, scan, max_starts=1)
        return replace(fit, cost=cost_or_inf(self.comparison, fit.values))


def _orthonormal(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Orthonormal rows that span the given ones, which are overwritten: derivatives of large pictures take gigabytes.

    From the eigenvectors of their Gram matrix, in float64, of rows of length 1; some thousand columns at a time.
    """
    blocks = [slice(first, first + _BLOCK) for first in range(0, rows.shape[1], _BLOCK)]
    gram = np.zeros((len(rows), len(rows)))
    for block in blocks:
        part = rows[:, block].astype(np.float64)
        gram += part @ part.T
    lengths = np.sqrt(np.diag(gram))
    inverse = np.where(lengths > 0, 1.0 / np.where(lengths > 0, lengths, 1.0), 0.0)
    squares, vectors = np.linalg.eigh(gram * np.outer(inverse, inverse))
    kept = squares > _MIN_INDEPENDENCE * squares[-1]
    turn = (vectors[:, kept] / np.sqrt(squares[kept])).T * inverse
    for block in blocks:
        rows[: len(turn), block] = turn @ rows[:, block]
    return rows[: len(turn)]


class _Screening:
    """The rounds of one screening. error: relative error of the model with the base. starts: starting values that
    captures suggest.
    """

    def __init__(
        self, context: SearchContext, base: FittedValues, error: float, progress: ProgressCallback, note: str
    ) -> None:
        self._context, self._base, self._progress, self._note = context, base, progress, note
        coarse = context.split.coarse
        comparison = context.tolerant_comparison(coarse, error)
        few = spread_over_wavelengths(context.data.captures, coarse, SCAN_CAPTURES)
        self.fitter = _EffectFitter(context, base, comparison, context.tolerant_comparison(few, error))
        self._base_cost = cost_or_inf(comparison, base)
        self.starts = SuggestedStarts(context, base, comparison)

    def nearby_fits(self, effects: Sequence[Effect]) -> Iterator[Batch]:
        """Fits from starting values that residuals show without derivatives, then of the effects whose derivatives
        promise most, then of stuck pixels."""
        quick = [effect for effect in effects if not is_stuck_effect(effect)]
        seen, others = self._fits_of_seen(quick, _SEEN_KINDS)
        yield Batch(seen)
        promising, size = self._best_by_tangent(others), _TANGENT_FITS_AT_ONCE
        imitated = {name for effect in promising for name in effect.degenerate_limit} - {
            effect.id for effect in promising
        }
        promising = [*(effect for effect in others if effect.id in imitated), *promising]
        for first in range(0, len(promising), size):
            yield Batch(self._improving(self.fitter.nearby_fit, promising[first : first + size], ""))
        if any(is_stuck_effect(e) and is_dear(self._context, e) for e in effects):
            yield _END_OF_ROUND
        yield from self._fits_of_stuck(effects)

    def local_fits(self, effects: Sequence[Effect]) -> Iterator[Batch]:
        """Fits from starting values that residuals show without derivatives, then of all other effects from their
        identity; then, in a round of their own, of stuck pixels, which decorrelated speckle resembles."""
        seen, others = self._fits_of_seen([e for e in effects if not is_stuck_effect(e)], _SEEN_KINDS)
        yield Batch(seen)
        yield from self._in_batches(self.fitter.local_fit, others, "")
        yield _END_OF_ROUND
        yield from self._fits_of_stuck(effects)

    def range_fits(self, effects: Sequence[Effect]) -> Iterator[Batch]:
        """Fits from scans of the effects' ranges and from all starting values, errors of planes first: where there
        are any, correcting them leaves much less. Then, in a round of their own, of stuck pixels."""
        others = [e for e in effects if not is_stuck_effect(e)]
        starts = self.starts.of(others)
        planes = self.starts.of(others, {StartKind.PLANES})
        found_first = sorted(others, key=lambda e: not planes(e))
        yield from self._in_batches(partial(self.fitter.scan_and_fit, starts), found_first, ", over its range")
        yield _END_OF_ROUND
        yield from self._fits_of_stuck(effects)

    def _in_batches(self, fit: EffectFitter, effects: Sequence[Effect], note: str) -> Iterator[Batch]:
        """Fits of all effects, batch after batch; a round ends before the first costly search."""
        dear = [e for e in effects if is_dear(self._context, e)]
        size = self._context.config.budget.effects_per_batch
        for part in ([e for e in effects if e not in dear], dear):
            for first in range(0, len(part), size):
                if first and self._context.screening_exhausted:
                    return
                yield Batch(self._improving(fit, part[first : first + size], note))
            if part and dear and part is not dear:
                yield _END_OF_ROUND

    def _fits_of_stuck(self, effects: Sequence[Effect]) -> Iterator[Batch]:
        """Fits of stuck pixels, where the captures suggest any."""
        stuck = [e for e in effects if is_stuck_effect(e)]
        if stuck and not self._context.screening_exhausted:
            yield Batch(self._fits_of_seen(stuck, {StartKind.STUCK_PIXELS})[0])

    def _fits_of_seen(
        self, effects: Sequence[Effect], kinds: Collection[StartKind]
    ) -> tuple[list[CandidateFit], list[Effect]]:
        """Fits of the effects for which residuals show starting values of some kinds, and the other effects."""
        starts = self.starts.of(effects, kinds)
        seen = [e for e in effects if starts(e)]
        fits = self._improving(partial(self.fitter.scan_and_fit, starts), seen, "")
        return fits, [e for e in effects if e not in seen]

    @cached_property
    def _tangent_gain(self) -> Callable[[Effect], float]:
        return partial(
            self.fitter.tangent_gain, self.fitter.comparison.residual(self._base), self.fitter.tangent_space()
        )

    def _best_by_tangent(self, effects: Sequence[Effect]) -> list[Effect]:
        """The effects whose derivatives explain most, the best first. Effects of very many fields are looked at only
        where no other effect explains much."""
        context = self._context
        many = [e for e in effects if largest_field_count(context, e) >= VERY_COSTLY_FIELDS]
        gains: dict[Effect, float] = {}
        for some in ([e for e in effects if e not in many], many):
            if max(gains.values(), default=0.0) < _DECISIVE_TANGENT_GAIN * self._base_cost:
                found = context.map_effects(self._tangent_gain, some, self._progress, f"{self._note}, tangents")
                gains |= dict(zip(some, found, strict=True))
        return [e for e in sorted(gains, key=lambda e: -gains[e])[:_TANGENT_FITS] if gains[e] > 0]

    def _improving(self, fit: EffectFitter, effects: Sequence[Effect], note: str) -> list[CandidateFit]:
        """Fits of some effects that cost less than the base, the best first."""
        fits = self._context.map_effects(fit, effects, self._progress, self._note + note)
        return sorted((f for f in fits if f.cost < self._base_cost), key=lambda f: f.cost)


def _no_starts(effect: Effect) -> list[dict[str, float]]:
    return []
