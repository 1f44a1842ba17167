"""Converts float images (linear sRGB, CIE XYZ, or the primaries that the file states) to linear sRGB.

The result isn't limited to 0…1. Nothing is lost, since XYZ ↔ linear sRGB is one to one: a colour outside the triangle
of the sRGB primaries has a negative channel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.colour import D65_WHITE, XYZ_TO_SRGB, xyz_to_linear_srgb
from holoview.targets.raster import Chromaticities, Raster
from holoview.util.errors import UserError

COLOUR_SPACES = ("srgb", "xyz")
"""Interpretations of a float file's three channels: linear sRGB, or CIE XYZ with Y = 1 the display's white (D65)."""

_XYZ_PRIMARIES = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))
"""Chromaticities by which OpenEXR files say that they hold XYZ."""

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""XYZ to the sharpened cone responses of the Bradford adaptation (Lam 1985; ICC.1:2010, annex E)."""


def to_linear_srgb(
    where: str, raster: Raster, light: NDArray[np.float64], space: str = "srgb"
) -> tuple[NDArray[np.float64], str]:
    """Light (y, x, 1 or 3) of a raster as linear sRGB of the same shape, and a note on what was done, or "".

    `space` "xyz" overrides the primaries that the file states. Raises UserError, located at `where`, for another space,
    for "xyz" without three float channels, and for primaries that can't make white.
    """
    if space not in COLOUR_SPACES:
        raise UserError("space", f'"{space}"', expected=" or ".join(COLOUR_SPACES))
    primaries = raster.primaries
    if space == "xyz":
        if raster.encoded or light.shape[-1] != 3:
            found = "holds integers, a display signal" if raster.encoded else "has one channel"
            remedy = "save it as float TIFF or OpenEXR, or read it as sRGB"
            raise UserError(where, found, expected="three float channels of CIE XYZ", remedy=remedy)
        ignored = "" if primaries is None or _is_xyz(primaries) else "; the chromaticities in its header are ignored"
        return xyz_to_linear_srgb(light), f"CIE XYZ converted to linear sRGB{ignored}"
    if primaries is None:
        return light, ""
    if _is_xyz(primaries):
        return xyz_to_linear_srgb(light), "CIE XYZ, as its header says, converted to linear sRGB"
    return light @ srgb_from_primaries(where, primaries).T, "converted from the file's own primaries"


def srgb_from_primaries(where: str, chromaticities: Chromaticities) -> NDArray[np.float64]:
    """The matrix (3, 3) from linear light of other primaries to linear sRGB, which maps their white to D65.

    `chromaticities`: (x, y) of red, green, blue and white; SMPTE RP 177 gives the matrix to XYZ. A white other than D65
    is adapted in Bradford's cone space. Raises UserError when the primaries lie on a line, or can't make the white.
    """
    corners = np.array([(x, y, 1 - x - y) for x, y in chromaticities], dtype=np.float64)
    primaries, white = corners[:3].T, corners[3]
    if len(corners) != 4 or not np.isfinite(corners).all() or abs(np.linalg.det(primaries)) < 1e-6 or white[1] <= 0:
        pairs = ", ".join(f"({x:g}, {y:g})" for x, y in chromaticities)
        raise UserError(
            where,
            f"its header states the chromaticities {pairs}",
            expected="red, green, blue and white that span a triangle",
            remedy="export it with other primaries, or without any for sRGB",
        )
    white = white / white[1]
    to_xyz = primaries * np.linalg.solve(primaries, white)
    gains = (_BRADFORD @ D65_WHITE) / (_BRADFORD @ white)
    matrix: NDArray[np.float64] = XYZ_TO_SRGB @ np.linalg.solve(_BRADFORD, gains[:, None] * _BRADFORD) @ to_xyz
    return matrix


def _is_xyz(chromaticities: Chromaticities) -> bool:
    return bool(np.allclose(chromaticities[:3], _XYZ_PRIMARIES, atol=1e-6))
