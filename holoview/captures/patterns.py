"""Patterns to measure with: random, from smooth to rough. Smooth ones still tell what is wrong where much is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

BLUR_SIGMAS_PX = (6.0, 3.0, 1.5, 0.0)
"""Standard deviations (pixels) of the blurs of random patterns, in turn."""


def random_levels(
    rng: np.random.Generator, shape: tuple[int, int], num_levels: int, sigma_px: float
) -> NDArray[np.unsignedinteger]:
    """Levels (y, x) of blurred noise that use the whole range; uniform noise where sigma_px is 0."""
    values = rng.random(shape)
    if sigma_px > 0:
        values = gaussian_filter(values, sigma_px, mode="reflect")
    values = (values - values.min()) / (values.max() - values.min())
    levels = np.rint(values * (num_levels - 1))
    return levels.astype(np.uint8 if num_levels <= 256 else np.uint16)
