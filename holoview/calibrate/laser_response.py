"""What each laser emits for the power that was set, from the gains that fit the captures.

    gain of a capture = scale(λ) · power^exponent(λ),   signals being proportional to power · exposure already

Scales normalise the wavelengths: laser, camera and optics together. A wavelength whose captures were all taken at
nearly one power tells no exponent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures

Floats = NDArray[np.float64]

_LEAST_SPREAD = 0.05  # of log power, r.m.s.
_FEWEST = 4  # captures of a wavelength
_SIGNIFICANT = 3.0
_MIN_EXCESS_EXPONENT = 0.003  # exponents below are nobody's concern
_MAX_EXPONENT_SIGMA = (
    0.1  # σ of an exponent from which on gains scatter too much to tell any: a model that is still wrong
)


@dataclass(frozen=True)
class LaserResponse:
    """One value a wavelength: scale, exponent beyond 1 and its σ (inf where the data don't tell it)."""

    wavelength_m: Floats
    scale: Floats
    excess_exponent: Floats
    exponent_sigma: Floats

    @property
    def common_exponent(self) -> tuple[float, float]:
        """The exponent that all wavelengths share and its σ; (0, inf) where none tells it."""
        weight = 1 / np.square(self.exponent_sigma)
        if not weight.sum() > 0:
            return 0.0, math.inf
        return float((weight * self.excess_exponent).sum() / weight.sum()), float(weight.sum() ** -0.5)

    @property
    def is_nonlinear(self) -> bool:
        """Whether light isn't proportional to power, as far as the gains tell."""
        exponent, sigma = self.common_exponent
        return (
            sigma < _MAX_EXPONENT_SIGMA
            and abs(exponent) > max(_MIN_EXCESS_EXPONENT, _SIGNIFICANT * sigma)
            and -0.9 < exponent < 3.0
        )


def fit_laser_response(captures: Captures, indices: NDArray[np.intp], gains: Floats) -> LaserResponse:
    """The response that the gains (one for each of `indices`) show."""
    wavelengths = np.unique(captures.wavelength_m[indices])
    rows = []
    for wavelength in wavelengths:
        mine = captures.wavelength_m[indices] == wavelength
        rows.append(_fit_power_law(np.log(captures.power[indices[mine]]), np.log(np.maximum(gains[mine], 1e-30))))
    scale, exponent, sigma = (np.array(column) for column in zip(*rows, strict=True))
    return LaserResponse(wavelengths, scale, exponent, sigma)


def _fit_power_law(log_power: Floats, log_gain: Floats) -> tuple[float, float, float]:
    """(scale at power 1, exponent, σ) of one wavelength."""
    spread = log_power - log_power.mean()
    if len(log_power) < _FEWEST or float(np.sqrt(np.mean(spread**2))) < _LEAST_SPREAD:
        return math.exp(float(log_gain.mean())), 0.0, math.inf
    exponent = float(spread @ log_gain / (spread @ spread))
    rest = log_gain - log_gain.mean() - exponent * spread
    sigma = math.sqrt(float(rest @ rest) / (len(rest) - 2) / float(spread @ spread))
    return math.exp(float(log_gain.mean()) - exponent * float(log_power.mean())), exponent, max(sigma, 1e-6)
