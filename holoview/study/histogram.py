"""A region of speckle as a picture, and its histogram beside the laws of speckle.

Fully developed, polarised speckle: p(I) = exp(−I/μ)/μ. The sum of N independent, equally bright patterns follows a
gamma law of shape N (Goodman, *Speckle Phenomena in Optics*, 2007, eq. 3-43); N = 1/C² is that of the contrast found.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import gamma

from holoview.metrics.speckle import Region, independent_patterns

_BINS = 60
_HIGHEST_QUANTILE = 0.999
_FLATTEST = 1e-3
"""Contrast below which there is no law to draw."""


def draw_histogram(luminance: NDArray[np.floating], region: Region, contrast: float) -> Callable[[Figure], None]:
    """Draws the region of (y, x) and the histogram of I/μ in it."""
    x, y, width, height = region
    part = np.asarray(luminance[y : y + height, x : x + width], dtype=np.float64)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
        left.imshow(part / part.mean(), cmap="gray", vmin=0, vmax=3)
        left.set_title(f"{width} x {height} samples", fontsize=9)
        left.set_axis_off()
        relative = part.ravel() / part.mean()
        highest = max(float(np.quantile(relative, _HIGHEST_QUANTILE)), 2.0)
        right.hist(relative, bins=_BINS, range=(0, highest), density=True, color="0.7", label="found")
        at = np.linspace(0, highest, 400)
        right.plot(at, np.exp(-at), "--", label="fully developed, C = 1")
        if contrast > _FLATTEST:
            shape = independent_patterns(contrast)
            right.plot(at, gamma.pdf(at, shape, scale=1 / shape), label=f"{shape:.1f} patterns, C = {contrast:.2f}")
        right.set_ylim(top=1.1 * max(1.0, right.get_ylim()[1] if contrast > _FLATTEST else 1.0))
        right.set_xlabel("intensity / mean")
        right.set_ylabel("probability density")
        right.legend(fontsize=8)

    return draw
