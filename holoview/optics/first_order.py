"""The first diffraction order of a modulator, |f| ≤ 1/(2·pitch), which is the eyebox, divided into blocks.

Whatever the pattern, a pixel of u samples sends power in proportion to (sin(πuf)/(u·sin(πf)))² into the frequency f
(cycles a sample), which is sinc² for large u. This envelope is divided out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from holoview.model.plan import Grid
from holoview.numerics.sampling import frequency_indices

Floats = NDArray[np.float64]

EYEBOX_BLOCKS = 8
"""Number of blocks along each side of the eyebox."""


@dataclass(frozen=True)
class FirstOrder:
    """The bins of the first order in the spectrum of a padded grid, for each axis (y, x).

    bins: FFT bins of the order, from its lower edge upwards.
    envelopes: power envelope of the pixels at these bins.
    """

    bins: tuple[NDArray[np.int64], NDArray[np.int64]]
    envelopes: tuple[Floats, Floats]

    def block_matrix(self, axis: int, blocks: int = EYEBOX_BLOCKS) -> Floats:
        """The matrix (block, bin) from powers along an axis to means over blocks, with the envelope divided out.

        Block sizes differ by one bin where `blocks` doesn't divide the number of bins, which it can't exceed.
        """
        count = len(self.bins[axis])
        blocks = min(blocks, count)
        edges = np.arange(blocks + 1) * count // blocks
        matrix = np.zeros((blocks, count))
        for block, (start, stop) in enumerate(pairwise(edges)):
            matrix[block, start:stop] = 1.0 / (stop - start)
        return matrix / self.envelopes[axis]


def first_order(grid: Grid) -> FirstOrder:
    """The bins of the first order and their envelope for a simulation grid."""
    bins, envelopes = [], []
    for padded in grid.padded:
        count = padded // grid.upsample
        bins.append((np.arange(count) - count // 2) % padded)
        cycles = frequency_indices(padded)[bins[-1]] / padded
        envelopes.append((np.sinc(grid.upsample * cycles) / np.sinc(cycles)) ** 2)
    return FirstOrder((bins[0], bins[1]), (envelopes[0], envelopes[1]))
