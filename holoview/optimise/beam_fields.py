"""What an evaluation keeps of its beams, laid out for the operations on it.

Spectra are stored in blocks of columns, each one piece of memory, because transforms along y take one block after the
other. Lines, which are transformed along one axis only, are stored by rows of all beams, because those along x do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from holoview.optimise.beam_blocks import BeamGroup
from holoview.optimise.spectral_axes import SpectralAxis

Tensor = torch.Tensor

_ROW_MARGIN = 8  # samples between rows: columns of rows whose length is a power of 2 compete for the same cache lines


@dataclass(frozen=True)
class ColumnBlocks:
    """Spectra (laser, source, k_y, k_x) in blocks of columns: slices of k_x, and a tensor for each."""

    columns: list[slice]
    blocks: list[Tensor]

    def read(self, columns: slice) -> Tensor:
        """Some columns, (laser, source, k_y, column)."""
        parts = [block[..., inner] for block, inner, _ in self._overlaps(columns)]
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim=-1)

    def write(self, columns: slice, values: Tensor) -> None:
        """Replaces some columns by values (laser, source, k_y, column), which are broadcast."""
        for block, inner, outer in self._overlaps(columns):
            block[..., inner] = values[..., outer]

    def add(self, columns: slice, values: Tensor) -> None:
        """Adds values (laser, source, k_y, column) to some columns."""
        for block, inner, outer in self._overlaps(columns):
            block[..., inner] += values[..., outer]

    def of_beam(self, laser: int, source: int) -> ColumnBlocks:
        """The spectrum of one beam, whose indices count from the first of these."""
        return ColumnBlocks(self.columns, [block[laser, source] for block in self.blocks])

    @property
    def whole(self) -> Tensor:
        """All columns, a copy unless there is only one block."""
        return self.blocks[0] if len(self.blocks) == 1 else torch.cat(self.blocks, dim=-1)

    def zero_(self) -> None:
        """Sets all to zero."""
        for block in self.blocks:
            block.zero_()

    def zeros_like(self) -> ColumnBlocks:
        """Zeros in the same blocks."""
        return ColumnBlocks(self.columns, [torch.zeros_like(block) for block in self.blocks])

    def _overlaps(self, columns: slice) -> Iterator[tuple[Tensor, slice, slice]]:
        """Blocks that hold some of the columns, the part of each, and where it lies among the columns."""
        for block, part in zip(self.blocks, self.columns, strict=True):
            start, stop = max(part.start, columns.start), min(part.stop, columns.stop)
            if start < stop:
                outer = slice(start - columns.start, stop - columns.start)
                yield block, slice(start - part.start, stop - part.start), outer


@dataclass(frozen=True)
class BeamFields:
    """Fields of a group of beams, complex.

    spectra, adjoint_spectra: W and c_W. plane_lines (laser, source, y, k_x): behind the last modulator, and then at the
    present plane. gap_lines (laser, source, y, k_x): at modulator 2; None for one modulator.
    """

    group: BeamGroup
    spectra: ColumnBlocks
    adjoint_spectra: ColumnBlocks
    plane_lines: Tensor
    gap_lines: Tensor | None


def make_lines(beams: tuple[int, int], rows: int, frequencies: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Lines (laser, source, row, frequency) of zeros."""
    return torch.zeros(*beams, rows, frequencies + _ROW_MARGIN, dtype=dtype, device=device)[..., :frequencies]


def make_beam_fields(
    group: BeamGroup,
    axes: tuple[SpectralAxis, SpectralAxis],
    columns: list[slice],
    plane_lines: Tensor,
    has_second_modulator: bool,
) -> BeamFields:
    """The fields of a group; plane_lines (laser, source, y, k_x): of all beams."""
    y, x = axes

    def blocks() -> ColumnBlocks:
        sizes = [(y.last.frequencies, part.stop - part.start) for part in columns]
        return ColumnBlocks(columns, [plane_lines.new_zeros(*group.shape, *size) for size in sizes])

    rows, dtype, device = y.last.count, plane_lines.dtype, plane_lines.device
    return BeamFields(
        group=group,
        spectra=blocks(),
        adjoint_spectra=blocks(),
        plane_lines=plane_lines[group.lasers, group.sources],
        gap_lines=make_lines(group.shape, rows, x.gap.frequencies, dtype, device) if has_second_modulator else None,
    )
