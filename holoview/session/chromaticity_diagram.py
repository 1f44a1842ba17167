"""Chromaticities to draw: the horseshoe, the triangles of screens, the polygon of the lasers, the colours of an image.

All are CIE 1931-like (x, y): an eye's XYZ_F is treated as XYZ, as everywhere.
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
"""D65."""
_SPECTRUM_M = (390e-9, 700e-9)  # beyond 700 nm the horseshoe turns back on itself within the width of a line
_DARK = 0.01


@cache
def spectral_locus(observer: str = "eye", count: int = 156) -> Floats:
    """Chromaticities (count, 2) of spectral lights from 390 to 700 nm; CIE 1931 for a mono camera."""
    kind = "cie1931" if observer == "mono" else observer
    xy = chromaticity(observer_weights(kind, np.linspace(*_SPECTRUM_M, count)))
    xy.setflags(write=False)
    return xy


def laser_chromaticities(system: System) -> Floats:
    """Chromaticities (wavelength, 2) of the lasers, as an eye sees them."""
    kind = "eye" if system.observer == "mono" else system.observer
    return chromaticity(observer_weights(kind, system.wavelengths_m))


def laser_gamut(system: System) -> Floats:
    """Corners (n, 2) of all the colours that the lasers that are on can mix, in turn round the edge."""
    on = np.any(system.amplitudes > 0, axis=0)
    return convex_hull(laser_chromaticities(system)[on])


def image_chromaticities(xyz: NDArray[np.floating], most: int = 3000) -> tuple[Floats, NDArray[np.uint8]]:
    """Chromaticities (n, 2) and sRGB colours (n, 3) of at most `most` samples of XYZ (y, x, 3), evenly taken.

    Samples darker than 1 % of white are left out, since noise makes their colour.
    """
    flat = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    bright = flat[flat[:, 1] > _DARK]
    some = bright[:: max(-(-len(bright) // most), 1)]
    return chromaticity(some), to_srgb8(xyz_to_linear_srgb(some))
