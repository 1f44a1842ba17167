"""The beams of an optimisation: their frequencies, groups that are computed together, and the storage of their fields.

A beam is the light of one laser in one frame from one direction of the source. The parts of the file:

`SpectralAxis`   Only frequencies that some relay's stops pass are computed. The spectrum of a modulator's pixels is
                 periodic: P/s numbers, repeated s times over the P frequencies of a pattern of s samples a pixel; a
                 band that is wider than this period consists of tiles. And propagation and intensity don't change when
                 all spectra are displaced by the same frequencies: the band behind the last modulator is placed at the
                 FFT's first bins, so that no band is wrapped around zero. The field is placed at the first samples of
                 the padded grid, wherever the plan puts it: propagation is a convolution.
`BeamGroup`      Beams are computed in groups: few enough numbers for a processor's cache, many enough for a GPU.
`BeamFields`     Spectra are stored in blocks of columns, column after column, because transforms along y take one
                 block after the other. Lines, which are transformed along one axis only, are stored by rows of all
                 beams, because transforms along x take rows.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.lasers import Laser
from holoview.holograms.optimise.memory import CPU_BLOCK_BYTES
from holoview.light.model.passband import Band
from holoview.light.model.plan import Plan
from holoview.light.numerics.fourier import PrunedAxis

Tensor = torch.Tensor

Tile = tuple[slice, slice]
"""Entries of the gap's band, and the entries of the pixels' spectrum that they repeat."""


@dataclass(frozen=True)
class SpectralAxis:
    """One axis.

    pixels: transform of the pixels' pattern, true frequencies. gap, last: transforms of samples behind modulator 1 and
    behind the last one, displaced by `displacement` frequencies. With one modulator both bands are the same.
    """

    pixels: PrunedAxis
    gap: PrunedAxis
    last: PrunedAxis
    displacement: int

    @property
    def gap_frequencies(self) -> Tensor:
        """Signed frequency indices (frequency,) of the gap's band."""
        return self._true_frequencies(self.gap)

    @property
    def last_frequencies(self) -> Tensor:
        """Signed frequency indices (frequency,) of the band behind the last modulator."""
        return self._true_frequencies(self.last)

    @property
    def undisplaced_gap(self) -> PrunedAxis:
        """The transform between the gap's band and the field itself."""
        return replace(self.gap, lowest=self.gap.lowest + self.displacement)

    def tiles_of_blocks(self, width: int) -> list[tuple[slice, list[Tile]]]:
        """The pixels' spectrum in blocks of at most `width` entries, each with the parts of the gap's band it makes."""
        return [(part, self.tiles_of(part)) for part in slices(self.pixels.frequencies, width)]

    @property
    def tiles(self) -> list[Tile]:
        """The gap's band in parts, each with the entries of the pixels' spectrum that it consists of."""
        return self.tiles_of(slice(0, self.pixels.frequencies))

    def tiles_of(self, entries: slice) -> list[Tile]:
        """The parts of the gap's band that repeat some entries of the pixels' spectrum; entries are counted from 0."""
        period, total = self.pixels.padded, self.gap.frequencies
        starts = range(entries.start, total, period)
        stops = [min(start + entries.stop - entries.start, total) for start in starts]
        return [(slice(a, b), slice(0, b - a)) for a, b in zip(starts, stops, strict=True)]

    def _true_frequencies(self, axis: PrunedAxis) -> Tensor:
        half = axis.padded // 2
        return torch.from_numpy((axis.indices + self.displacement + half) % axis.padded - half)


def samples_a_pixel(plan: Plan) -> int:
    """s: the samples that the transform of pixels treats as one, the largest divisor of `upsample` that fits the
    FFT."""
    return math.gcd(plan.grid.upsample, *plan.grid.padded)


def spectral_axes(plan: Plan) -> tuple[SpectralAxis, SpectralAxis]:
    """The axes (y, x) of a plan."""
    last = plan.band(1)
    gap = last if plan.system.gap_m is None else plan.band(0)
    y, x = (_spectral_axis(plan, axis, gap, last) for axis in (0, 1))
    return y, x


def _spectral_axis(plan: Plan, axis: int, gap: Band, last: Band) -> SpectralAxis:
    padded, count, samples = plan.grid.padded[axis], plan.grid.shape[axis], samples_a_pixel(plan)
    sizes = [min(band.shape[axis], padded) for band in (gap, last)]
    starts = [band.lowest[axis] for band in (gap, last)]
    narrow = [start for start, size in zip(starts, sizes, strict=True) if size < padded]
    displacement = narrow[-1] if narrow else 0
    # a band of all frequencies may start anywhere: where the FFT does
    lowest = [0 if size == padded else start - displacement for start, size in zip(starts, sizes, strict=True)]
    first_pixel_frequency = lowest[0] + displacement
    period = padded // samples
    return SpectralAxis(
        PrunedAxis(period, 0, count // samples, first_pixel_frequency, min(sizes[0], period)),
        PrunedAxis(padded, 0, count, lowest[0], sizes[0]),
        PrunedAxis(padded, 0, count, lowest[1], sizes[1]),
        displacement,
    )


# --- groups of beams, and parts of fields ----------------------------------------------------------------------------

DEVICE_BLOCK_BYTES = 1 << 30
"""Size of a block of complex numbers on other devices than the CPU: as much as a batch may take, for few calls."""


@dataclass(frozen=True)
class BeamGroup:
    """Beams that are computed together.

    lasers, sources: slices of fields (laser, source, …). wavelengths: the lasers' transfer functions, in their order.
    """

    lasers: slice
    sources: slice
    wavelengths: slice

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of lasers and of sources."""
        return self.lasers.stop - self.lasers.start, self.sources.stop - self.sources.start


def block_bytes(device: torch.device) -> int:
    """How many bytes of complex numbers to compute at a time on a device."""
    return CPU_BLOCK_BYTES if device.type == "cpu" else DEVICE_BLOCK_BYTES


def slices(total: int, at_most: int) -> list[slice]:
    """0 … total in slices of `at_most`, at least 1, entries."""
    size = max(1, at_most)
    return [slice(start, min(start + size, total)) for start in range(0, total, size)]


def group_beams(
    lasers: Sequence[Laser], wavelengths: Sequence[int], sources: int, beam_bytes: int, limit: int
) -> list[BeamGroup]:
    """The beams in groups of at most `limit` bytes, or one beam where `beam_bytes` is more.

    A group consists of some sources of one laser, or of all sources of lasers whose wavelengths follow each other in
    `wavelengths`, those in use. Their transfer functions are then a slice, which takes no copy.
    """
    at_most = max(1, limit // max(1, beam_bytes))
    positions = [wavelengths.index(wavelength) for _, wavelength in lasers]
    if at_most < sources:
        return [
            BeamGroup(slice(i, i + 1), part, slice(position, position + 1))
            for i, position in enumerate(positions)
            for part in slices(sources, at_most)
        ]
    groups: list[BeamGroup] = []
    for i, position in enumerate(positions):
        last = groups[-1] if groups else None
        if last and last.wavelengths.stop == position and (i + 1 - last.lasers.start) * sources <= at_most:
            joined = slice(last.wavelengths.start, position + 1)
            groups[-1] = BeamGroup(slice(last.lasers.start, i + 1), last.sources, joined)
        else:
            groups.append(BeamGroup(slice(i, i + 1), slice(0, sources), slice(position, position + 1)))
    return groups


class ZeroTails:
    """Buffers that are zero from some index of an axis on; each thread has its own and uses them again.

    Only the entries before that index may be written, so that padding with zeros costs nothing.
    """

    def __init__(self) -> None:
        self._local = threading.local()

    def buffer(self, like: Tensor, dim: int, length: int) -> Tensor:
        """A buffer of the shape of `like` but `length` long in an axis, zero beyond the length of `like` there.

        The axis is contiguous, because FFTs along contiguous axes are the fastest.
        """
        shape = list(like.transpose(dim, -1).shape)
        key = (*shape, dim, length)
        buffers: dict[tuple[object, ...], Tensor] = self._local.__dict__.setdefault("buffers", {})
        if key not in buffers:
            shape[-1] = length
            buffers[key] = torch.zeros(shape, dtype=like.dtype, device=like.device).transpose(dim, -1)
        return buffers[key]


# --- fields as they are stored ---------------------------------------------------------------------------------------

VECTOR = 16
"""Numbers that compiled passes take at a time."""
_ROW_MARGIN = 1  # numbers between rows: columns of rows whose length is a power of 2 compete for the same cache lines


def row_pitch(count: int) -> int:
    """Numbers from a row to the next for compiled passes, whose vectors may reach beyond a row but not into the
    next."""
    return -(-count // VECTOR) * VECTOR + VECTOR // 2


def padded_rows(*sizes: int, like: Tensor) -> Tensor:
    """Zeros (…, row, x) whose rows lie `row_pitch` apart, of the type and on the device of a tensor."""
    return like.new_zeros(*sizes[:-1], row_pitch(sizes[-1]))[..., : sizes[-1]]


def flat_view(values: Tensor) -> tuple[NDArray[np.floating], tuple[int, ...], tuple[int, ...]]:
    """A tensor (…, x) with contiguous rows as numba's loops take it: one axis, and the sizes and strides of all others.

    Loops over one axis without gaps use the processor's vectors. Real and imaginary parts of complex numbers alternate.
    """
    numbers = 2 if values.is_complex() else 1
    sizes, steps = values.shape, values.stride()
    assert steps[-1] == 1
    length = numbers * (1 + sum((size - 1) * step for size, step in zip(sizes, steps, strict=True)))
    parts = torch.view_as_real(values) if numbers == 2 else values
    shape, strides = (*sizes[:-1], numbers * sizes[-1]), tuple([numbers * step for step in steps[:-1]])
    return parts.as_strided((length,), (1,)).numpy(), shape, strides


FlatView = tuple[NDArray[np.floating], tuple[int, ...]]
"""A flat array, and the strides of all axes of a tensor but the last."""


def strided_view(values: Tensor) -> FlatView:
    """`flat_view` without the sizes."""
    flat, _, strides = flat_view(values)
    return flat, strides


@dataclass(frozen=True)
class Rows:
    """A tensor of `padded_rows`, and the same numbers for compiled passes."""

    values: Tensor
    flat: FlatView


class KeptRows:
    """`Rows` by name and sizes, zero when they are made, and then used again; each thread has its own."""

    def __init__(self, like: Tensor) -> None:
        self._like, self._local = like, threading.local()

    def of(self, name: str, *sizes: int) -> Rows:
        """Rows with these sizes; rows of another name are other memory."""
        kept: dict[tuple[object, ...], Rows] = self._local.__dict__.setdefault("rows", {})
        key = (name, *sizes)
        if key not in kept:
            kept[key] = make_rows(*sizes, like=self._like)
        return kept[key]


def make_rows(*sizes: int, like: Tensor) -> Rows:
    """Zeros (…, row, x), as `padded_rows` makes them."""
    values = padded_rows(*sizes, like=like)
    return Rows(values, strided_view(values))


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
        """The spectrum of one beam, whose indices count from the first beam of these blocks."""
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

    @cached_property
    def flat_spectra(self) -> tuple[FlatView, FlatView]:
        """W and c_W for compiled passes, which have one block."""
        return strided_view(self.spectra.blocks[0]), strided_view(self.adjoint_spectra.blocks[0])

    @cached_property
    def flat_plane_lines(self) -> FlatView:
        """The same of `plane_lines`."""
        return strided_view(self.plane_lines)

    @cached_property
    def flat_gap_lines(self) -> FlatView:
        """The same of `gap_lines`, which exist."""
        assert self.gap_lines is not None
        return strided_view(self.gap_lines)


def make_lines(beams: tuple[int, int], rows: int, frequencies: int, like: Tensor, *, by_rows: bool) -> Tensor:
    """Lines (laser, source, row, frequency) of zeros, stored row after row: those of all beams lie together."""
    pitch = row_pitch(frequencies) if by_rows else frequencies + _ROW_MARGIN
    count = math.prod(beams) * pitch
    lines = like.new_zeros(rows, count + VECTOR)[:, :count].view(rows, *beams, pitch)
    return lines[..., :frequencies].movedim(0, 2)


def make_beam_fields(
    group: BeamGroup,
    axes: tuple[SpectralAxis, SpectralAxis],
    columns: list[slice],
    plane_lines: Tensor,
    has_second_modulator: bool,
    *,
    by_rows: bool,
) -> BeamFields:
    """The fields of a group; plane_lines (laser, source, y, k_x): of all beams. by_rows: for compiled passes."""
    y, x = axes

    def blocks() -> ColumnBlocks:
        sizes = [(part.stop - part.start, y.last.frequencies) for part in columns]
        if by_rows:
            return ColumnBlocks(columns, [padded_rows(*group.shape, *size[::-1], like=plane_lines) for size in sizes])
        return ColumnBlocks(columns, [plane_lines.new_zeros(*group.shape, *size).mT for size in sizes])

    gap_lines = None
    if has_second_modulator:
        gap_lines = make_lines(group.shape, y.last.count, x.gap.frequencies, plane_lines, by_rows=by_rows)
    return BeamFields(
        group=group,
        spectra=blocks(),
        adjoint_spectra=blocks(),
        plane_lines=plane_lines[group.lasers, group.sources],
        gap_lines=gap_lines,
    )
