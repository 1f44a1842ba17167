"""Wavelengths as unknowns: steps along the gradient, inside the lasers' range and apart from each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from holoview.colour import LMS_TO_XYZ, cone_fundamental_derivatives, observer_weights
from holoview.optimise.losses import LossSpace
from holoview.optimise.settings import Settings
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


def project_wavelengths(wavelengths_m: Floats, settings: Settings) -> Floats:
    """The nearest wavelengths that are in range and spaced, in the same order by size.

    With x_i rising and spacing s, x_i − i·s must rise too: the nearest such sequence is an isotonic regression.
    Raises UserError when the range has no room for so many.
    """
    low, high = settings.wavelength_range_m
    count, spacing = len(wavelengths_m), settings.wavelength_spacing_m
    if (count - 1) * spacing > high - low:
        raise UserError(
            "wavelength range",
            f"{low * 1e9:g} to {high * 1e9:g} nm for {count} lasers {spacing * 1e9:g} nm apart",
            expected=f"at least {(count - 1) * spacing * 1e9:g} nm",
            remedy="widen the range or lower the spacing",
        )
    order = np.argsort(wavelengths_m, kind="stable")
    steps = spacing * np.arange(count)
    level = isotonic_regression(wavelengths_m[order] - steps).x.clip(low, high - (count - 1) * spacing)
    out = np.empty(count)
    out[order] = level + steps
    return out


def check_wavelength_search(observer: str, settings: Settings) -> None:
    """UserError for an observer whose response has no slopes here, and for a range where it is unknown."""
    if observer not in ("eye", "mono"):
        raise UserError(
            "free wavelengths",
            f'observer = "{observer}"',
            expected='"eye" or "mono"',
            remedy="only the cone fundamentals have slopes here",
        )
    try:
        observer_weights(observer, settings.wavelength_range_m)
    except UserError as error:
        raise error.inside("wavelength range: ") from error


def channel_wavelength_derivatives(loss: LossSpace, wavelengths_m: Floats, observer: str) -> Floats:
    """∂(channels of unit intensity)/∂λ, (wavelength, channel), 1/m, through the eye's cone fundamentals.

    Zero for a mono camera, which sees every wavelength alike.
    """
    if loss.ignores_wavelength or observer == "mono":
        return np.zeros((len(wavelengths_m), len(loss.matrix)))
    slopes: Floats = cone_fundamental_derivatives(wavelengths_m) @ (loss.matrix @ LMS_TO_XYZ).T
    return slopes
