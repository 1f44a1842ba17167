"""Laws of the lasers' power, read off the fitted gains: whether the power follows its setting, and how much exposures
jitter.

Every fit frees the gain of each capture, so an effect that changes the laser's power alone leaves no residual. The
gains show it: log a_k, centred for each wavelength, is fitted by the law's prediction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from holoview.bench.captures.dataset import Captures
from holoview.bench.diagnose.fit import FittedValues, FreeParameters, free_parameters_of
from holoview.bench.diagnose.intervals import LEVEL, Interval
from holoview.light.model.effects.effect import BENCH_HOOKS, CAMERA_HOOKS, MODULATOR_HOOKS, Effect

Floats = NDArray[np.float64]

MIN_SPREAD = 0.003
"""[1] R.m.s. spread of the logarithm of the gains from which a law is fitted. Evidence: the search study; exposures of
every laboratory jitter as much, which alarmed an information criterion in the screening study."""

MIN_EXPLAINED = 0.5
"""[1] Share of the variance that a law must explain. Evidence: the search study."""

MIN_SIGMAS = 5.0
"""[σ] A parameter must lie so far from its identity. Evidence: derivation: as `VerdictConfig.min_delta_chi2`, 5²."""

SPARE_CAPTURES = 2
"""[captures] Needed beyond one for each wavelength and parameter. Evidence: none recorded; a spread needs some."""


@dataclass(frozen=True)
class PowerLawFit:
    """An effect of the laser's power that the gains show: values, intervals, spread of log gain before and after."""

    effect: str
    values: FittedValues
    intervals: dict[tuple[str, str], Interval]
    spread_before: float
    spread_after: float


def gain_spread(captures: Captures, gain: Floats) -> float:
    """Standard deviation of the logarithm of the gains about the mean of their wavelength."""
    return float(np.std(_centred_log(captures, gain)))


def changes_only_power(effect: Effect) -> bool:
    """Whether an effect changes the laser's power and nothing that an image's shape would show."""
    others = {*BENCH_HOOKS, *MODULATOR_HOOKS, *CAMERA_HOOKS, "pupil"} - {"laser_power"}
    return effect.overrides("laser_power") and not any(effect.overrides(hook) for hook in others)


def fit_power_law(effect: Effect, captures: Captures, gain: Floats) -> PowerLawFit | None:
    """The law's parameters where it explains the gains' spread, else None. gain: under the nominal law, (capture,)."""
    log_gain = _centred_log(captures, gain)
    free = free_parameters_of([effect], include_fine=True)
    spread = float(np.std(log_gain))
    fitted_numbers = len(captures.wavelengths_m) + len(free)
    if spread < MIN_SPREAD or len(free) == 0 or len(captures) < fitted_numbers + SPARE_CAPTURES:
        return None

    def residual(x: Floats) -> Floats:
        emitted = effect.laser_power(captures.power, effect.parameter_values(free.unpack(x)[effect.id]))
        law = np.log(np.maximum(emitted, 1e-300) / captures.power)
        return np.asarray(log_gain - centre_per_wavelength(captures, law), dtype=np.float64)

    bounds, start = free.bounds(), free.pack({})
    solution = least_squares(residual, start, bounds=(bounds.lower, bounds.upper), x_scale=1.0)
    left = float(np.std(solution.fun))
    if 1.0 - (left / spread) ** 2 < MIN_EXPLAINED:
        return None
    values = free.unpack(solution.x)
    degrees_of_freedom = len(captures) - fitted_numbers
    sigma = _standard_deviations(free, solution.x, solution.jac, solution.fun, degrees_of_freedom)
    own, factor = values[effect.id], float(student.ppf(0.5 + LEVEL / 2, degrees_of_freedom))
    intervals = {
        (e, p.name): Interval(own[p.name], float(s), factor * float(s))
        for (e, p), s in zip(free.entries, sigma, strict=True)
    }
    significant = any(abs(own[p.name] - p.identity) > MIN_SIGMAS * intervals[e, p.name].sigma for e, p in free.entries)
    return PowerLawFit(effect.id, values, intervals, spread, left) if significant else None


def centre_per_wavelength(captures: Captures, values: Floats) -> Floats:
    """Values (capture,) less the mean of their wavelength."""
    result = np.array(values, dtype=np.float64)
    for wavelength in captures.wavelengths_m:
        same = captures.wavelength_m == wavelength
        result[same] -= result[same].mean()
    return result


def _centred_log(captures: Captures, gain: Floats) -> Floats:
    return centre_per_wavelength(captures, np.log(np.maximum(gain, 1e-300)))


def _standard_deviations(
    free: FreeParameters, x: Floats, jacobian: Floats, residual: Floats, degrees_of_freedom: int
) -> Floats:
    """Of the values of a least-squares solution whose residuals have one common variance."""
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * np.square(residual).sum() / degrees_of_freedom
    return np.sqrt(np.diag(covariance)) * np.abs(free.value_derivatives(x))
