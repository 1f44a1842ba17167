"""Data of the chromaticity diagram: spectral locus, display primaries, gamut of the lasers, colours of an image.

All are chromaticities x = X/(X+Y+Z), y = Y/(X+Y+Z). For the observer "eye" they are computed from the XYZ_F of the
cone fundamentals (CIE 170-2) and drawn in the same diagram as CIE 1931, from which they differ slightly.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from holoview.colour import observer_weights, to_srgb8, xyz_to_linear_srgb
from holoview.metrics.gamut import chromaticity, convex_hull
from holoview.model.system import System

Floats = NDArray[np.float64]

DISPLAY_PRIMARIES: dict[str, tuple[tuple[float, float], ...]] = {
    "sRGB": ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060)),
    "Display P3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),
}
"""Chromaticities of the primaries red, green, blue: IEC 61966-2-1 and SMPTE EG 432-1."""
D65_XY = (0.3127, 0.3290)
"""Chromaticity of the daylight illuminant D65, CIE 1931."""
_LOCUS_RANGE_M = (390e-9, 700e-9)  # the locus turns back by less than a line's width beyond 700 nm
_MIN_LUMINANCE = 0.01


@cache
def spectral_locus(observer: str = "eye", count: int = 156) -> Floats:
    """Chromaticities (count, 2) of monochromatic light from 390 to 700 nm; CIE 1931 for the observer "mono"."""
    kind = "cie1931" if observer == "mono" else observer
    xy = chromaticity(observer_weights(kind, np.linspace(*_LOCUS_RANGE_M, count)))
    xy.setflags(write=False)
    return xy


def laser_chromaticities(system: System) -> Floats:
    """Chromaticities (wavelength, 2) of the lasers for the system's observer; for the eye if that is "mono"."""
    kind = "eye" if system.observer == "mono" else system.observer
    return chromaticity(observer_weights(kind, system.wavelengths_m))


def laser_gamut(system: System) -> Floats:
    """Corners (n, 2) of the convex hull of the lasers that are on: the colours that they can mix, in order."""
    on = np.any(system.amplitudes > 0, axis=0)
    return convex_hull(laser_chromaticities(system)[on])


def image_chromaticities(xyz: NDArray[np.floating], most: int = 3000) -> tuple[Floats, NDArray[np.uint8]]:
    """Chromaticities (n, 2) and 8-bit sRGB (n, 3) of at most `most` evenly chosen samples of XYZ (y, x, 3).

    Samples with a luminance below 1 % of white are left out, since their chromaticity is mostly noise.
    """
    flat = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    bright = flat[flat[:, 1] > _MIN_LUMINANCE]
    chosen = bright[:: max(-(-len(bright) // most), 1)]
    return chromaticity(chosen), to_srgb8(xyz_to_linear_srgb(chosen))
