"""Scales chroma in CIE LCHuv at constant lightness and hue, up to the spectral locus, as in the paper's gamut study.

With u′, v′ the CIE 1976 chromaticities, u* = 13·L*·(u′ − u′ₙ) and the same for v* (CIE 15:2004, 8.2.2). L* depends on
luminance alone, so that scaling the chroma C*uv = √(u*² + v*²) by t at fixed L* and hue moves the chromaticity along
its ray from white, at fixed luminance:

    u′ ← u′ₙ + t·(u′ − u′ₙ)        v′ ← v′ₙ + t·(v′ − v′ₙ)        X = Y·9u′/4v′        Z = Y·(12 − 3u′ − 20v′)/4v′

For t > 1 the ray leaves sRGB and finally the colours that any light can have. Towards blue it even reaches v′ = 0,
where X and Z are infinite: for the sRGB blue at t = 1.5. Chroma is therefore limited to that of the purest light of its
hue, on the spectral locus or the line of purples (CIE 1931 2°), inside which X, Y and Z are never negative.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from holoview.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB, observer_weights
from holoview.util.errors import UserError

_LOCUS_WAVELENGTHS_M = np.arange(390, 701) * 1e-9  # beyond, the chromaticity hardly changes
_PURPLE_LINE_POINTS = 512


def scale_saturation(rgb_linear: NDArray[np.floating], factor: float) -> NDArray[np.float32]:
    """Linear sRGB (…, 3), inside or outside 0…1, with its chroma in LCHuv (white D65) times `factor`; float32.

    0 gives the grey of the same luminance, 1 changes nothing, and above 1 chroma rises up to that of the purest light
    of the hue; colours beyond it already aren't changed then. Luminance is constant.

    Colours without a chromaticity (Y and X + 15Y + 3Z aren't of one sign: black, or imaginary colours) are mixed with
    the grey of their luminance instead, and a factor above 1 doesn't change them.

    Raises UserError for a negative factor, infinity and NaN.
    """
    check_saturation(factor)
    rgb = np.asarray(rgb_linear)
    if factor == 1:
        return rgb.astype(np.float32)
    x, y, z = np.moveaxis(rgb @ SRGB_TO_XYZ.T, -1, 0)
    lit = y * (x + 15 * y + 3 * z) > 0
    u, v = _uv_chromaticity(np.where(lit, x, D65_WHITE[0]), np.where(lit, y, 1), np.where(lit, z, D65_WHITE[2]))
    white_u, white_v = _uv_chromaticity(*D65_WHITE)
    du, dv = u - white_u, v - white_v
    scale = factor if factor < 1 else np.clip(_max_factor(du, dv), 1, factor)
    u, v = white_u + scale * du, white_v + scale * dv
    weight = min(factor, 1.0)
    scaled_x = np.where(lit, y * 9 * u / (4 * v), weight * x + (1 - weight) * y * D65_WHITE[0])
    scaled_z = np.where(lit, y * (12 - 3 * u - 20 * v) / (4 * v), weight * z + (1 - weight) * y * D65_WHITE[2])
    scaled: NDArray[np.float64] = np.stack([scaled_x, y, scaled_z], axis=-1) @ XYZ_TO_SRGB.T
    return scaled.astype(np.float32)


def check_saturation(factor: float) -> None:
    """Raises UserError for a factor that isn't finite and 0 or more."""
    if not 0 <= factor < np.inf:
        raise UserError(
            "saturation", f"{factor:g}", expected="a factor of 0 or more", remedy="0 is grey, 1 changes nothing"
        )


def _uv_chromaticity(
    x: NDArray[np.float64] | float, y: NDArray[np.float64] | float, z: NDArray[np.float64] | float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """CIE 1976 u′, v′."""
    total = np.asarray(x + 15 * y + 3 * z)
    return 4 * x / total, 9 * y / total


def _max_factor(du: NDArray[np.float64], dv: NDArray[np.float64]) -> NDArray[np.float64]:
    """The factor by which each (u′ − u′ₙ, v′ − v′ₙ) reaches the purest light of its hue; infinite for greys."""
    hues, radii = _spectral_boundary()
    radius = np.interp(np.arctan2(dv, du), hues, radii, period=2 * np.pi)
    distance = np.hypot(du, dv)
    return np.divide(radius, distance, out=np.full_like(radius, np.inf), where=distance > 1e-12 * radius)


@cache
def _spectral_boundary() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Hue angle (rad) and distance from white, in (u′, v′), of the spectral locus and the line of purples."""
    u, v = _uv_chromaticity(*observer_weights("cie1931", _LOCUS_WAVELENGTHS_M).T)
    purples = np.linspace(0, 1, _PURPLE_LINE_POINTS)
    locus_u = np.append(u, u[-1] + purples * (u[0] - u[-1])) - _uv_chromaticity(*D65_WHITE)[0]
    locus_v = np.append(v, v[-1] + purples * (v[0] - v[-1])) - _uv_chromaticity(*D65_WHITE)[1]
    return np.arctan2(locus_v, locus_u), np.hypot(locus_u, locus_v)
