"""Where in a region a picture departs from its target further than its speckle does: an object that one of them lacks.

What division by a target leaves is given the normal scores of its ranks, z = Φ⁻¹((rank − ½)/n) ≈ 4.91·(p^0.14 −
(1 − p)^0.14) (Joiner & Rosenblatt, J. Am. Stat. Assoc. 66, 394 (1971)): of mean 0 and variance 1 whatever the law and
the contrast of the speckle, so that a bright grain counts no more than a dark one. Their mean over a square window of m
samples has the variance A/m with A samples a grain, and a normal law as the window holds some grains.

Windows of sides 4, 6, 8, 11, 16 … samples, up to half of the region, each a quarter of its side from the next, are
tried, K of them. By |mean| > √(2·ln(K/α)·A/m), of which a normal law has a chance below α/K, no more than one region of
speckle in a thousand (α = 10⁻³) has a window that is found. A is the largest of (1.4826·median deviation)²·m over the
sides of which 64 windows or more fit into the region, so that an object doesn't count in it, and what is uneven in many
places does. It needs windows of four grains.

Samples of windows that are found stand for what one of the two lacks, and the contrast of the rest for that without it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.speckle import Floats, SpecklePattern
from holoview.light.numerics.sampling import Region

_FALSE_ALARM = 1e-3  # a region
_LEAST_SIDE, _LEAST_WINDOWS, _LEAST_GRAINS = 4, 64, 4
_MAD = 1.4826  # a normal law's standard deviation over the median deviation


@dataclass(frozen=True)
class LocalMisfit:
    """The part of a region that departs from its target, and the contrast of the rest.

    box: (x, y, width, height) around it, in samples of the region. share: of the samples that count.
    """

    box: Region
    share: float
    contrast: float


@dataclass(frozen=True, eq=False)
class _Windows:
    """The windows of a side that are tried, (y, x). means: of the scores, times the root of the samples that count."""

    side: int
    step: int
    means: Floats
    is_full: NDArray[np.bool_]


def local_misfit(pattern: SpecklePattern) -> LocalMisfit | None:
    """The part of what division by a target leaves that speckle doesn't make; None without one, or of few grains."""
    usable = pattern.usable
    scores = np.zeros(usable.shape)
    scores[usable] = _normal_scores(pattern.counted)
    tried = list(_windows(scores, usable))
    count = sum(int(of.is_full.sum()) for of in tried)
    area, largest = 0.0, 0
    for of in tried:
        if _LEAST_WINDOWS * of.side**2 <= usable.size and of.is_full.any():
            means = of.means[of.is_full]
            area = max(area, (_MAD * float(np.median(np.abs(means - np.median(means))))) ** 2)
            largest = of.side**2
    if not 0 < _LEAST_GRAINS * area <= largest:
        return None
    limit = math.sqrt(2 * math.log(count / _FALSE_ALARM) * area)
    edges = np.zeros((usable.shape[0] + 1, usable.shape[1] + 1))  # of the windows found, whose sums are their number
    for of in tried:
        y, x = (of.step * k for k in np.nonzero(of.is_full & (np.abs(of.means) > limit)))
        for down, right, sign in ((0, 0, 1), (of.side, of.side, 1), (of.side, 0, -1), (0, of.side, -1)):
            np.add.at(edges, (y + down, x + right), sign)
    found = usable & (edges.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0.5)
    rest = pattern.values[usable & ~found]
    if not found.any() or rest.size < 2 or not rest.mean() > 0:
        return None
    rows, columns = (np.flatnonzero(found.any(axis=axis)) for axis in (1, 0))
    box = (int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
    return LocalMisfit(box, float(found.sum() / usable.sum()), float(rest.std() / rest.mean()))


def _normal_scores(values: Floats) -> Floats:
    """The normal scores of the ranks of values (n,); equal values have their mean rank."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    below = (np.cumsum(counts) - counts / 2) / values.size
    return np.asarray((4.91 * (below**0.14 - (1 - below) ** 0.14))[place])


def _windows(scores: Floats, usable: NDArray[np.bool_]) -> list[_Windows]:
    """The windows of each side. scores: (y, x), 0 where not usable; a window is full where half of it is."""
    sums = [np.pad(of, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1) for of in (scores, usable.astype(np.float64))]
    found, k = list[_Windows](), 0
    while (width := _LEAST_SIDE * 2 ** (k / 2)) <= min(usable.shape) // 2:
        side, k = round(width), k + 1
        step = max(side // 4, 1)
        corners = [(of[side:, side:], of[:-side, side:], of[side:, :-side], of[:-side, :-side]) for of in sums]
        inside, counts = ((a - b - c + d)[::step, ::step] for a, b, c, d in corners)
        found.append(_Windows(side, step, inside / np.sqrt(np.maximum(counts, 1)), 2 * counts >= side**2))
    return found
