"""From XYZ to what is seen on the screen, as the look says; the viewport's shader does the same.

value = (channel · 2^exposure − low) / (high − low), clipped to 0…1
code  = sRGB curve of the value, to the power 1/gamma; through the palette where false colour is asked for
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.colour import LMS_TO_XYZ, XYZ_TO_SRGB, srgb_encode
from holoview.session.colour_maps import colour_map
from holoview.session.view_settings import ViewSettings

_LMS = np.linalg.inv(LMS_TO_XYZ)
_ROWS = {
    "luminance": np.array([0.0, 1.0, 0.0]),
    **{name: np.eye(3)[i] for i, name in enumerate("XYZ")},
    **{name: XYZ_TO_SRGB[i] for i, name in enumerate("RGB")},
    **{name: _LMS[i] / _LMS[i].sum() for i, name in enumerate("LMS")},
}


def channel_matrix(channel: str) -> NDArray[np.float64]:
    """The matrix (3, 3) or, for a single channel, (1, 3) that takes XYZ to what is shown; L, M, S are 1 for E white."""
    return XYZ_TO_SRGB if channel == "colour" else _ROWS[channel][None]


def tone_map(xyz: NDArray[np.floating], view_settings: ViewSettings) -> NDArray[np.uint8]:
    """8-bit sRGB (y, x, 3) of XYZ (y, x, 3) as the look says."""
    matrix = channel_matrix(view_settings.channel) * 2.0**view_settings.exposure_stops
    values = (np.asarray(xyz, dtype=np.float32) @ matrix.T.astype(np.float32) - view_settings.low) / (
        view_settings.high - view_settings.low
    )
    levels = _levels(values, view_settings)
    if view_settings.channel == "colour":
        return levels
    return colour_map(view_settings.false_colour or "grey")[levels[..., 0]]


def compose_comparison(
    a: NDArray[np.floating], b: NDArray[np.floating] | None, view_settings: ViewSettings
) -> NDArray[np.uint8]:
    """8-bit sRGB of two sides, XYZ (y, x, 3) of equal shape, as the look compares them; of `a` alone without `b`.

    A wipe shows `a` left of its line. A difference shows |a − b|; for a single channel a − b from blue to red.
    """
    if view_settings.compare == "off" or b is None or a.shape != b.shape:
        return tone_map(a, view_settings)
    if view_settings.compare == "difference":
        return _difference(a, b, view_settings)
    left, right = tone_map(a, view_settings), tone_map(b, view_settings)
    if view_settings.compare == "side-by-side":
        return np.concatenate([left, right], axis=1)
    if view_settings.compare == "wipe":
        edge = round(view_settings.wipe * a.shape[1])
        return np.concatenate([left[:, :edge], right[:, edge:]], axis=1)
    return left


def _difference(a: NDArray[np.floating], b: NDArray[np.floating], look: ViewSettings) -> NDArray[np.uint8]:
    """Blacks cancel, so that only the distance from black to white counts."""
    matrix = channel_matrix(look.channel) * 2.0**look.exposure_stops / (look.high - look.low)
    difference = (np.asarray(a, dtype=np.float64) - b) @ matrix.T
    if look.channel == "colour":
        return _levels(np.abs(difference), look)
    return colour_map("signed")[np.rint(255 * np.clip(0.5 + 0.5 * difference[..., 0], 0, 1)).astype(np.uint8)]


def _levels(values: NDArray[np.floating], look: ViewSettings) -> NDArray[np.uint8]:
    codes = srgb_encode(np.clip(values, 0, 1)) ** (1 / look.gamma)
    return np.rint(255 * codes).astype(np.uint8)
