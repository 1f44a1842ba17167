"""Mean CIEDE2000 colour difference (CIE 142-2001; Sharma, Wu & Dalal 2005), through CIELAB.

Assumptions, since a hologram is no reflecting sample: the viewer is fully adapted to the display's white (D65, Y = 1),
so CIELAB is taken relative to it with no other adaptation; an eye's XYZ_F is used as if it were CIE 1931 XYZ; the
parametric factors k_L, k_C, k_H are 1; and each pixel is judged by itself, so speckle counts that the eye is too coarse
to resolve.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, gamut_map, import_colour_science
from holoview.util.errors import UserError


def delta_e_xyz(image: ArrayLike, target: ArrayLike) -> float:
    """Mean CIEDE2000 over all pixels of two XYZ images (…, 3) in which D65 with Y = 1 is white; 0 when identical.

    Raises UserError when the shapes differ or the last axis isn't XYZ.
    """
    return float(np.mean(delta_e_map_xyz(image, target)))


def delta_e_linear_srgb(image: ArrayLike, target: ArrayLike) -> float:
    """Mean CIEDE2000 over all pixels of two linear sRGB images (…, 3), both clipped to 0…1 as a screen would.

    Raises UserError when the shapes differ or the last axis isn't RGB.
    """
    return delta_e_xyz(gamut_map(image) @ SRGB_TO_XYZ.T, gamut_map(target) @ SRGB_TO_XYZ.T)


def delta_e_map_xyz(image: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """CIEDE2000 of each pixel, shape (…), of two XYZ images (…, 3); arguments and errors as `delta_e_xyz`."""
    found, wanted = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if found.shape != wanted.shape or found.shape[-1:] != (3,) or found.size == 0:
        raise UserError("image", f"shape {found.shape}", expected=f"(…, 3) as the target, {wanted.shape}, not empty")
    science = import_colour_science()
    white_xy = D65_WHITE[:2] / D65_WHITE.sum()
    lab, target_lab = (science.XYZ_to_Lab(xyz, illuminant=white_xy) for xyz in (found, wanted))
    difference: NDArray[np.float64] = np.asarray(science.delta_E(lab, target_lab, method="CIE 2000"), dtype=np.float64)
    return difference
