"""A penalty on colours that people see differently, for lasers whose wavelengths are free.

Let d_i(λ) be what person i sees of unit intensity at λ, in the channels of the loss, less the mean over all people, and
p_λ the lasers' powers, scaled so that the mean person sees their sum with the luminance 1. The penalty is the mean over
people of the squared difference from their mean, for the mean colour of the lasers:

    P = mean_i |D_i|²,   D_i = Σ_λ p_λ·d_i(λ),   dP = 2·mean_i D_i·Σ_λ [p_λ·d_i′(λ)·δλ + d_i(λ)·δp_λ]

A laser that moves takes the powers with it, since the picture's mean colour stays. Of all changes that keep the mean
person's colour, δp is the one of least Σ δp²/p: with the weights w̄ of the mean person, δp = −p∘w̄·(Σ_λ p·w̄ᵀw̄)⁻¹·Σ_λ
p_λ·w̄′(λ)·δλ.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.optimise.settings import LossSpace
from holoview.light.colour import observer_weight_derivatives, observer_weights

Floats = NDArray[np.float64]


class AgreementPenalty:
    """The penalty for people (as texts of observers) in the channels of a loss."""

    def __init__(self, people: Sequence[str], loss: LossSpace) -> None:
        self.people, self._to_channels = tuple(people), loss.matrix.T

    def value_and_gradient(self, wavelengths_m: Floats, powers: Floats) -> tuple[float, Floats]:
        """P, and ∂P/∂λ (wavelength,), 1/m. powers: (wavelength,)."""
        weights = np.stack([observer_weights(person, wavelengths_m) for person in self.people])
        luminance = float(powers @ weights[..., 1].mean(axis=0))
        if luminance <= 0:
            return 0.0, np.zeros(len(powers))
        shares = powers / luminance
        slopes = np.stack([observer_weight_derivatives(person, wavelengths_m) for person in self.people])
        apart, slope = ((table - table.mean(axis=0)) @ self._to_channels for table in (weights, slopes))
        colour = np.einsum("l,olc->oc", shares, apart)
        value = float(np.square(colour).sum(axis=1).mean())
        by_wavelength, by_power = (2 / len(self.people) * np.einsum("olc,oc->l", t, colour) for t in (slope, apart))
        mean, mean_slope = weights.mean(axis=0), slopes.mean(axis=0)
        # least squares: fewer than three lasers, or lasers that are off, leave the colours' matrix singular
        held = np.linalg.lstsq((mean.T * shares) @ mean, (shares[:, None] * mean_slope).T, rcond=None)[0]
        return value, np.asarray(shares * by_wavelength - (shares * by_power) @ mean @ held)
