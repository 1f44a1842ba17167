"""Mean CIEDE2000 colour difference (CIE 142-2001; Sharma, Wu & Dalal 2005), through CIELAB.

Assumptions, since CIEDE2000 was made for reflecting samples: the viewer is fully adapted to the display's white (D65,
Y = 1), to which CIELAB is relative; the eye's XYZ_F (from cone fundamentals) is used as if it were CIE 1931 XYZ; the
parametric factors k_L, k_C, k_H are 1; and pixels are compared one by one, so that speckle counts even where the eye
can't resolve it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, gamut_map, import_colour_science
from holoview.util.errors import UserError


def delta_e_xyz(image: ArrayLike, target: ArrayLike) -> float:
    """Mean CIEDE2000 over all pixels of two XYZ images (…, 3) whose white is D65 with Y = 1; 0 for equal images.

    Raises UserError when the shapes differ or the last axis isn't XYZ.
    """
    return float(np.mean(delta_e_map_xyz(image, target)))


def delta_e_linear_srgb(image: ArrayLike, target: ArrayLike) -> float:
    """Mean CIEDE2000 over all pixels of two linear sRGB images (…, 3), both clipped to 0…1 as a screen would.

    Raises UserError when the shapes differ or the last axis isn't RGB.
    """
    return delta_e_xyz(gamut_map(image) @ SRGB_TO_XYZ.T, gamut_map(target) @ SRGB_TO_XYZ.T)


def delta_e_map_xyz(image: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """CIEDE2000 of each pixel, shape (…), of two XYZ images (…, 3); white and errors as in `delta_e_xyz`."""
    image_xyz, target_xyz = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if image_xyz.shape != target_xyz.shape or image_xyz.shape[-1:] != (3,) or image_xyz.size == 0:
        expected = f"(…, 3) as the target, {target_xyz.shape}, not empty"
        raise UserError("image", f"shape {image_xyz.shape}", expected=expected)
    science = import_colour_science()
    white_xy = D65_WHITE[:2] / D65_WHITE.sum()
    lab, target_lab = (science.XYZ_to_Lab(xyz, illuminant=white_xy) for xyz in (image_xyz, target_xyz))
    difference: NDArray[np.float64] = np.asarray(science.delta_E(lab, target_lab, method="CIE 2000"), dtype=np.float64)
    return difference
