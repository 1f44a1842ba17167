"""The modulator's first diffraction order, |f| ≤ 1/(2·pitch): the eyebox, and the light in blocks of it.

A pixel of u samples sends (sin(πuf)/(u·sin(πf)))² into direction f (cycles a sample; sinc² as u grows), whatever the
pattern: this envelope is divided out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from holoview.model.plan import Grid
from holoview.numerics.fft_grid import frequency_indices

Floats = NDArray[np.float64]

EYEBOX_BLOCKS = 8
"""Blocks along each side of the eyebox."""


@dataclass(frozen=True)
class FirstOrder:
    """Along each axis (y, x): `bins`, the FFT bins of the order from its lower edge up, and their `envelopes`."""

    bins: tuple[NDArray[np.int64], NDArray[np.int64]]
    envelopes: tuple[Floats, Floats]

    def block_matrix(self, axis: int, blocks: int = EYEBOX_BLOCKS) -> Floats:
        """(blocks, bins): takes powers along an axis to means of blocks, the envelope divided out.

        Blocks differ by a bin in size where their number doesn't divide the bins; there are no more than bins.
        """
        count = len(self.bins[axis])
        blocks = min(blocks, count)
        edges = np.arange(blocks + 1) * count // blocks
        matrix = np.zeros((blocks, count))
        for block, (start, stop) in enumerate(pairwise(edges)):
            matrix[block, start:stop] = 1.0 / (stop - start)
        return matrix / self.envelopes[axis]


def first_order(grid: Grid) -> FirstOrder:
    """The first order in the spectrum of a padded grid."""
    bins, envelopes = [], []
    for padded in grid.padded:
        count = padded // grid.upsample
        bins.append((np.arange(count) - count // 2) % padded)
        cycles = frequency_indices(padded)[bins[-1]] / padded
        envelopes.append((np.sinc(grid.upsample * cycles) / np.sinc(cycles)) ** 2)
    return FirstOrder((bins[0], bins[1]), (envelopes[0], envelopes[1]))
