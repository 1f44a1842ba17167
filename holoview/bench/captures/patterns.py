"""Random test patterns from smooth to rough, and a measure of how rough a pattern is.

Smooth patterns stay comparable with the model while an error is large: an error decorrelates the speckle of rough
patterns first. Rough patterns are the most sensitive to small errors. Captures should hold both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.dataset import Captures

BLUR_SIGMAS_PX = (6.0, 3.0, 1.5, 0.0)
"""Standard deviations (modulator pixels) of the Gaussian blur; successive captures cycle through them."""


def random_levels(
    rng: np.random.Generator, shape: tuple[int, int], num_levels: int, sigma_px: float
) -> NDArray[np.unsignedinteger]:
    """Grey levels (y, x) of uniform noise blurred by a Gaussian of `sigma_px` pixels and stretched to all levels.

    The smallest value becomes level 0 and the largest num_levels − 1. uint8 up to 256 levels, uint16 beyond.
    """
    values = rng.random(shape)
    if sigma_px > 0:
        values = gaussian_filter(values, sigma_px, mode="reflect")
    values = (values - values.min()) / (values.max() - values.min())
    levels = np.rint(values * (num_levels - 1))
    return levels.astype(np.uint8 if num_levels <= 256 else np.uint16)


def pattern_roughness(captures: Captures) -> NDArray[np.float64]:
    """Roughness of the patterns of each capture, (capture,).

    ⟨(Δ_y d)²⟩ + ⟨(Δ_x d)²⟩ with d the pattern as a fraction of the stroke and Δ the difference between neighbouring
    pixels along y or x; the mean ⟨⟩ is over pixels and modulators.
    """
    result = np.empty(len(captures))
    for capture in range(len(captures)):
        drive = captures.drive(capture)
        result[capture] = np.mean(np.diff(drive, axis=1) ** 2) + np.mean(np.diff(drive, axis=2) ** 2)
    return result
