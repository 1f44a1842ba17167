"""Colours of lasers for drawing."""

from __future__ import annotations

from functools import cache

import numpy as np
from imgui_bundle import imgui

from holoview.colour import gamut_map, observer_weights, srgb_encode, xyz_to_linear_srgb

_DIMMEST = 0.25  # deep red and violet stay visible
_EYE_M = (390e-9, 830e-9)


@cache
def laser_colour(wavelength_m: float, opacity: float = 1.0) -> imgui.ImVec4:
    """About the hue of a wavelength, as a screen can show it; grey where nobody sees it."""
    if not _EYE_M[0] <= wavelength_m <= _EYE_M[1]:
        return imgui.ImVec4(0.6, 0.6, 0.6, opacity)
    linear = xyz_to_linear_srgb(observer_weights("eye", [wavelength_m])[0])
    bright = gamut_map(linear / max(float(np.max(linear)), 1e-9))
    red, green, blue = (max(float(srgb_encode(x)), _DIMMEST) for x in bright)
    return imgui.ImVec4(red, green, blue, opacity)
