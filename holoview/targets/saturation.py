"""More or less colourful targets: chroma scaled in CIE LCHuv, lightness and hue kept, as in the paper's gamut study.

With u′, v′ the CIE 1976 chromaticity, u* = 13·L*·(u′ − u′ₙ): at fixed lightness and hue, scaling chroma scales
(u′ − u′ₙ, v′ − v′ₙ) (CIE 15:2004, 8.2.2). Luminance doesn't change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB
from holoview.errors import UserError

_LEAST = 1e-12  # of X + 15·Y + 3·Z: darker has no chromaticity


def scaled_saturation(rgb: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """Linear sRGB (…, 3), inside or outside 0…1, with its chroma in LCHuv (white D65) times `factor`; float32.

    0 is grey of equal luminance, 1 changes nothing, more than 1 leads out of sRGB: values are kept, as wide-gamut
    displays may show them. Where a large factor asks for a colour that can't be (v′ ≤ 0), chroma goes as far as can be.
    Raises UserError for a factor that isn't 0 or more.
    """
    if not 0 <= factor < np.inf:
        raise UserError("saturation", f"{factor:g}", expected="a factor of 0 or more; 1 changes nothing")
    if factor == 1:
        return np.asarray(rgb, dtype=np.float32)
    x, y, z = np.moveaxis(np.asarray(rgb, dtype=np.float64) @ SRGB_TO_XYZ.T, -1, 0)
    white_u, white_v = _chromaticity(*D65_WHITE)
    u, v = _chromaticity(x, y, z)
    u, v = white_u + factor * (u - white_u), np.maximum(white_v + factor * (v - white_v), 1e-3)
    # X = Y·9u/(4v), Z = Y·(12 − 3u − 20v)/(4v)
    scaled = np.stack([y * 9 * u / (4 * v), y, y * (12 - 3 * u - 20 * v) / (4 * v)], axis=-1)
    return np.asarray(scaled @ XYZ_TO_SRGB.T, dtype=np.float32)


def _chromaticity(x: object, y: object, z: object) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """CIE 1976 u′, v′; those of white where there is no light."""
    xyz = [np.asarray(part, dtype=np.float64) for part in (x, y, z)]
    total = xyz[0] + 15 * xyz[1] + 3 * xyz[2]
    lit = np.abs(total) > _LEAST
    safe = np.where(lit, total, 1.0)
    white = D65_WHITE[0] + 15 * D65_WHITE[1] + 3 * D65_WHITE[2]
    return (
        np.where(lit, 4 * xyz[0] / safe, 4 * D65_WHITE[0] / white),
        np.where(lit, 9 * xyz[1] / safe, 9 * D65_WHITE[1] / white),
    )
