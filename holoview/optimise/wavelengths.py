"""Wavelengths as variables: projection onto the allowed range and spacing, and derivatives of colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from holoview.colour import LMS_TO_XYZ, cone_fundamental_derivatives, observer_weights
from holoview.optimise.loss_spaces import LossSpace
from holoview.optimise.settings import Settings
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


def project_wavelengths(wavelengths_m: Floats, settings: Settings) -> Floats:
    """The nearest wavelengths (least squares) inside the range and at least the spacing apart, in the same order.

    For sorted wavelengths x_i and spacing s, x_i − i·s must not fall: the nearest such sequence is an isotonic
    regression. Raises UserError when the range has no room for so many.
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
    offsets = spacing * np.arange(count)
    monotone = isotonic_regression(wavelengths_m[order] - offsets).x.clip(low, high - (count - 1) * spacing)
    projected = np.empty(count)
    projected[order] = monotone + offsets
    return projected


def check_wavelength_search(observer: str, settings: Settings) -> None:
    """Raises UserError for an observer whose derivative isn't implemented, and for a range where it has no data."""
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
    """∂(channels of unit intensity)/∂λ, (wavelength, channel), 1/m, from the eye's cone fundamentals.

    Zero for a monochrome camera, to which all wavelengths are equally bright.
    """
    if loss.ignores_wavelength or observer == "mono":
        return np.zeros((len(wavelengths_m), len(loss.matrix)))
    derivatives: Floats = cone_fundamental_derivatives(wavelengths_m) @ (loss.matrix @ LMS_TO_XYZ).T
    return derivatives
