"""Colour maps of 256 colours for single-channel images: false colour, phase, signed differences.

grey: linear in the sRGB code. cubehelix: perceived brightness rises monotonically while the hue rotates (Green, Bull.
Astr. Soc. India 39, 289, 2011). hue: cyclic, for phases. signed: diverging, white in the middle, blue below, red above.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

NAMES = ("grey", "cubehelix", "hue", "signed")
_COUNT = 256
_START, _ROTATIONS = 0.5, -1.5  # Green's default: starts with blue, one and a half rotations
_HELIX = np.array([[-0.14861, 1.78277], [-0.29227, -0.90649], [1.97294, 0.0]])  # Green 2011, equation 2


@cache
def colour_map(name: str) -> NDArray[np.uint8]:
    """The colour map (256, 3) in 8-bit sRGB, read-only. Raises KeyError for a name that isn't in NAMES."""
    tables = {"grey": _grey, "cubehelix": _cubehelix, "hue": _hue, "signed": _diverging}
    table = np.rint(255 * np.clip(tables[name](np.linspace(0.0, 1.0, _COUNT)), 0, 1)).astype(np.uint8)
    table.setflags(write=False)
    return table


def _grey(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.repeat(share[:, None], 3, axis=1)


def _cubehelix(share: NDArray[np.float64]) -> NDArray[np.float64]:
    angle = 2 * np.pi * (_START / 3 + 1 + _ROTATIONS * share)
    turn = np.stack([np.cos(angle), np.sin(angle)])
    helix: NDArray[np.float64] = share[:, None] + (share * (1 - share) / 2)[:, None] * (_HELIX @ turn).T
    return helix


def _hue(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Three cosines with phases a third of a turn apart: cyclic, with a constant sum."""
    return 0.5 + 0.5 * np.cos(2 * np.pi * (share[:, None] - np.array([0.0, 1 / 3, 2 / 3])))


def _diverging(share: NDArray[np.float64]) -> NDArray[np.float64]:
    below, above = np.clip(2 * share, 0, 1)[:, None], np.clip(2 - 2 * share, 0, 1)[:, None]
    blue, red = np.array([0.13, 0.30, 0.70]), np.array([0.72, 0.12, 0.16])
    return np.where(share[:, None] < 0.5, blue + (1 - blue) * below, red + (1 - red) * above)
