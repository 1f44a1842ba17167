"""What the fitted gains tell: whether the laser's power follows what was set, and how much exposures jitter.

The gain of each capture is a nuisance that every fit frees, so an effect that changes nothing but the laser's power
leaves no residual. It is read off the gains: log a_k, centred for each wavelength, against the law's prediction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from holoview.captures.dataset import Captures
from holoview.diagnose.free_parameters import FittedValues, free_parameters_of
from holoview.diagnose.uncertainty import Interval
from holoview.model.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS, Effect

Floats = NDArray[np.float64]

_LEAST_SPREAD = 0.003  # of the gains: jitter of exposures up to here is every laboratory's
_LEAST_EXPLAINED = 0.5
_SIGMAS = 5.0
_MOST_RISK = 1.96


@dataclass(frozen=True)
class PowerLawFit:
    """An effect of the laser's power that the gains show: values, intervals, spread of log gain before and after."""

    effect: str
    values: FittedValues
    intervals: dict[tuple[str, str], Interval]
    spread_before: float
    spread_after: float


def gain_spread(captures: Captures, gain: Floats) -> float:
    """R.m.s. of the gains about those of their wavelength, relative."""
    return float(np.std(centre_per_wavelength(captures, np.log(np.maximum(gain, 1e-300)))))


def changes_only_power(effect: Effect) -> bool:
    """Whether an effect changes the laser's power and nothing that a picture's shape would show."""
    others = (*BENCH_HOOKS, *MODULATOR_HOOKS, *CAMERA_HOOKS, "pupil")
    return effect.overrides("laser_power") and not any(
        effect.overrides(hook) for hook in others if hook != "laser_power"
    )


def fit_power_law(effect: Effect, captures: Captures, gain: Floats) -> PowerLawFit | None:
    """The law's parameters where it explains the gains' spread, else None. Gains are those of the nominal law."""
    log_gain = centre_per_wavelength(captures, np.log(np.maximum(gain, 1e-300)))
    free = free_parameters_of([effect], include_fine=True)
    spread = float(np.std(log_gain))
    if spread < _LEAST_SPREAD or len(free) == 0 or len(captures) < len(captures.wavelengths_m) + len(free) + 2:
        return None

    def residual(x: Floats) -> Floats:
        emitted = effect.laser_power(captures.power, effect.parameter_values(free.unpack(x)[effect.id]))
        law = np.log(np.maximum(emitted, 1e-300) / captures.power)
        return np.asarray(log_gain - centre_per_wavelength(captures, law), dtype=np.float64)

    bounds, start = free.bounds(), free.pack({})
    found = least_squares(residual, start, bounds=(bounds.lower, bounds.upper), x_scale=1.0)
    left = float(np.std(found.fun))
    if 1.0 - (left / spread) ** 2 < _LEAST_EXPLAINED:
        return None
    freedom = len(captures) - len(captures.wavelengths_m) - len(free)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * np.square(found.fun).sum() / freedom
    sigma = np.sqrt(np.diag(covariance)) * np.abs(free.value_derivatives(found.x))
    values = free.unpack(found.x)
    own = values[effect.id]
    intervals = {
        (e, p.name): Interval(own[p.name], float(s), _MOST_RISK * float(s))
        for (e, p), s in zip(free.entries, sigma, strict=True)
    }
    significant = any(abs(own[p.name] - p.identity) > _SIGMAS * intervals[e, p.name].sigma for e, p in free.entries)
    return PowerLawFit(effect.id, values, intervals, spread, left) if significant else None


def centre_per_wavelength(captures: Captures, values: Floats) -> Floats:
    """Values less the mean of their wavelength."""
    result = np.array(values, dtype=np.float64)
    for wavelength in captures.wavelengths_m:
        same = captures.wavelength_m == wavelength
        result[same] -= result[same].mean()
    return result
