"""Pictures with speckle of a known contrast, for tests of what must follow it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PATTERNS = (1, 4, 16, 64)
"""Numbers N of independent patterns, whose sums have the contrasts 1, 1/2, 1/4 and 1/8."""


def speckled(picture: NDArray[np.floating], patterns: int, grain: int = 6, seed: int = 0) -> NDArray[np.float64]:
    """A picture (y, x, 3) times the mean of N independent, fully developed speckle patterns, of contrast 1/√N.

    grain: about the size of a grain in samples. Each pattern is the intensity of a circular complex Gaussian field
    whose spectrum fills a disc.
    """
    shape, rng = picture.shape[:2], np.random.default_rng(seed)
    y, x = (np.fft.fftfreq(n) for n in shape)
    inside = np.hypot(y[:, None], x[None, :]) < 0.5 / grain
    total = np.zeros(shape)
    for _ in range(patterns):
        real, imaginary = rng.normal(size=(2, *shape))
        total += np.abs(np.fft.ifft2(inside * (real + 1j * imaginary))) ** 2
    return np.asarray(picture * (total / total.mean())[..., None])


def picture(rows: int = 96, columns: int = 128) -> NDArray[np.float64]:
    """A coloured picture (y, x, 3) with smooth parts and edges, linear sRGB in 0.05…0.7."""
    y, x = np.mgrid[0:rows, 0:columns] / rows
    disc = np.hypot(y - 0.5, x - 0.6) < 0.3
    ramp = np.stack([0.1 + 0.4 * x, 0.15 + 0.3 * y, 0.5 - 0.3 * x], axis=-1)
    return np.clip(np.where(disc[..., None], np.array([0.7, 0.35, 0.1]), ramp), 0.05, 0.7)
