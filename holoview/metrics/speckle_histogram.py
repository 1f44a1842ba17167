"""Histogram of speckle intensity and the gamma distribution that it should follow.

Fully developed, polarised speckle of one laser is exponentially distributed: p(s) = exp(−s) for s = I/Ī. The sum of N
independent patterns of equal mean has a gamma distribution of shape N; that of patterns with unequal means m has nearly
the one of shape N = (Σm)²/Σm² (Goodman, *Speckle Phenomena in Optics*, 2007, sections 3.2 and 3.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.numerics.image_region import Region, region_slices
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpeckleHistogram:
    """Probability density of I/Ī in bins (n,).

    edges: of the bins (n + 1,). density: measured (n,). pattern_count: number of independent patterns expected.
    """

    edges: Floats
    density: Floats
    pattern_count: float

    @cached_property
    def centres(self) -> Floats:
        """Centres of the bins (n,)."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    @cached_property
    def fully_developed_density(self) -> Floats:
        """The density of fully developed speckle of one laser at the centres (n,)."""
        return speckle_density(self.centres)

    @cached_property
    def expected_density(self) -> Floats:
        """The density of the sum of `pattern_count` independent patterns at the centres (n,)."""
        return speckle_density(self.centres, self.pattern_count)


def speckle_density(relative_intensity: ArrayLike, pattern_count: float = 1.0) -> Floats:
    """Probability density of s = I/Ī for the sum of N independent speckle patterns of equal mean; N may be fractional.

    It is N^N·s^(N−1)·exp(−N·s)/Γ(N) for s ≥ 0, and 0 below.
    """
    count, s = pattern_count, np.asarray(relative_intensity, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        powers = np.zeros_like(s) if count == 1.0 else (count - 1.0) * np.log(s)
    return np.where(s >= 0, np.exp(count * math.log(count) - math.lgamma(count) - count * s + powers), 0.0)


def speckle_histogram(
    luminance: NDArray[np.floating], region: Region, pattern_count: float = 1.0, bins: int = 60, max_ratio: float = 4.0
) -> SpeckleHistogram:
    """The histogram of a region of an image (y, x) over the region's mean, from 0 to `max_ratio`.

    Raises UserError for a region without light.
    """
    values = np.asarray(luminance[region_slices(region)], dtype=np.float64).ravel()
    mean = float(values.mean()) if values.size else 0.0
    if not mean > 0:
        raise UserError("region", "no light in it", remedy="choose a brighter region")
    counts, edges = np.histogram(values / mean, bins=bins, range=(0.0, max_ratio))
    return SpeckleHistogram(edges, counts / (values.size * (edges[1] - edges[0])), pattern_count)
