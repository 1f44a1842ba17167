"""A monotone look-up table from a diffraction-efficiency sweep, and the stroke with its interval.

A binary phase grating with equal bars of phases 0 and φ sends the share (4/π²)·sin²(φ/2) of the light into each first
order (Goodman, Introduction to Fourier Optics, 3rd ed., sec. 4.4.3). So, for the share x of the grey levels' range,

    P(x) = b + a·(1 + c·x)·sin²(φ(x)/2),   φ(0) = 0,   φ never falls

a, b: full power and stray light. c: bars interfere less or more cleanly at high drive (fringing); it is fitted only
where the data call for it. φ is a monotone cubic through equidistant knots (Fritsch & Carlson, SIAM J. Numer. Anal. 17,
238 (1980)). A sine squared can't tell φ from 2π − φ: which of its branches each reading is on follows from the
monotone path of least squares among all, found exactly by dynamic programming.
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
_OTHER_KNOTS = (12, 24)  # how much the stroke depends on the choice is part of its interval
_TURNS = 4.0  # largest stroke that is searched
_STATES = 241  # phases of the branch search
_TOLERANCE = 1e-6  # relative, of a fit that noise moves by 1e-3
_MOST_STEPS = 60  # of a fit; only a slope of contrast that nothing calls for takes more
_LEAST_STEP = 1e-6  # rad: levels rise strictly, as a modulator's table must


@dataclass(frozen=True)
class LutFit:
    """phase (n,) rad at the sweep's levels; power (n,) as fitted; rms: residual over the highest reading."""

    phase: Floats
    power: Floats
    relative_rms: float
    contrast_slope: float
    stroke_sigma: float

    @property
    def stroke(self) -> float:
        """Phase between the first and the last level, rad."""
        return float(self.phase[-1])


@dataclass(frozen=True)
class Lut:
    """A fit and what is compared with it. interval: 95 % of the stroke, rad; rms_*: of simpler models."""

    sweep: EfficiencySweep
    fit: LutFit
    stroke_interval: tuple[float, float]
    rms_linear_2pi: float
    rms_linear_free: float

    @property
    def stroke_fractions(self) -> Floats:
        """Share of the stroke at each level, rising from 0 to 1: what a modulator's `levels` states."""
        return self.fit.phase / self.fit.stroke

    def stroke_m(self, wavelength_m: float) -> float:
        """Optical path of full drive, when the sweep was measured at this wavelength."""
        return self.fit.stroke * wavelength_m / (2 * math.pi)


def fit_lut(sweep: EfficiencySweep) -> Lut:
    """The monotone table that explains a sweep best.

    Raises UserError where the power has no maximum inside the sweep: below a stroke of π its scale can't be known.
    """
    _check_has_maximum(sweep)
    start = _unwrap_phase(sweep)
    plain, tilted = (_fit_monotone_phase(sweep, start, KNOTS, fit_contrast_slope=free) for free in (False, True))
    contrast = _bic(tilted, KNOTS + 2, sweep) < _bic(plain, KNOTS + 1, sweep)
    best = tilted if contrast else plain
    others = [_fit_monotone_phase(sweep, start, knots, fit_contrast_slope=contrast).stroke for knots in _OTHER_KNOTS]
    spread = float(np.std([best.stroke, *others], ddof=1))
    half = 1.96 * math.hypot(best.stroke_sigma, spread)
    linear = sweep.relative_levels
    free = min(_rms_of(sweep, turns * 2 * math.pi * linear) for turns in np.arange(0.2, _TURNS, 0.002))
    return Lut(sweep, best, (best.stroke - half, best.stroke + half), _rms_of(sweep, 2 * math.pi * linear), free)


def _check_has_maximum(sweep: EfficiencySweep) -> None:
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
    """Phases (n,) of the monotone path that fits best, over the scales that the highest reading allows."""
    scales = sweep.power.max() * np.linspace(0.95, 1.1, 4) - sweep.power.min()
    return min((_monotone_path(sweep, float(scale)) for scale in scales), key=lambda found: found[0])[1]


def _monotone_path(sweep: EfficiencySweep, scale: float) -> tuple[float, Floats]:
    """Least cost and phases of a monotone path; an even rise costs least, so that branches don't change in jumps."""
    phase = np.linspace(0.0, _TURNS * 2 * math.pi, _STATES)
    expected = scale * np.sin(phase / 2) ** 2
    rise = np.subtract.outer(phase, phase)
    jump = np.where(rise < 0, np.inf, (0.05 * scale * rise) ** 2)
    cost = np.where(phase == 0, 0.0, np.inf)
    came_from = []
    for reading in sweep.power[1:] - sweep.power.min():
        through = cost[None, :] + jump
        came_from.append(through.argmin(axis=1))
        cost = through.min(axis=1) + (reading - expected) ** 2
    state = int(cost.argmin())
    least, states = float(cost[state]), [state]
    for origin in reversed(came_from):
        states.append(int(origin[states[-1]]))
    return least, phase[states[::-1]]


def _fit_monotone_phase(
    sweep: EfficiencySweep, initial_phase: Floats, knots: int, *, fit_contrast_slope: bool
) -> LutFit:
    """Knots, scale, stray light and, on demand, the slope of contrast by bounded least squares."""
    x, highest = sweep.relative_levels, float(sweep.power.max())
    places = np.linspace(0.0, 1.0, knots)
    steps = np.clip(np.diff(np.interp(places, x, initial_phase)), 10 * _LEAST_STEP, None)

    def phase_of(u: Floats) -> Floats:
        return PchipInterpolator(places, np.concatenate([[0.0], np.cumsum(u[: knots - 1])]))(x)

    def power_of(u: Floats) -> Floats:
        slope = u[knots + 1] if fit_contrast_slope else 0.0
        return highest * (u[knots] + u[knots - 1] * (1 + slope * x) * np.sin(phase_of(u) / 2) ** 2)

    u0 = np.concatenate([steps, [0.95, float(sweep.power.min()) / highest], [0.0] * fit_contrast_slope])
    low = np.concatenate([np.full(knots - 1, _LEAST_STEP), [0.05, -0.5], [-0.8] * fit_contrast_slope])
    high = np.concatenate([np.full(knots - 1, np.inf), [4.0, 0.5], [4.0] * fit_contrast_slope])
    found = least_squares(
        lambda u: (power_of(u) - sweep.power) / highest,
        u0,
        bounds=(low, high),
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        max_nfev=_MOST_STEPS,
    )
    phase = np.maximum.accumulate(phase_of(found.x) + _LEAST_STEP * 1e-3 * np.arange(len(x)))
    phase[0] = 0.0
    sigma = _stroke_sigma(found.jac, found.fun, found.x > low * (1 + 1e-6), knots)
    slope = float(found.x[knots + 1]) if fit_contrast_slope else 0.0
    return LutFit(phase, power_of(found.x), float(np.sqrt(np.mean(found.fun**2))), slope, sigma)


def _stroke_sigma(jacobian: Floats, residual: Floats, free: NDArray[np.bool_], knots: int) -> float:
    """Standard deviation of the sum of the steps; residuals that follow their neighbours count as fewer."""
    following = float(np.clip(np.corrcoef(residual[:-1], residual[1:])[0, 1], 0.0, 0.95))
    variance = float(residual @ residual) / max(1, len(residual) - int(free.sum()))
    covariance = np.linalg.pinv(jacobian[:, free].T @ jacobian[:, free])
    of_steps = (np.arange(len(free)) < knots - 1)[free].astype(np.float64)
    return math.sqrt(float(of_steps @ covariance @ of_steps) * variance * (1 + following) / (1 - following))


def _bic(fit: LutFit, unknowns: int, sweep: EfficiencySweep) -> float:
    """Schwarz's criterion (Ann. Statist. 6, 461 (1978)); a perfect fit counts as one to 1e-6."""
    count = len(sweep.power)
    return 2 * count * math.log(max(fit.relative_rms, 1e-6)) + unknowns * math.log(count)


def _rms_of(sweep: EfficiencySweep, phase: Floats) -> float:
    """Residual over the highest reading, with the best scale and no stray light."""
    expected = np.sin(phase / 2) ** 2
    scale = float(expected @ sweep.power) / float(expected @ expected)
    return float(np.sqrt(np.mean((sweep.power - scale * expected) ** 2)) / sweep.power.max())
