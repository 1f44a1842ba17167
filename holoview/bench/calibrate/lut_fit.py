"""Fits a modulator's look-up table, the phase of each grey level, to measured sweeps of the level.

fit_lut        the table of one or several sweeps: periods of the grating, wavelengths, orders
fit_labelled   the same for sweeps whose files or options say what they are
Lut            the table, with its interval and whether anything fits

With x the distance of a level from the reference level (0 … 1), the power of a spot is

    P(x) = b + a·(1 + c·f·φ(x))·sin²((f·φ(x) − φ₁)/2),   φ(0) = 0,   φ monotone.

A binary phase grating with equal bars of phases 0 and φ sends the share (4/π²)·sin²(φ/2) of the light into each first
order and cos²(φ/2) into the zero order (Goodman, Introduction to Fourier Optics, 3rd ed., sec. 4.4.3):

first order      φ₁ = 0: dark at the reference level
zero order       φ₁ = π: brightest at the reference level
interferometer   φ₁ free: two halves of a modulator as mirrors, whose paths differ by any phase

a: full power. b: stray light of any size. c: change of the full power with the phase, which fringing fields between
bars cause; it is fitted where Schwarz's criterion prefers the model with it. So is a change in proportion to x instead,
as a laser makes it that drifts during a sweep. f: phase at another wavelength relative to
the first one. φ is a cubic spline whose coefficients never fall, so that it never falls either (Ramsay, Stat. Sci. 3,
425 (1988)); half of its knots are equidistant in level and half in phase.

sin² doesn't distinguish φ from 2π − φ, so that the least-squares problem has many local minima. It is started from the
monotone paths of phases with the lowest costs, which dynamic programming finds exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import least_squares

from holoview.bench.calibrate.sweep import Floats, LabelledSweep, Order, Sweep
from holoview.util.errors import UserError

ORDER_NAMES: dict[Order, str] = {"1": "first order", "0": "zero order", "interferometer": "interferometer"}

_KNOTS = (8, 12, 16, 24, 32)  # numbers tried; the spread of the stroke over them is in its interval
_ROUGH_KNOTS = 16
_MAX_STROKE_TURNS = 4.0
_PHASE_STATES = 241  # of the dynamic programme
_JUMP_PENALTY = 0.05  # cost of a phase step of 1 rad, as a share of the range of the power
_FULL_POWERS = (0.97, 1.04, 1.12)  # of the range of the power, tried by the dynamic programme
_SLOPE_BOUNDS, _DRIFTS = (-0.1, 1.0), (-0.5, 0.5)  # 1/rad; along a sweep
_SLOPES = (-0.03, 0.0, 0.06, 0.2)  # per radian, tried by the dynamic programme
UNSEEN_SLOPE = 0.05
"""Change of the full power, 1/rad, whose effect `FittedLut.unseen_shift` tells: measured ones are 0.02 to 0.2."""
_FACTORS = tuple(np.geomspace(0.35, 2.8, 64).tolist())  # between wavelengths, to begin with
_MIN_STEP = 1e-6  # rad between knots, because a modulator's levels must be strictly ascending
_AT_AN_END = 0.3  # share of the range within which the reference reading is taken as an end of it
_NEAR_AN_END = 0.12  # the same for a sweep that shows one turning point, where nothing else tells
_FLAT = 0.02  # share of the range from an end of it, beyond which a start phase may be free
_SLOPE_RESIDUAL = 0.012  # of the range, from which a changing full power is tried where it needn't show
_AS_GOOD = 1.25  # ratio of residuals up to which the simpler of two explanations is kept
_RIVAL = 2.5  # ratio of residuals up to which another model's stroke is in the interval
_WORST_RESIDUAL = 0.03  # of the range: errors of 0.06 rad where sin² is steepest; twelve real sweeps leave 0.013
_SHARED_RESIDUAL = 0.02  # of the range, that a table of coarser gratings may leave
_NOISE_FACTOR = 1.5  # a residual up to this multiple of the readings' noise is noise
_LEAST_EXPLAINED = 0.9  # of the variance of the power


@dataclass(frozen=True, eq=False)
class SweepFit:
    """A sweep as the fitted table predicts it.

    power: (n,), in the sweep's unit. residual: r.m.s. of measured minus fitted power over the range of the power.
    slope: c, 1/rad; 0 where it wasn't fitted. drift: change of the full power along the sweep instead. start: φ₁, rad.
    factor: f. full_power, stray: a and b, in the sweep's unit.
    """

    sweep: Sweep
    power: Floats
    residual: float
    slope: float
    drift: float
    start: float
    factor: float
    full_power: float
    stray: float

    @property
    def most_residual(self) -> float:
        """The residual up to which the sweep counts as explained."""
        return max(_WORST_RESIDUAL, _NOISE_FACTOR * self.sweep.noise / self.sweep.range)

    @property
    def unexplained(self) -> float:
        """Share of the power's variance that is left."""
        return (self.residual * self.sweep.range) ** 2 / float(self.sweep.power.var())

    @property
    def is_explained(self) -> bool:
        """Whether little enough is left for a table."""
        return self.residual <= self.most_residual and self.unexplained <= 1 - _LEAST_EXPLAINED


@dataclass(frozen=True, eq=False)
class FittedLut:
    """A fitted look-up table.

    levels: (n,), those of the first sweep, ascending. phase: (n,), rad: distance from the phase of the reference level,
    at the first sweep's wavelength. order: of the spot. reason: why, as a clause. stroke_interval: 95 % confidence
    interval of the greatest phase, rad; it allows for the noise and for the choice of the model. fits: one entry for
    each sweep. unseen_shift: of the stroke, rad, if the full power changed by 5 % a radian, where a sweep shows it once
    only and can't tell; else None. linear_2pi, linear_free: residuals of the first sweep for a phase that is linear in
    the level, with a stroke of 2π and with the best stroke.
    """

    levels: Floats
    phase: Floats
    order: Order
    reason: str
    stroke_interval: tuple[float, float]
    fits: tuple[SweepFit, ...]
    unseen_shift: float | None
    linear_2pi: float
    linear_free: float

    @property
    def stroke(self) -> float:
        """Greatest phase, rad."""
        return float(self.phase.max())

    @property
    def explains(self) -> bool:
        """Whether the model explains all sweeps; if it doesn't, `phase` is nothing to build on."""
        return all(fit.is_explained for fit in self.fits)

    def check(self, remedy: str = "") -> None:
        """Raises UserError about the worst sweep where the model doesn't explain all of them."""
        wrong = [fit for fit in self.fits if not fit.is_explained]
        if not wrong:
            return
        worst = max(wrong, key=lambda fit: (fit.unexplained, fit.residual))
        left = f"{worst.residual:.2g} of the power's range and {worst.unexplained:.1%} of its variance"
        most = f"at most {worst.most_residual:.2g} of the range and {1 - _LEAST_EXPLAINED:.0%} of the variance"
        raise UserError(
            worst.sweep.name, f"no monotone phase explains the readings: {left} are left", expected=most, remedy=remedy
        )

    @property
    def residual(self) -> float:
        """Root mean square of the sweeps' residuals."""
        return math.sqrt(sum(fit.residual**2 for fit in self.fits) / len(self.fits))

    @property
    def stroke_fractions(self) -> Floats:
        """The phase at each level divided by the stroke, rising from 0 to 1, (n,): a modulator's `levels`.

        Where the reference is the highest level, the phase is taken to rise towards it.
        """
        rising = self.phase if self.phase[-1] > self.phase[0] else self.phase.max() - self.phase
        return rising / self.stroke

    def stroke_m(self, wavelength_m: float) -> float:
        """Stroke as an optical path difference, if the first sweep was measured at this wavelength."""
        return self.stroke * wavelength_m / (2 * math.pi)

    def phase_at(self, levels: Floats) -> Floats:
        """The phase at other levels, rad, NaN outside those that were measured."""
        inside: Floats = np.interp(levels, self.levels, self.phase, left=math.nan, right=math.nan)
        return inside


def fit_lut(
    sweeps: Sweep | Sequence[Sweep],
    order: Order | Sequence[Order] | None = None,
    groups: Sequence[int] | None = None,
) -> FittedLut:
    """Fits one table to all sweeps.

    order: of the spot whose power was read, one for all sweeps or one for each; recognised when None. groups: for each
    sweep the number of its wavelength, 0 for that of the first; all are of one wavelength when None.

    Raises UserError if the power of the first or zero order has no turning point inside a sweep: then the phase stays
    below π, and the full power and the phase can't be determined separately; for an interferometer if it has fewer
    than two; and for sweeps over different ranges of levels.
    """
    sweeps = [sweeps] if isinstance(sweeps, Sweep) else list(sweeps)
    groups = [0] * len(sweeps) if groups is None else list(groups)
    first = sweeps[0]
    for other in sweeps[1:]:
        if abs(other.levels[0] - first.levels[0]) + abs(other.levels[-1] - first.levels[-1]) > 0.02 * np.ptp(
            first.levels
        ):
            found = f"levels {other.levels[0]:g} to {other.levels[-1]:g}"
            expected = f"{first.levels[0]:g} to {first.levels[-1]:g}, as {first.name}"
            raise UserError(other.name, found, expected=expected)
    is_free, reason = order is None, "as stated"
    if order is None:
        sweeps, order, reason = _recognised(sweeps)
    orders: list[Order] = [order] * len(sweeps) if isinstance(order, str) else list(order)
    for sweep, own in zip(sweeps, orders, strict=True):
        _check_turns(sweep, own)
    best, rivals = _best_fit(sweeps, orders, groups)
    if orders[0] != "interferometer" and is_free and _is_off(sweeps[0]):
        free: list[Order] = ["interferometer"] * len(sweeps)
        rivals += [rival for rival in _best_fit(sweeps, free, groups)[1] if rival.residual < best.residual]
    others = [rival.stroke for rival in rivals]
    margin = 1.96 * best.stroke_sigma
    fits = best.sweep_fits()
    linear = [
        _linear_residual(first, orders[0], float(stroke))
        for stroke in np.arange(0.2, 2 * _MAX_STROKE_TURNS, 0.004) * math.pi
    ]
    return FittedLut(
        levels=sweeps[0].levels,
        phase=best.phase_of(sweeps[0]),
        order=orders[0],
        reason=reason,
        stroke_interval=(max(min(others) - margin, 0.0), max(others) + margin),
        fits=fits,
        unseen_shift=_unseen_shift(best),
        linear_2pi=_linear_residual(first, orders[0], 2 * math.pi),
        linear_free=min(linear),
    )


@dataclass(frozen=True, eq=False)
class LabelledFit:
    """A table, the sweeps that it was fitted to, and sentences on those that were left out."""

    lut: FittedLut
    sweeps: list[LabelledSweep]
    notes: list[str]


def fit_labelled(labelled: Sequence[LabelledSweep]) -> LabelledFit:
    """One table of all sweeps, each with its order, if these are known, and in the group of its wavelength.

    Beside first orders the zero order has a free start phase, because light that isn't modulated shifts it. Of several
    sweeps whose orders are known, those that don't show their full power are left out, and those that the table of the
    coarsest gratings doesn't describe: there the edges of bars count, which that table hardly contains. Raises as
    `fit_lut` does.
    """
    orders: list[Order] = [one.order for one in labelled if one.order is not None]
    if orders and len(orders) < len(labelled):
        raise UserError("--order", f"known of {len(orders)} of {len(labelled)} sweeps", expected="all or none")
    if orders and "1" in orders:
        orders = ["interferometer" if order == "0" else order for order in orders]
    kept, kept_orders, notes = list(labelled), orders, list[str]()
    if len(orders) > 1:
        errors = [_unseen_power(one.sweep, order) for one, order in zip(labelled, orders, strict=True)]
        kept = [one for one, error in zip(labelled, errors, strict=True) if error is None]
        kept_orders = [order for order, error in zip(orders, errors, strict=True) if error is None]
        if not kept:
            raise next(error for error in errors if error is not None)
        notes = [f"left out: {error}" for error in errors if error is not None]
        kept, kept_orders, differing = _sharing(kept, kept_orders)
        notes += differing
    wavelengths = [one.wavelength_m for one in kept]
    groups = [sorted(set(wavelengths), key=wavelengths.index).index(value) for value in wavelengths]
    return LabelledFit(fit_lut([one.sweep for one in kept], kept_orders or None, groups), kept, notes)


def _sharing(labelled: list[LabelledSweep], orders: list[Order]) -> tuple[list[LabelledSweep], list[Order], list[str]]:
    """The sweeps that share the table of the coarsest gratings, with their orders, and sentences on the others."""
    core: dict[float | None, int] = {}
    for index, one in enumerate(labelled):
        best = core.get(one.wavelength_m)
        is_coarser = best is not None and (one.period_px or 0) > (labelled[best].period_px or 0)
        if orders[index] == orders[0] and (best is None or is_coarser):
            core[one.wavelength_m] = index
    places = list(core.values())
    if len(places) == len(labelled) or any(one.period_px is None for one in labelled):
        return labelled, orders, []
    lut = fit_lut([labelled[k].sweep for k in places], [orders[k] for k in places], range(len(places)))
    factors = {wavelength: fit.factor for wavelength, fit in zip(core, lut.fits, strict=True)}
    kept, notes = [], list[str]()
    for index, (one, order) in enumerate(zip(labelled, orders, strict=True)):
        if index in places or one.wavelength_m not in factors:
            kept.append(index)
            continue
        phase = factors[one.wavelength_m] * np.interp(one.sweep.levels, lut.levels, lut.phase)
        residual = _residual_of_phase(one.sweep, order, phase)
        if residual <= max(_SHARED_RESIDUAL, _RIVAL * lut.residual, _NOISE_FACTOR * one.sweep.noise / one.sweep.range):
            kept.append(index)
        else:
            notes.append(f"{one.label} ({100 * residual:.2g} %)")
    if notes:
        why = "left out, because the table of the coarsest grating leaves that much of their range (fields across the "
        notes = [f"{why}bars' edges count, or other light): {'; '.join(notes)}"]
    return [labelled[k] for k in kept], [orders[k] for k in kept], notes


def _residual_of_phase(sweep: Sweep, order: Order, phase: Floats) -> float:
    """What phases (n,) of a sweep leave of its power with the best a, b and c or φ₁, r.m.s. as a share of its range."""
    if order == "interferometer":
        parts = [np.ones(len(phase)), np.cos(phase), np.sin(phase)]
    else:
        share = np.sin((phase - _start_of(sweep, order)) / 2) ** 2
        parts = [np.ones(len(phase)), share, phase * share]
    design = np.stack(parts, axis=1)
    left = sweep.power - design @ np.linalg.lstsq(design, sweep.power, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2))) / sweep.range


def _unseen_power(sweep: Sweep, order: Order) -> UserError | None:
    """Why a sweep doesn't show its full power; None where it does."""
    try:
        _check_turns(sweep, order)
    except UserError as error:
        return error
    return None


def known_labels(labelled: Sequence[LabelledSweep]) -> tuple[list[float], list[float]]:
    """Wavelengths (m) and periods (pixels) of all sweeps; none where none is known. Raises UserError for some."""
    labels = ("wavelength", [one.wavelength_m for one in labelled]), ("period", [one.period_px for one in labelled])
    found: list[list[float]] = []
    for name, values in labels:
        known = [value for value in values if value is not None]
        if known and len(known) < len(values):
            raise UserError(f"--{name}", f"known of {len(known)} of {len(values)} sweeps", expected="all or none")
        found.append(known)
    return found[0], found[1]


# --- which spot was read ----------------------------------------------------------------------------------------------


def _recognised(sweeps: list[Sweep]) -> tuple[list[Sweep], Order, str]:
    """The sweeps with their reference level, the order of the spot, and the reason.

    The reference level tells: there a grating is flat, its first order dark and its zero order brightest.
    """
    sweep = sweeps[0]
    if sweep.power.min() < -_AT_AN_END * sweep.range:
        return sweeps, "interferometer", "the readings are negative in part, as only differences of powers are"
    turned = [replace(other, starts_high=not other.starts_high) for other in sweeps]
    here, there = _height(sweep), _height(turned[0])
    share = f"at the reference level {_reference(sweep):g} the power is at {100 * here:.0f} % of its range"
    if min(here, 1 - here) < (_AT_AN_END if _turns(sweep) > 1 else _NEAR_AN_END):
        order: Order = "1" if here < 0.5 else "0"
        if _is_off(sweep):
            tried: tuple[Order, ...] = (order, "interferometer")
            count = len(sweeps)
            fixed, free = (_best_fit(sweeps, [name] * count, [0] * count)[0].residual for name in tried)
            if fixed > _AS_GOOD * free:
                reason = f"{share}, and a free start phase leaves {fixed / free:.1f} times less"
                return sweeps, "interferometer", reason
        return sweeps, order, share
    if min(there, 1 - there) < _FLAT and not _is_off(turned[0]):
        end = f"at level {_reference(turned[0]):g} the power is at {100 * there:.0f} % of its range"
        return turned, "1" if there < 0.5 else "0", f"{end}, at the other end at {100 * here:.0f} %"
    return sweeps, "interferometer", f"{share}, as behind no flat grating"


def _is_off(sweep: Sweep) -> bool:
    """Whether the power at the reference level isn't quite an end of its range, in a sweep that shows both ends."""
    height = _height(sweep)
    off = min(height, 1 - height)
    return _turns(sweep) >= 2 and off > max(_FLAT, 4 * sweep.noise / sweep.range)


def _reference(sweep: Sweep) -> float:
    return float(sweep.levels[-1] if sweep.starts_high else sweep.levels[0])


def _height(sweep: Sweep) -> float:
    """The power at the reference level as a share of its range, from a few readings there."""
    count = max(1, len(sweep.power) // 64)
    nearest = np.argsort(sweep.distance, kind="stable")[:count]
    return float((sweep.power[nearest].mean() - sweep.power.min()) / sweep.range)


def _smooth(sweep: Sweep) -> Floats:
    """The power from the reference level on, as means over a few readings."""
    width = max(1, len(sweep.power) // 32)
    ordered = sweep.power[np.argsort(sweep.distance, kind="stable")]
    return np.convolve(ordered, np.ones(width) / width, mode="valid")


def _turns(sweep: Sweep) -> int:
    """The number of turning points of the power inside the sweep that stand out of its noise."""
    smooth, turns, direction = _smooth(sweep), 0, 0
    hysteresis = max(0.02 * sweep.range, 3 * sweep.noise)
    low = high = smooth[0]
    for value in smooth:
        low, high = min(low, value), max(high, value)
        if value < high - hysteresis and direction != -1:
            turned = -1
        elif value > low + hysteresis and direction != 1:
            turned = 1
        else:
            continue
        turns += direction != 0
        direction, low, high = turned, value, value
    return turns


def _check_turns(sweep: Sweep, order: Order) -> None:
    """Raises UserError if the sweep doesn't show the full power of its spot."""
    if order == "interferometer":
        ends = _turns(sweep) + (min(_height(sweep), 1 - _height(sweep)) < 0.1)
        if ends < 2:
            found = f"the power reaches {ends} of the two ends of its fringes"
            expected = "at least a greatest and a least power inside the sweep, which show the contrast of its fringes"
            raise UserError(
                sweep.name, found, expected=expected, remedy="drive further or measure at a shorter wavelength"
            )
        return
    if _turns(sweep) == 0:
        how = "rises to its end, without a maximum" if order == "1" else "falls to its end, without a minimum"
        raise UserError(
            sweep.name,
            f"the power {how}",
            expected="a phase of more than π at the last level",
            remedy="drive further or measure at a shorter wavelength: below π the full power isn't known",
        )


# --- the fit ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Unknowns:
    """Where each unknown stands in the vector u: steps of the phase, then for each sweep a, b, c, φ₁, then factors f.

    a and b are relative to the range of the sweep's power.
    """

    steps: int
    sweeps: int
    factors: int

    def of_sweep(self, index: int) -> int:
        """Place of a sweep's a; b, c and φ₁ follow."""
        return self.steps + 4 * index

    def factor(self, group: int) -> int | None:
        """Place of a group's factor; None for the first group, whose factor is 1."""
        return self.steps + 4 * self.sweeps + group - 1 if group else None

    @property
    def count(self) -> int:
        """Length of u."""
        return self.steps + 4 * self.sweeps + self.factors


@dataclass(frozen=True, eq=False)
class _Begin:
    """Where a fit begins. path: (n,) phases at the first sweep's levels. starts: φ₁ of each sweep. factors: f of each
    group."""

    path: Floats
    starts: Sequence[float]
    factors: Sequence[float]


class _Fit:
    """A bounded least-squares fit of one spline to sweeps."""

    def __init__(
        self,
        sweeps: Sequence[Sweep],
        orders: Sequence[Order],
        groups: Sequence[int],
        knots: Floats,
        begin: _Begin,
        *,
        slope: float | None = 0.0,
        drifts: bool = False,
    ) -> None:
        """knots: (steps + 1,) distances from 0 to 1. slope: c; fitted when None. drifts: whether c is the change of the
        full power along the sweep instead of that with the phase."""
        self.drifts = drifts
        self.sweeps, self.orders, self.groups, self.knots = sweeps, orders, groups, knots
        degree = min(3, len(knots) - 1)
        inner = np.concatenate([[0.0] * (degree + 1), knots[1:-1], [1.0] * (degree + 1)])
        self._spline = inner, degree
        bases = [self._basis(sweep.distance) for sweep in sweeps]
        self._bases, self._u = bases, _Unknowns(bases[0].shape[1], len(sweeps), max(groups))
        self._weights = [_weights(sweep) for sweep in sweeps]
        u0, low, high = self._start(begin, slope)
        varied = high > low
        u0 = np.clip(u0, low, high)

        def filled(v: Floats) -> Floats:
            u = u0.copy()
            u[varied] = v
            return u

        gap = 1e-9 * (high - low)[varied]
        solution = least_squares(
            lambda v: self._residuals(filled(v)),
            np.clip(u0[varied], low[varied] + gap, high[varied] - gap),
            jac=lambda v: self._jacobian(filled(v))[:, varied],
            bounds=(low[varied], high[varied]),
            x_scale="jac",
            ftol=1e-8,
            xtol=1e-8,
            max_nfev=200,
        )
        self.u = filled(solution.x)
        self.free = np.zeros(self._u.count, bool)
        near = 1e-6 * np.maximum(np.minimum((high - low)[varied], 1.0), 1e-6)
        self.free[varied] = (solution.x > low[varied] + near) & (solution.x < high[varied] - near)
        self._solution_residuals = self._residuals(self.u)
        self.unknowns = int(varied.sum())

    def _start(self, begin: _Begin, slope: float | None) -> tuple[Floats, Floats, Floats]:
        """First values and bounds of all unknowns; those that aren't varied have equal bounds."""
        u, first = self._u, self.sweeps[0]
        ordered = np.argsort(first.distance)
        at_knots = np.interp(_greville(*self._spline), first.distance[ordered], begin.path[ordered])
        u0, low, high = (np.zeros(u.count) for _ in range(3))
        u0[: u.steps] = np.clip(np.diff(at_knots), 10 * _MIN_STEP, None)
        low[: u.steps], high[: u.steps] = _MIN_STEP, 2 * math.pi * _MAX_STROKE_TURNS
        for index, (sweep, start) in enumerate(zip(self.sweeps, begin.starts, strict=True)):
            k = u.of_sweep(index)
            u0[k : k + 4] = 0.97, float(sweep.power.min()) / sweep.range, slope or 0.0, start
            low[k], high[k] = 0.05, 5.0
            low[k + 1], high[k + 1] = u0[k + 1] - 1.0, u0[k + 1] + 1.0
            low[k + 2], high[k + 2] = (_DRIFTS if self.drifts else _SLOPE_BOUNDS) if slope is None else (slope, slope)
            is_free = self.orders[index] == "interferometer"
            low[k + 3], high[k + 3] = (start - math.pi / 2, start + math.pi / 2) if is_free else (start, start)
        for group in range(1, u.factors + 1):
            place = u.factor(group)
            assert place is not None
            u0[place], low[place], high[place] = begin.factors[group], 0.2, 5.0
        return u0, low, high

    def _basis(self, distance: Floats) -> Floats:
        """φ = basis·steps: sums of the B-splines behind each step."""
        knots, degree = self._spline
        design = BSpline.design_matrix(np.clip(distance, 0.0, 1.0), knots, degree).toarray()
        sums: Floats = np.cumsum(design[:, ::-1], axis=1)[:, ::-1]
        return sums[:, 1:]

    def _parts(self, u: Floats, index: int) -> tuple[float, float, float, float, float, Floats]:
        k, place = self._u.of_sweep(index), self._u.factor(self.groups[index])
        a, b, c, start = (float(value) for value in u[k : k + 4])
        factor = 1.0 if place is None else float(u[place])
        return a, b, c, start, factor, self._bases[index] @ u[: self._u.steps]

    def _envelope(self, index: int, c: float, phase: Floats) -> Floats:
        """The full power at the phases (n,) of a sweep, relative to that at the reference level."""
        return 1 + c * (self.sweeps[index].distance if self.drifts else phase)

    def _residuals(self, u: Floats) -> Floats:
        rows = []
        for index, sweep in enumerate(self.sweeps):
            a, b, c, start, f, phase = self._parts(u, index)
            power = b + a * self._envelope(index, c, f * phase) * np.sin((f * phase - start) / 2) ** 2
            rows.append(self._weights[index] * (power - sweep.power / sweep.range))
        return np.concatenate(rows)

    def _jacobian(self, u: Floats) -> Floats:
        rows = []
        for index, sweep in enumerate(self.sweeps):
            a, _, c, start, f, phase = self._parts(u, index)
            share, envelope = np.sin((f * phase - start) / 2) ** 2, self._envelope(index, c, f * phase)
            half_sine = np.sin(f * phase - start) / 2
            by_angle = a * ((0.0 if self.drifts else c * share) + envelope * half_sine)  # derivative by f·φ
            along = self.sweeps[index].distance if self.drifts else f * phase
            part = np.zeros((len(sweep.power), self._u.count))
            part[:, : self._u.steps] = (f * by_angle)[:, None] * self._bases[index]
            k, place = self._u.of_sweep(index), self._u.factor(self.groups[index])
            part[:, k], part[:, k + 1] = envelope * share, 1.0
            part[:, k + 2], part[:, k + 3] = a * along * share, -a * envelope * half_sine
            if place is not None:
                part[:, place] = by_angle * phase
            rows.append(self._weights[index][:, None] * part)
        return np.concatenate(rows)

    def phase_of(self, sweep: Sweep) -> Floats:
        """The phase at a sweep's levels, rad, strictly monotone in the distance from the reference, where it is 0."""
        phase = self._basis(sweep.distance) @ self.u[: self._u.steps]
        return phase + _MIN_STEP * 1e-3 * len(phase) * sweep.distance - float(phase[sweep.distance.argmin()])

    @property
    def end(self) -> _Begin:
        """Where it ended, for another fit to begin."""
        fits = self.sweep_fits()
        factors = [
            next(fit.factor for fit, own in zip(fits, self.groups, strict=True) if own == group)
            for group in range(max(self.groups) + 1)
        ]
        return _Begin(self.phase_of(self.sweeps[0]), [fit.start for fit in fits], factors)

    @property
    def stroke(self) -> float:
        """Phase at the end, rad."""
        return float(self.u[: self._u.steps].sum())

    @property
    def residual(self) -> float:
        """R.m.s. of the weighted residuals, as shares of the range."""
        return float(np.sqrt(np.mean(self._solution_residuals**2)))

    def bic(self, independent: float) -> float:
        """Schwarz's Bayesian information criterion (Ann. Statist. 6, 461 (1978)); an r.m.s. below 1e-6 counts as 1e-6.

        independent: share of the readings whose residuals are independent.
        """
        count = max(len(self._solution_residuals) * independent, 2.0)
        return 2 * count * math.log(max(self.residual, 1e-6)) + self.unknowns * math.log(count)

    @property
    def independent(self) -> float:
        """(1 − ρ)/(1 + ρ) of residuals that are correlated with their neighbours by ρ."""
        residual = self._solution_residuals
        if not residual.std():
            return 1.0
        correlation = float(np.clip(np.corrcoef(residual[:-1], residual[1:])[0, 1], 0.0, 0.95))
        return (1 - correlation) / (1 + correlation)

    @property
    def stroke_sigma(self) -> float:
        """Standard deviation of the stroke from the residuals, rad."""
        jacobian, residual = self._jacobian(self.u)[:, self.free], self._solution_residuals
        variance = float(residual @ residual) / max(1, len(residual) - int(self.free.sum()))
        covariance = np.linalg.pinv(jacobian.T @ jacobian)
        is_step = (np.arange(len(self.free)) < self._u.steps)[self.free].astype(np.float64)
        return math.sqrt(float(is_step @ covariance @ is_step) * variance / self.independent)

    def sweep_fits(self) -> tuple[SweepFit, ...]:
        """Each sweep as the fit predicts it."""
        fits = []
        for index, sweep in enumerate(self.sweeps):
            a, b, c, start, f, phase = self._parts(self.u, index)
            share = np.sin((f * phase - start) / 2) ** 2
            power = sweep.range * (b + a * self._envelope(index, c, f * phase) * share)
            residual = float(np.sqrt(np.mean((power - sweep.power) ** 2))) / sweep.range
            slope, drift = (0.0, c) if self.drifts else (c, 0.0)
            fits.append(SweepFit(sweep, power, residual, slope, drift, start, f, a * sweep.range, b * sweep.range))
        return tuple(fits)


def _greville(knots: Floats, degree: int) -> Floats:
    """Where the coefficients of a spline act: means of as many knots as its degree."""
    return np.array([knots[k + 1 : k + 1 + degree].mean() for k in range(len(knots) - degree - 1)])


def _weights(sweep: Sweep) -> Floats:
    """Weights of the readings, 1 on average, from their standard errors where these are known."""
    if sweep.deviation is None:
        return np.ones(len(sweep.power))
    weights = 1 / sweep.deviation
    return weights / math.sqrt(float(np.mean(weights**2)))


def _best_fit(sweeps: Sequence[Sweep], orders: Sequence[Order], groups: Sequence[int]) -> tuple[_Fit, list[_Fit]]:
    """The fit that Schwarz's criterion prefers, and all that fit about as well, itself among them."""
    slopes: tuple[float | None, ...] = (0.0, None) if _shows_slopes(sweeps, orders) else (0.0,)

    def fit(count: int, begin: _Begin, slope: float | None, *, drifts: bool = False) -> _Fit:
        knots = _knots(sweeps[0], count, begin.path)
        return _Fit(sweeps, orders, groups, knots, begin, slope=slope, drifts=drifts)

    most = max(len(sweeps[0].power) // 3, 4)
    paths = _paths(sweeps[0], orders[0])
    begins = [_begin(sweeps, orders, groups, path, start) for path, start in paths]
    rough = [fit(min(_ROUGH_KNOTS, most), begin, slope) for begin in begins for slope in slopes]
    noise = max(sweep.noise / sweep.range for sweep in sweeps)
    if None not in slopes and min(one.residual for one in rough) > max(_RIVAL * noise, _SLOPE_RESIDUAL):
        slopes = (0.0, None)  # a full power that is the same everywhere doesn't fit
        rough += [fit(min(_ROUGH_KNOTS, most), begin, None) for begin in begins]
    enough = _AS_GOOD * min(candidate.residual for candidate in rough)
    leader = min((candidate for candidate in rough if candidate.residual <= enough), key=lambda c: c.stroke)
    counts = sorted({min(count, most) for count in _KNOTS})
    fits = [fit(count, leader.end, slope) for count in counts for slope in slopes]
    if None in slopes:
        fits += [fit(count, leader.end, None, drifts=True) for count in counts]
    independent = min(fits, key=lambda candidate: candidate.residual).independent
    best = min(fits, key=lambda candidate: candidate.bic(independent))
    return best, [candidate for candidate in fits if candidate.residual <= _RIVAL * best.residual]


def _shows_slopes(sweeps: Sequence[Sweep], orders: Sequence[Order]) -> bool:
    """Whether a sweep shows its full power more than once, so that changes of it can be told from the phase."""
    return any(_full_powers(sweep, order) > 1 for sweep, order in zip(sweeps, orders, strict=True))


def _unseen_shift(best: _Fit) -> float | None:
    """The change of the stroke by a slope of the full power that the sweeps can't show; None where they show it."""
    if "interferometer" in best.orders or _shows_slopes(best.sweeps, best.orders):
        return None
    changed = _Fit(best.sweeps, best.orders, best.groups, best.knots, best.end, slope=UNSEEN_SLOPE)
    return changed.stroke - best.stroke


def _full_powers(sweep: Sweep, order: Order) -> int:
    """How many times the power turns at its greatest, the reference of a zero order among them: with one, the slope of
    the full power can't be told from the phase beyond it."""
    turns = _turns(sweep)
    begins_rising = order == "1" or (order == "interferometer" and _height(sweep) < 0.5)
    return (turns + 1) // 2 if begins_rising else turns // 2 + (order == "0")


def _knots(sweep: Sweep, count: int, path: Floats) -> Floats:
    """Distances of knots (count + 1,), half of them equidistant in level and half in phase.

    path: (n,) phases at the levels of the sweep.
    """
    ordered = np.argsort(sweep.distance)
    distance, phase = sweep.distance[ordered], np.maximum.accumulate(path[ordered])
    rise = (phase - phase[0]) / max(float(phase[-1] - phase[0]), 1e-9)
    both = 0.5 * (distance + rise)  # rises strictly; equal steps of it are short where either changes fast
    places = np.interp(np.linspace(0, 1, count + 1), both, distance)
    shortest = 0.5 / len(distance)
    kept = [0.0]
    for place in places[1:-1]:
        if shortest < place - kept[-1] and place < 1 - shortest:
            kept.append(float(place))
    return np.array([*kept, 1.0])


def _start_of(sweep: Sweep, order: Order) -> float:
    """φ₁ of a sweep; of an interferometer the smaller of the two that its first reading allows."""
    if order != "interferometer":
        return 0.0 if order == "1" else math.pi
    return 2 * math.asin(math.sqrt(min(max(_height(sweep), 0.0), 1.0)))


def _begin(
    sweeps: Sequence[Sweep], orders: Sequence[Order], groups: Sequence[int], path: Floats, start: float
) -> _Begin:
    """A beginning with phases (n,) and φ₁ of the first sweep: f and φ₁ of the others as suit these phases best."""
    first = sweeps[0]
    ordered = np.argsort(first.distance)
    phases = [np.interp(sweep.distance, first.distance[ordered], path[ordered]) for sweep in sweeps]

    def best_start(index: int, factor: float) -> tuple[float, float]:
        """The correlation with the readings, and φ₁ that reaches it."""
        order = orders[index]
        free = np.arange(12) * math.pi / 6
        tried = free if order == "interferometer" else np.array([_start_of(sweeps[index], order)])
        expected = np.sin((factor * phases[index] - tried[:, None]) / 2) ** 2
        expected -= expected.mean(axis=1, keepdims=True)
        power = sweeps[index].power - sweeps[index].power.mean()
        found = expected @ power / np.maximum(np.sqrt((expected**2).sum(axis=1) * float(power @ power)), 1e-12)
        return float(found.max()), float(tried[found.argmax()])

    factors = [1.0]
    for group in range(1, max(groups) + 1):
        own = [index for index, of in enumerate(groups) if of == group]
        factors.append(max(_FACTORS, key=lambda factor: sum(best_start(index, factor)[0] for index in own)))
    starts = [start, *(best_start(index, factors[groups[index]])[1] for index in range(1, len(sweeps)))]
    return _Begin(path, starts, factors)


def _paths(sweep: Sweep, order: Order) -> list[tuple[Floats, float]]:
    """Monotone phases (n,) at the levels of a sweep to start a fit from, with φ₁: the best ones by their costs.

    Several full powers, slopes and, of an interferometer, both directions are tried; of those that end at the same
    phase one is kept.
    """
    starts = [_start_of(sweep, order)]
    if order == "interferometer":
        starts.append(2 * math.pi - starts[0])
    ordered = np.argsort(sweep.distance, kind="stable")
    heights = (sweep.power[ordered] - sweep.power.min()) / sweep.range
    found: list[tuple[float, int, Floats, float]] = []
    for start in starts:
        for slope in (0.0,) if order == "interferometer" else _SLOPES:
            for full_power in _FULL_POWERS:
                for maxima in (1, 3, 5) if slope > 0 else (1,):
                    scale = full_power / (1 + slope * maxima * math.pi)
                    cost, phases = _monotone_path(heights, scale, slope, start)
                    found.append((cost, len(found), phases, start))
    chosen: list[tuple[Floats, float]] = []
    for _, _, phases, start in sorted(found):
        if all(abs(phases[-1] - other.max()) > 0.5 or start != began for other, began in chosen):
            path = np.empty(len(phases))
            path[ordered] = phases
            chosen.append((path, start))
        if len(chosen) == 5:
            break
    return chosen


def _monotone_path(heights: Floats, scale: float, slope: float, start: float) -> tuple[float, Floats]:
    """Cost and phases (n,) of the monotone path from 0 with the lowest cost, by the Viterbi algorithm.

    heights: (n,) readings as shares of their range. The cost is the squared residual, plus a penalty on squared phase
    steps that prefers an even rise to jumps.
    """
    phase = np.linspace(0.0, _MAX_STROKE_TURNS * 2 * math.pi, _PHASE_STATES)
    expected = scale * (1 + slope * phase) * np.sin((phase - start) / 2) ** 2
    step = np.subtract.outer(phase, phase)
    step_cost = np.where(step < 0, np.inf, (_JUMP_PENALTY * step) ** 2)
    cost = np.where(phase == 0, 0.0, np.inf)
    predecessors = []
    for reading in heights[1:]:
        through = cost[None, :] + step_cost
        predecessors.append(through.argmin(axis=1))
        cost = through.min(axis=1) + (reading - expected) ** 2
    states = [int(cost.argmin())]
    for predecessor in reversed(predecessors):
        states.append(int(predecessor[states[-1]]))
    return float(cost.min()), phase[states[::-1]]


def _linear_residual(sweep: Sweep, order: Order, stroke: float) -> float:
    """Residual, as a share of the range, of a phase that is linear in the level, with the best full power."""
    share = np.sin((stroke * sweep.distance - _start_of(sweep, order)) / 2) ** 2
    power = (sweep.power - sweep.power.min()) / sweep.range
    scale = float(share @ power) / max(float(share @ share), 1e-12)
    return float(np.sqrt(np.mean((power - scale * share) ** 2)))
