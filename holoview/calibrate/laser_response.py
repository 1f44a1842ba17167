"""Fits each laser's scale and power-law exponent from the gains of the captures.

The predicted signal of a capture is proportional to power · exposure. The gain, by which it is multiplied to fit the
image best, therefore shows how the light departs from that proportionality:

    gain = scale(λ) · power^e(λ)

scale(λ) is the relative brightness of a wavelength: laser, optics and camera together. The laser emits in proportion
to power^(1 + e); e is called the excess exponent and is 0 for an ideal laser. It is a linear regression of log gain on
log power, and is left undetermined where the captures of a wavelength were taken at nearly one power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures

Floats = NDArray[np.float64]

_MIN_LOG_POWER_RMS = 0.05  # spread of log power that a regression needs
_MIN_CAPTURES = 4  # of a wavelength
_SIGNIFICANCE = 3.0  # σ
_MIN_EXCESS_EXPONENT = 0.003  # smaller ones change no image visibly
_MAX_EXPONENT_SIGMA = 0.1  # gains that scatter more are those of a model that is still wrong
_PLAUSIBLE_EXPONENTS = (-0.9, 3.0)


@dataclass(frozen=True)
class LaserResponse:
    """The response of each laser, (wavelength,) each. `result` relies on the order of the fields.

    scale: gain at power 1.
    excess_exponent: e of gain ∝ power^e; 0 where it is undetermined.
    exponent_sigma: standard deviation of e; infinite where it is undetermined.
    """

    wavelength_m: Floats
    scale: Floats
    excess_exponent: Floats
    exponent_sigma: Floats

    @property
    def common_exponent(self) -> tuple[float, float]:
        """Weighted mean of e over the wavelengths, and its standard deviation; (0, inf) if all are undetermined."""
        weight = 1 / np.square(self.exponent_sigma)
        if not weight.sum() > 0:
            return 0.0, math.inf
        return float((weight * self.excess_exponent).sum() / weight.sum()), float(weight.sum() ** -0.5)

    @property
    def is_nonlinear(self) -> bool:
        """Whether the common exponent differs from 0 significantly, by a plausible and relevant amount."""
        exponent, sigma = self.common_exponent
        return (
            sigma < _MAX_EXPONENT_SIGMA
            and abs(exponent) > max(_MIN_EXCESS_EXPONENT, _SIGNIFICANCE * sigma)
            and _PLAUSIBLE_EXPONENTS[0] < exponent < _PLAUSIBLE_EXPONENTS[1]
        )


def fit_laser_response(captures: Captures, indices: NDArray[np.intp], gains: Floats) -> LaserResponse:
    """The response of the lasers, from captures of these indices (n,) and their gains (n,)."""
    wavelengths = np.unique(captures.wavelength_m[indices])
    rows = []
    for wavelength in wavelengths:
        mask = captures.wavelength_m[indices] == wavelength
        rows.append(_fit_power_law(np.log(captures.power[indices[mask]]), np.log(np.maximum(gains[mask], 1e-30))))
    scale, exponent, sigma = (np.array(column) for column in zip(*rows, strict=True))
    return LaserResponse(wavelengths, scale, exponent, sigma)


def _fit_power_law(log_power: Floats, log_gain: Floats) -> tuple[float, float, float]:
    """Scale, excess exponent and its σ for one wavelength, by linear regression."""
    centred = log_power - log_power.mean()
    if len(log_power) < _MIN_CAPTURES or float(np.sqrt(np.mean(centred**2))) < _MIN_LOG_POWER_RMS:
        return math.exp(float(log_gain.mean())), 0.0, math.inf
    exponent = float(centred @ log_gain / (centred @ centred))
    residual = log_gain - log_gain.mean() - exponent * centred
    sigma = math.sqrt(float(residual @ residual) / (len(residual) - 2) / float(centred @ centred))
    return math.exp(float(log_gain.mean()) - exponent * float(log_power.mean())), exponent, max(sigma, 1e-6)
