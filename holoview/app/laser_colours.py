"""Display colours of laser wavelengths, for drawing."""

from __future__ import annotations

from functools import cache

import numpy as np
from imgui_bundle import imgui

from holoview.colour import gamut_map, observer_weights, srgb_encode, xyz_to_linear_srgb

_MIN_COMPONENT = 0.25  # keeps deep red and violet visible
EYE_RANGE_M = (390e-9, 830e-9)
"""The wavelengths of the cone fundamentals."""


@cache
def laser_colour(wavelength_m: float, opacity: float = 1.0) -> imgui.ImVec4:
    """A colour of about the hue of a wavelength, mapped into the sRGB gamut; grey outside the visible range."""
    if not EYE_RANGE_M[0] <= wavelength_m <= EYE_RANGE_M[1]:
        return imgui.ImVec4(0.6, 0.6, 0.6, opacity)
    linear = xyz_to_linear_srgb(observer_weights("eye", [wavelength_m])[0])
    bright = gamut_map(linear / max(float(np.max(linear)), 1e-9))
    red, green, blue = (max(float(srgb_encode(x)), _MIN_COMPONENT) for x in bright)
    return imgui.ImVec4(red, green, blue, opacity)
