"""Fits a monotone phase look-up table to a diffraction-efficiency sweep, with the stroke's 95 % interval.

A binary phase grating with equal bars of phases 0 and φ sends the share (4/π²)·sin²(φ/2) of the light into each first
order (Goodman, Introduction to Fourier Optics, 3rd ed., sec. 4.4.3). With x the grey level scaled to 0 … 1,

    P(x) = b + a·(1 + c·x)·sin²(φ(x)/2),   φ(0) = 0,   φ monotone

a: full power of the order. b: stray light. c: change of the order's full power along the sweep, which fringing between
bars causes; it is fitted only if Schwarz's criterion prefers the model with it. φ is a monotone cubic interpolant
through equidistant knots (Fritsch & Carlson, SIAM J. Numer. Anal. 17, 238 (1980)), fitted by bounded least squares.

sin² doesn't distinguish φ from 2π − φ, so the least-squares problem has many local minima. It is started from the
monotone path of phases with the lowest cost among all, which dynamic programming finds exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import least_squares

from holoview.calibrate.efficiency_sweep import EfficiencySweep
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

KNOTS = 16
_OTHER_KNOTS = (12, 24)  # the spread of the stroke over the numbers of knots is part of its interval
_MAX_STROKE_TURNS = 4.0
_PHASE_STATES = 241  # of the dynamic programme
_JUMP_PENALTY = 0.05  # cost of a phase step of 1 rad, as a share of the full power
_TOLERANCE = 1e-6  # relative; noise of 1 % changes a fit by 1e-3
_MAX_EVALUATIONS = 60  # of the least squares; only a contrast slope that the data don't determine needs more
_MIN_STEP = 1e-6  # rad between knots, because a modulator's levels must be strictly ascending


@dataclass(frozen=True)
class LutFit:
    """The fitted model at the n levels of the sweep.

    phase: (n,), rad, from 0.
    power: (n,), in the sweep's unit.
    relative_rms: root mean square of the residual, divided by the highest power of the sweep.
    contrast_slope: c, or 0 where it wasn't fitted.
    stroke_sigma: standard deviation of the stroke from the residuals, rad.
    """

    phase: Floats
    power: Floats
    relative_rms: float
    contrast_slope: float
    stroke_sigma: float

    @property
    def stroke(self) -> float:
        """Phase at the last level, rad."""
        return float(self.phase[-1])


@dataclass(frozen=True)
class Lut:
    """A fitted look-up table, and the residuals of simpler models to compare it with.

    stroke_interval: 95 % confidence interval of the stroke, rad.
    rms_linear_2pi, rms_linear_free: relative r.m.s. residual of a phase that is linear in the grey level, with a stroke
    of 2π and with the best stroke.
    """

    sweep: EfficiencySweep
    fit: LutFit
    stroke_interval: tuple[float, float]
    rms_linear_2pi: float
    rms_linear_free: float

    @property
    def stroke_fractions(self) -> Floats:
        """The phase at each level divided by the stroke, (n,), from 0 to 1: a modulator's `levels`."""
        return self.fit.phase / self.fit.stroke

    def stroke_m(self, wavelength_m: float) -> float:
        """Stroke as an optical path difference, for a sweep that was measured at this wavelength."""
        return self.fit.stroke * wavelength_m / (2 * math.pi)


def fit_lut(sweep: EfficiencySweep) -> Lut:
    """Fits the look-up table. The interval allows for noise and for the choice of the number of knots.

    Raises UserError if the power has no maximum inside the sweep: then the stroke is below π, and a and φ can't be
    determined separately.
    """
    _check_has_maximum(sweep)
    initial_phase = _unwrap_phase(sweep)

    def fit(knots: int, *, with_slope: bool) -> LutFit:
        return _fit_monotone_phase(sweep, initial_phase, knots, fit_contrast_slope=with_slope)

    without_slope, with_slope = fit(KNOTS, with_slope=False), fit(KNOTS, with_slope=True)
    needs_slope = _bic(with_slope, KNOTS + 2, sweep) < _bic(without_slope, KNOTS + 1, sweep)
    best = with_slope if needs_slope else without_slope
    other_strokes = [fit(knots, with_slope=needs_slope).stroke for knots in _OTHER_KNOTS]
    spread = float(np.std([best.stroke, *other_strokes], ddof=1))
    half_width = 1.96 * math.hypot(best.stroke_sigma, spread)
    x = sweep.relative_levels
    return Lut(
        sweep,
        best,
        (best.stroke - half_width, best.stroke + half_width),
        rms_linear_2pi=_relative_rms(sweep, 2 * math.pi * x),
        rms_linear_free=min(
            _relative_rms(sweep, turns * 2 * math.pi * x) for turns in np.arange(0.2, _MAX_STROKE_TURNS, 0.002)
        ),
    )


def _check_has_maximum(sweep: EfficiencySweep) -> None:
    """Raises UserError if the power rises to the end of the sweep, within its noise."""
    width = max(1, len(sweep.power) // 32)
    smooth = np.convolve(sweep.power, np.ones(width) / width, mode="valid")
    noise = float(np.std(np.diff(sweep.power, n=2))) / math.sqrt(6)
    if smooth.max() - smooth[-1] < max(0.02 * smooth.max(), 3 * noise) and int(smooth.argmax()) > 0.8 * len(smooth):
        raise UserError(
            "sweep",
            "the power rises to its end, without a maximum",
            expected="a phase of more than π at the last level",
            remedy="drive further or measure at a shorter wavelength: below π the full power isn't known",
        )


def _unwrap_phase(sweep: EfficiencySweep) -> Floats:
    """Phases (n,) of the best monotone path, for several full powers near the highest reading."""
    scales = sweep.power.max() * np.linspace(0.95, 1.1, 4) - sweep.power.min()
    return min((_monotone_path(sweep, float(scale)) for scale in scales), key=lambda result: result[0])[1]


def _monotone_path(sweep: EfficiencySweep, scale: float) -> tuple[float, Floats]:
    """Cost and phases (n,) of the monotone path with the lowest cost, by the Viterbi algorithm.

    The cost is the squared residual, plus a penalty on squared phase steps that prefers an even rise to jumps.
    """
    phase = np.linspace(0.0, _MAX_STROKE_TURNS * 2 * math.pi, _PHASE_STATES)
    expected = scale * np.sin(phase / 2) ** 2
    step = np.subtract.outer(phase, phase)
    step_cost = np.where(step < 0, np.inf, (_JUMP_PENALTY * scale * step) ** 2)
    cost = np.where(phase == 0, 0.0, np.inf)
    predecessors = []
    for reading in sweep.power[1:] - sweep.power.min():
        through = cost[None, :] + step_cost
        predecessors.append(through.argmin(axis=1))
        cost = through.min(axis=1) + (reading - expected) ** 2
    states = [int(cost.argmin())]
    for predecessor in reversed(predecessors):
        states.append(int(predecessor[states[-1]]))
    return float(cost.min()), phase[states[::-1]]


def _fit_monotone_phase(
    sweep: EfficiencySweep, initial_phase: Floats, knots: int, *, fit_contrast_slope: bool
) -> LutFit:
    """Fits the phase steps between knots, a, b and, if asked, c by bounded least squares from an initial phase (n,).

    The vector of unknowns u holds the knots − 1 steps, then a and b relative to the highest power, then c.
    """
    x, highest = sweep.relative_levels, float(sweep.power.max())
    knot_x = np.linspace(0.0, 1.0, knots)
    steps = np.clip(np.diff(np.interp(knot_x, x, initial_phase)), 10 * _MIN_STEP, None)

    def phase_of(u: Floats) -> Floats:
        return PchipInterpolator(knot_x, np.concatenate([[0.0], np.cumsum(u[: knots - 1])]))(x)

    def power_of(u: Floats) -> Floats:
        slope = u[knots + 1] if fit_contrast_slope else 0.0
        return highest * (u[knots] + u[knots - 1] * (1 + slope * x) * np.sin(phase_of(u) / 2) ** 2)

    u0 = np.concatenate([steps, [0.95, float(sweep.power.min()) / highest], [0.0] * fit_contrast_slope])
    low = np.concatenate([np.full(knots - 1, _MIN_STEP), [0.05, -0.5], [-0.8] * fit_contrast_slope])
    high = np.concatenate([np.full(knots - 1, np.inf), [4.0, 0.5], [4.0] * fit_contrast_slope])
    solution = least_squares(
        lambda u: (power_of(u) - sweep.power) / highest,
        u0,
        bounds=(low, high),
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        max_nfev=_MAX_EVALUATIONS,
    )
    phase = np.maximum.accumulate(phase_of(solution.x) + _MIN_STEP * 1e-3 * np.arange(len(x)))
    phase[0] = 0.0
    off_bound = solution.x > low * (1 + 1e-6)
    sigma = _stroke_sigma(solution.jac, solution.fun, off_bound, knots)
    slope = float(solution.x[knots + 1]) if fit_contrast_slope else 0.0
    return LutFit(phase, power_of(solution.x), float(np.sqrt(np.mean(solution.fun**2))), slope, sigma)


def _stroke_sigma(jacobian: Floats, residual: Floats, free: NDArray[np.bool_], knots: int) -> float:
    """Standard deviation (rad) of the sum of the phase steps.

    jacobian: (n, unknowns); residual: (n,); free: mask of the unknowns that aren't at their bounds. Residuals that are
    correlated with their neighbours by ρ count as (1 − ρ)/(1 + ρ) times as many independent ones.
    """
    correlation = float(np.clip(np.corrcoef(residual[:-1], residual[1:])[0, 1], 0.0, 0.95))
    variance = float(residual @ residual) / max(1, len(residual) - int(free.sum()))
    covariance = np.linalg.pinv(jacobian[:, free].T @ jacobian[:, free])
    is_step = (np.arange(len(free)) < knots - 1)[free].astype(np.float64)
    return math.sqrt(float(is_step @ covariance @ is_step) * variance * (1 + correlation) / (1 - correlation))


def _bic(fit: LutFit, unknowns: int, sweep: EfficiencySweep) -> float:
    """Schwarz's Bayesian information criterion (Ann. Statist. 6, 461 (1978)); an r.m.s. below 1e-6 counts as 1e-6."""
    count = len(sweep.power)
    return 2 * count * math.log(max(fit.relative_rms, 1e-6)) + unknowns * math.log(count)


def _relative_rms(sweep: EfficiencySweep, phase: Floats) -> float:
    """R.m.s. residual over the highest power for a phase (n,), with the best full power and no stray light."""
    expected = np.sin(phase / 2) ** 2
    scale = float(expected @ sweep.power) / float(expected @ expected)
    return float(np.sqrt(np.mean((sweep.power - scale * expected) ** 2)) / sweep.power.max())
