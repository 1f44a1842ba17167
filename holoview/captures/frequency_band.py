"""FFTs between a field and the band of spatial frequencies that a relay passes; other frequencies are skipped.

With an iris most frequencies of a padded grid are zero, and columns outside the band are never transformed. The field
occupies the first samples of the padded grid, wherever the plan puts it: propagation is a convolution, so a shift of
the field within the grid only shifts the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch

from holoview.model.passband import band_of_rows
from holoview.model.plan import Grid
from holoview.model.transfer import Transfer
from holoview.numerics.fft_grid import frequency_indices

Tensor = torch.Tensor


@dataclass(frozen=True)
class FrequencyBand:
    """Frequencies |k_y| ≤ max_indices[0], |k_x| ≤ max_indices[1] of a grid of `padded` (y, x) samples.

    A spectrum in the band is (rows, columns) in FFT order, without the frequencies outside. A maximum of half the grid
    or more stands for all frequencies of that axis.
    """

    padded: tuple[int, int]
    max_indices: tuple[int, int]

    @staticmethod
    def from_transfer(transfer: Transfer, grid: Grid) -> FrequencyBand:
        """The smallest such band that holds all frequencies that a transfer function passes."""
        band = band_of_rows([transfer.support])
        max_y, max_x = (max(0, -low, high) for low, high in zip(band.lowest, band.highest, strict=True))
        return FrequencyBand(grid.padded, (max_y, max_x))

    @property
    def frequency_indices(self) -> tuple[Tensor, Tensor]:
        """Signed frequency indices of the rows and of the columns of a spectrum."""
        (rows, columns), (max_y, max_x) = self.padded, self.max_indices
        return _indices_within(rows, max_y), _indices_within(columns, max_x)

    def forward(self, field: Tensor) -> Tensor:
        """Spectrum (rows, columns) of a field (y, x) that is zero on the rest of the padded grid."""
        lines = _crop_spectrum(torch.fft.fft(field, n=self.padded[1], dim=1), self.padded[1], self.max_indices[1], 1)
        return _crop_spectrum(torch.fft.fft(lines, n=self.padded[0], dim=0), self.padded[0], self.max_indices[0], 0)

    def inverse(self, spectrum: Tensor, shape: tuple[int, int]) -> Tensor:
        """The first `shape` samples (y, x) of the field whose spectrum (rows, columns) is zero outside the band."""
        lines = torch.fft.ifft(_zero_pad_spectrum(spectrum, self.padded[0], self.max_indices[0], 0), dim=0)[: shape[0]]
        return torch.fft.ifft(_zero_pad_spectrum(lines, self.padded[1], self.max_indices[1], 1), dim=1)[:, : shape[1]]


@lru_cache(maxsize=256)
def _indices_within(padded: int, max_index: int) -> Tensor:
    k = torch.from_numpy(frequency_indices(padded))
    return k if 2 * max_index + 1 >= padded else k[k.abs() <= max_index]


def _crop_spectrum(spectrum: Tensor, padded: int, max_index: int, dim: int) -> Tensor:
    if 2 * max_index + 1 >= padded:
        return spectrum
    parts = (spectrum.narrow(dim, 0, max_index + 1), spectrum.narrow(dim, padded - max_index, max_index))
    return torch.cat(parts, dim=dim)


def _zero_pad_spectrum(spectrum: Tensor, padded: int, max_index: int, dim: int) -> Tensor:
    if 2 * max_index + 1 >= padded:
        return spectrum
    shape = list(spectrum.shape)
    shape[dim] = padded
    padded_spectrum = spectrum.new_empty(shape)
    padded_spectrum.narrow(dim, max_index + 1, padded - 2 * max_index - 1).zero_()
    padded_spectrum.narrow(dim, 0, max_index + 1).copy_(spectrum.narrow(dim, 0, max_index + 1))
    padded_spectrum.narrow(dim, padded - max_index, max_index).copy_(spectrum.narrow(dim, max_index + 1, max_index))
    return padded_spectrum
