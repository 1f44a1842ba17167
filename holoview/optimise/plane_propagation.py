"""From the spectra behind the last modulator to the fields at a focal plane, and back: the part that planes repeat.

    E = [F⁻¹ H W],  c_W += H·F⁻¹c_E

Both ways are a multiplication by H, an FFT along y in blocks of columns, and one along x in blocks of rows. The band
lies at the first bins of the FFT, so that the zeros that it is padded with lie behind it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import torch

from holoview.numerics.pruned_fft import PrunedAxis
from holoview.optimise.beam_blocks import ZeroTails
from holoview.optimise.beam_fields import BeamFields
from holoview.optimise.spectral_axes import SpectralAxis

Tensor = torch.Tensor
Result = TypeVar("Result")


class PlanePropagation:
    """Transforms of blocks. Transfer functions contain 1/(P_y·P_x), so that inverse FFTs aren't normalised."""

    def __init__(self, axes: tuple[SpectralAxis, SpectralAxis]) -> None:
        self._y, self._x = (axis.last for axis in axes)
        assert self._y.lowest == self._x.lowest == 0
        self._zero_tails = ZeroTails()

    def to_plane(self, fields: BeamFields, block: int, transfer: Tensor) -> None:
        """Writes a block of columns of a plane's lines. transfer (laser, 1, k_y, k_x): H in this block."""
        spectrum = fields.spectra.blocks[block]
        padded = self._zero_tails.buffer(spectrum, -2, self._y.padded)
        torch.mul(spectrum, transfer, out=padded.narrow(-2, 0, self._y.frequencies))
        lines = fields.plane_lines[..., fields.spectra.columns[block]]
        lines.copy_(_inverse_fft(padded, -2).narrow(-2, 0, self._y.count))

    def carry_back(self, fields: BeamFields, block: int, transfer: Tensor) -> Tensor:
        """Adds a plane's part to a block of columns of c_W. Returns that part without H."""
        lines = self._padded(fields.plane_lines[..., fields.spectra.columns[block]], -2, self._y)
        adjoint = _inverse_fft(lines, -2).narrow(-2, 0, self._y.frequencies)
        fields.adjoint_spectra.blocks[block].addcmul_(adjoint, transfer)
        return adjoint

    def process_rows(self, lines: Tensor, process: Callable[[Tensor], Result], *, carry_back: bool) -> Result:
        """Calls a function with the fields of lines (laser, source, row, k_x); carry_back: back to lines again."""
        padded = lines
        if self._x.frequencies < self._x.padded:
            padded = self._zero_tails.buffer(lines, -1, self._x.padded)
            padded.narrow(-1, 0, self._x.frequencies).copy_(lines)
        whole = _inverse_fft(padded, -1)
        result = process(whole.narrow(-1, 0, self._x.count))
        if carry_back:
            whole.narrow(-1, self._x.count, self._x.padded - self._x.count).zero_()
            lines.copy_(_inverse_fft(whole, -1).narrow(-1, 0, self._x.frequencies))
        return result

    def _padded(self, lines: Tensor, dim: int, axis: PrunedAxis) -> Tensor:
        """Lines of samples with zeros behind them."""
        if axis.count == axis.padded:
            return lines
        padded = self._zero_tails.buffer(lines, dim, axis.padded)
        padded.narrow(dim, 0, axis.count).copy_(lines)
        return padded


def _inverse_fft(values: Tensor, dim: int) -> Tensor:
    """Σ_k X_k·exp(2πi·k·n/P), which is its own transpose; no lines give no lines."""
    return torch.fft.ifft(values, dim=dim, norm="forward") if values.numel() else values.clone()
