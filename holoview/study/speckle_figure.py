"""A region of speckle as a picture, and its histogram beside the laws of speckle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from holoview.metrics.speckle import independent_patterns
from holoview.metrics.speckle_histogram import speckle_density, speckle_histogram
from holoview.numerics.image_region import Region, region_slices

_HIGHEST_QUANTILE = 0.999
_MIN_CONTRAST = 1e-3
"""Contrast below which there is no law to draw."""


def speckle_figure(luminance: NDArray[np.floating], region: Region, contrast: float) -> Callable[[Figure], None]:
    """Draws the region of (y, x) and the histogram of I/Ī in it."""
    _, _, width, height = region
    part = np.asarray(luminance[region_slices(region)], dtype=np.float64)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
        left.imshow(part / part.mean(), cmap="gray", vmin=0, vmax=3)
        left.set_title(f"{width} x {height} samples", fontsize=9)
        left.set_axis_off()
        highest = max(float(np.quantile(part / part.mean(), _HIGHEST_QUANTILE)), 2.0)
        found = speckle_histogram(luminance, region, max_ratio=highest)
        right.stairs(found.density, found.edges, fill=True, color="0.7", label="found")
        at = np.linspace(0, highest, 400)
        right.plot(at, speckle_density(at), "--", label="fully developed, C = 1")
        if contrast > _MIN_CONTRAST:
            shape = independent_patterns(contrast)
            right.plot(at, speckle_density(at, shape), label=f"{shape:.1f} patterns, C = {contrast:.2f}")
        right.set_ylim(top=1.1 * max(1.0, right.get_ylim()[1] if contrast > _MIN_CONTRAST else 1.0))
        right.set_xlabel("intensity / mean")
        right.set_ylabel("probability density")
        right.legend(fontsize=8)

    return draw
