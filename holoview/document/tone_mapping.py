"""Tone mapping: from XYZ to 8-bit sRGB as the view settings say; the viewport's shader computes the same.

    value = (channel · 2^exposure − low) / (high − low), clipped to 0…1
    code  = sRGB transfer function of the value, to the power 1/gamma

A single channel is shown in grey or through a colour map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.colour import LMS_TO_XYZ, XYZ_TO_SRGB, srgb_encode
from holoview.document.colour_maps import colour_map
from holoview.document.view_settings import ViewSettings

_LMS = np.linalg.inv(LMS_TO_XYZ)
_ROWS = {
    "luminance": np.array([0.0, 1.0, 0.0]),
    **{name: np.eye(3)[i] for i, name in enumerate("XYZ")},
    **{name: XYZ_TO_SRGB[i] for i, name in enumerate("RGB")},
    **{name: _LMS[i] / _LMS[i].sum() for i, name in enumerate("LMS")},
}


def channel_matrix(channel: str) -> NDArray[np.float64]:
    """The matrix from XYZ to linear sRGB (3, 3), or to a channel (1, 3); L, M, S of equal-energy white are 1."""
    return XYZ_TO_SRGB if channel == "colour" else _ROWS[channel][None]


def tone_map(xyz: NDArray[np.floating], view: ViewSettings) -> NDArray[np.uint8]:
    """8-bit sRGB (y, x, 3) of XYZ (y, x, 3)."""
    matrix = channel_matrix(view.channel) * 2.0**view.exposure_stops
    values = (np.asarray(xyz, dtype=np.float32) @ matrix.T.astype(np.float32) - view.low) / (view.high - view.low)
    levels = _levels(values, view)
    if view.channel == "colour":
        return levels
    return colour_map(view.false_colour or "grey")[levels[..., 0]]


def compose_comparison(
    a: NDArray[np.floating], b: NDArray[np.floating] | None, view: ViewSettings
) -> NDArray[np.uint8]:
    """8-bit sRGB of two images XYZ (y, x, 3) as the view settings compare them.

    Shows `a` alone without a comparison, without `b`, and for different shapes. A wipe shows `a` left of its line. A
    difference shows |a − b| in colour; for a single channel a − b from blue to red.
    """
    if view.compare == "off" or b is None or a.shape != b.shape:
        return tone_map(a, view)
    if view.compare == "difference":
        return _difference(a, b, view)
    left, right = tone_map(a, view), tone_map(b, view)
    if view.compare == "side-by-side":
        return np.concatenate([left, right], axis=1)
    if view.compare == "wipe":
        edge = round(view.wipe * a.shape[1])
        return np.concatenate([left[:, :edge], right[:, edge:]], axis=1)
    return left


def _difference(a: NDArray[np.floating], b: NDArray[np.floating], view: ViewSettings) -> NDArray[np.uint8]:
    """The difference of both images; `low` cancels, so that only the span from `low` to `high` matters."""
    matrix = channel_matrix(view.channel) * 2.0**view.exposure_stops / (view.high - view.low)
    difference = (np.asarray(a, dtype=np.float64) - b) @ matrix.T
    if view.channel == "colour":
        return _levels(np.abs(difference), view)
    return colour_map("signed")[np.rint(255 * np.clip(0.5 + 0.5 * difference[..., 0], 0, 1)).astype(np.uint8)]


def _levels(values: NDArray[np.floating], view: ViewSettings) -> NDArray[np.uint8]:
    codes = srgb_encode(np.clip(values, 0, 1)) ** (1 / view.gamma)
    return np.rint(255 * codes).astype(np.uint8)
