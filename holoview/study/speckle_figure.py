"""Draws a region of speckle and its histogram beside the distributions of speckle statistics."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.metrics.speckle import independent_patterns, speckle_density, speckle_histogram
from holoview.numerics.tensors import Region, region_slices

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HIGHEST_QUANTILE = 0.999
_MIN_CONTRAST = 1e-3
"""Contrast below which the gamma distribution is too narrow to be drawn."""


def speckle_figure(luminance: NDArray[np.floating], region: Region, contrast: float) -> Callable[[Figure], None]:
    """A function that draws a region of an image (y, x) and the histogram of I/Ī in it.

    contrast: the region's speckle contrast, which gives the number of independent patterns.
    """
    _, _, width, height = region
    part = np.asarray(luminance[region_slices(region)], dtype=np.float64)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
        left.imshow(part / part.mean(), cmap="gray", vmin=0, vmax=3)
        left.set_title(f"{width} x {height} samples", fontsize=9)
        left.set_axis_off()
        highest = max(float(np.quantile(part / part.mean(), _HIGHEST_QUANTILE)), 2.0)
        histogram = speckle_histogram(luminance, region, max_ratio=highest)
        right.stairs(histogram.density, histogram.edges, fill=True, color="0.7", label="found")
        ratios = np.linspace(0, highest, 400)
        right.plot(ratios, speckle_density(ratios), "--", label="fully developed, C = 1")
        if contrast > _MIN_CONTRAST:
            pattern_count = independent_patterns(contrast)
            label = f"{pattern_count:.1f} patterns, C = {contrast:.2f}"
            right.plot(ratios, speckle_density(ratios, pattern_count), label=label)
        right.set_ylim(top=1.1 * max(1.0, right.get_ylim()[1] if contrast > _MIN_CONTRAST else 1.0))
        right.set_xlabel("intensity / mean")
        right.set_ylabel("probability density")
        right.legend(fontsize=8)

    return draw
