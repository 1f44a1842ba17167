"""The histogram of speckle beside the law that it should follow.

Fully developed, polarised speckle of one laser is exponentially distributed: p(s) = exp(−s) for s = I/Ī. The sum of N
independent patterns of equal mean follows a gamma law of shape N, and so nearly does one of unequal means m with
N = (Σm)²/Σm² (Goodman, *Speckle Phenomena in Optics*, 2007, sections 3.2 and 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from holoview.numerics.image_region import Region, region_slices
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpeckleHistogram:
    """Density of I/Ī in bins between `edges` (n + 1,), and the law of fully developed speckle at their `centres` (n,).

    expected: the law of as many independent patterns as `patterns` says.
    """

    edges: Floats
    density: Floats
    pattern_count: float

    @cached_property
    def centres(self) -> Floats:
        """The middles of the bins (n,)."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    @cached_property
    def fully_developed_density(self) -> Floats:
        """Fully developed speckle of one laser, at the centres."""
        return speckle_density(self.centres)

    @cached_property
    def expected_density(self) -> Floats:
        """As many independent patterns as `patterns` says, at the centres."""
        return speckle_density(self.centres, self.pattern_count)


def speckle_density(relative_intensity: ArrayLike, pattern_count: float = 1.0) -> Floats:
    """Probability density of I/Ī in the sum of independent, equally bright speckle patterns; needn't be whole."""
    return np.asarray(stats.gamma.pdf(relative_intensity, pattern_count, scale=1 / pattern_count), dtype=np.float64)


def speckle_histogram(
    luminance: NDArray[np.floating], region: Region, pattern_count: float = 1.0, bins: int = 60, max_ratio: float = 4.0
) -> SpeckleHistogram:
    """The histogram of a region of (y, x) over its mean, up to `most` times that. Raises UserError if it is dark."""
    values = np.asarray(luminance[region_slices(region)], dtype=np.float64).ravel()
    mean = float(values.mean()) if values.size else 0.0
    if not mean > 0:
        raise UserError("region", "no light in it", remedy="choose a brighter region")
    counts, edges = np.histogram(values / mean, bins=bins, range=(0.0, max_ratio))
    return SpeckleHistogram(edges, counts / (values.size * (edges[1] - edges[0])), pattern_count)
