"""FFTs between a field in space and the frequencies that a relay lets through, everything else skipped.

With an iris, most frequencies of a padded grid carry nothing: columns outside the band are never transformed. The field
counts as the first samples of the padded grid; free space doesn't mind where in it the field lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch

from holoview.model.plan import Grid, Transfer
from holoview.numerics.fft_grid import frequency_indices

Tensor = torch.Tensor


@dataclass(frozen=True)
class FrequencyBand:
    """Frequencies |k_y| ≤ reach[0], |k_x| ≤ reach[1] of a padded grid, in FFT order: (rows, columns) of a spectrum."""

    padded: tuple[int, int]
    max_indices: tuple[int, int]

    @staticmethod
    def from_transfer(transfer: Transfer, grid: Grid) -> FrequencyBand:
        """The smallest band that holds all that a transfer function lets through."""
        lit = np.flatnonzero(transfer.support[:, 1] >= 0)
        highest = int(np.abs(frequency_indices(grid.padded[0])[lit]).max(initial=0))
        widest = int(transfer.support[:, 1].max(initial=0))
        return FrequencyBand(grid.padded, (highest, widest))

    @property
    def frequency_indices(self) -> tuple[Tensor, Tensor]:
        """Signed frequency indices of rows and of columns."""
        return _indices_within(self.padded[0], self.max_indices[0]), _indices_within(
            self.padded[1], self.max_indices[1]
        )

    def forward(self, field: Tensor) -> Tensor:
        """Spectrum (rows, columns) of a field (y, x), zero outside it."""
        lines = _crop_spectrum(torch.fft.fft(field, n=self.padded[1], dim=1), self.padded[1], self.max_indices[1], 1)
        return _crop_spectrum(torch.fft.fft(lines, n=self.padded[0], dim=0), self.padded[0], self.max_indices[0], 0)

    def inverse(self, spectrum: Tensor, shape: tuple[int, int]) -> Tensor:
        """The first `shape` samples (y, x) of the field of a spectrum."""
        lines = torch.fft.ifft(_zero_pad_spectrum(spectrum, self.padded[0], self.max_indices[0], 0), dim=0)[: shape[0]]
        return torch.fft.ifft(_zero_pad_spectrum(lines, self.padded[1], self.max_indices[1], 1), dim=1)[:, : shape[1]]


@lru_cache(maxsize=256)
def _indices_within(padded: int, reach: int) -> Tensor:
    k = torch.from_numpy(frequency_indices(padded))
    return k if 2 * reach + 1 >= padded else k[k.abs() <= reach]


def _crop_spectrum(spectrum: Tensor, padded: int, reach: int, dim: int) -> Tensor:
    if 2 * reach + 1 >= padded:
        return spectrum
    parts = (spectrum.narrow(dim, 0, reach + 1), spectrum.narrow(dim, padded - reach, reach))
    return torch.cat(parts, dim=dim)


def _zero_pad_spectrum(spectrum: Tensor, padded: int, reach: int, dim: int) -> Tensor:
    if 2 * reach + 1 >= padded:
        return spectrum
    shape = list(spectrum.shape)
    shape[dim] = padded
    whole = spectrum.new_empty(shape)
    whole.narrow(dim, reach + 1, padded - 2 * reach - 1).zero_()
    whole.narrow(dim, 0, reach + 1).copy_(spectrum.narrow(dim, 0, reach + 1))
    whole.narrow(dim, padded - reach, reach).copy_(spectrum.narrow(dim, reach + 1, reach))
    return whole
