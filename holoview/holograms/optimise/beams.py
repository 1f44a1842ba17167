"""The beams of an optimisation: their frequencies, groups, fields as they are stored, precomputed factors of spectra.

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
`TransferFunctions`   Precomputed factors of a beam's spectrum: free space, pupils, the spectrum of a pixel's shape.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.lasers import Laser
from holoview.holograms.optimise.memory import CPU_BLOCK_BYTES
from holoview.holograms.optimise.parallel import ThreadTeam
from holoview.light.model.passband import Band
from holoview.light.model.plan import Plan
from holoview.light.numerics.fourier import PrunedAxis
from holoview.light.optics.bench import pupil_with_effects, pupil_without_effects, relay_response, wave_axes
from holoview.light.optics.propagate import (
    free_space_at,
    phase_per_metre,
    phase_wavelength_derivative,
    stopped,
    support_mask,
)
from holoview.light.optics.slm import pixel_spectrum

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


class KeptViews:
    """`strided_view` of tensors that are given again and again, each found once, by its place in memory."""

    def __init__(self) -> None:
        self._views: dict[tuple[object, ...], FlatView] = {}

    def of(self, values: Tensor) -> FlatView:
        """The view of a tensor, whose memory is kept from then on."""
        key = (values.data_ptr(), values.shape, values.stride())
        if key not in self._views:
            self._views[key] = strided_view(values)
        return self._views[key]


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


# --- factors of spectra -----------------------------------------------------------------------------------------------

_MIN_TRANSMISSION = 1e-100  # of a pupil: below, the derivative of its logarithm is rounding, and no light passes


class TransferFunctions:
    """The factors of a plan for each wavelength in use, complex, at the frequencies that pass the relays' stops.

    column_width: of the blocks in which factors are stored, as `BeamFields` stores spectra. by_rows: for compiled
    passes, one block whose rows are contiguous.
    columns: these blocks behind the last modulator. planes (wavelength, plane, row, k_x) in each of them: H × pupil
    from the last modulator to a focal plane, divided by the length P_y·P_x of the FFT. plane_rows (k_y,): the row of a
    frequency. For compiled passes, frequencies ±k_y share a row if H is even, which takes half the memory.
    gap_tiles: blocks of the spectrum of pixels, and the columns of the gap's band that each makes.
    gap (wavelength, k_y, k_x) for each of these columns: H × pupil between the modulators, 1 for one modulator, times
    the spectrum of a pixel's shape if there is only one source.
    gap_storage (wavelength, k_y, tile, k_x): the same numbers as `gap` for compiled passes; None otherwise.
    pixel_shapes, illumination: (wavelength, source, n) for each axis y, x. The spectra of the pixel's shape, None if
    `gap` holds them; the plane waves at the pixels, None if all sources lie on the axis.

    They are evaluated in float64, on the CPU where the device has none. Memory is allocated for all of them before the
    first is computed, so that temporary tensors don't fragment it.
    """

    def __init__(
        self,
        plan: Plan,
        axes: tuple[SpectralAxis, SpectralAxis],
        column_width: int,
        dtype: torch.dtype,
        device: torch.device,
        *,
        by_rows: bool = False,
    ) -> None:
        self.plan, self.axes, self.dtype, self.device = plan, axes, dtype, device
        self._by_rows = by_rows
        self.gap_storage: Tensor | None = None
        self._float64_device = device if device.type == "cuda" else torch.device("cpu")
        self.wavelengths = [λ for λ in range(len(plan.system.wavelengths_m)) if plan.lit(λ)]
        self.columns = slices(axes[1].last.frequencies, column_width)
        self.gap_tiles = axes[1].tiles_of_blocks(column_width)
        self._gap_columns = [columns for _, tiles in self.gap_tiles for columns, _ in tiles]
        count = len(self.wavelengths)
        self._stored_rows, self.plane_rows = self._find_rows()
        self._flat_planes: dict[tuple[int, int, int], FlatView] = {}
        self._flat_gaps: dict[tuple[int, int], FlatView] = {}
        self.planes = self._empty_blocks(self.columns, count, len(plan.planes), len(self._stored_rows))
        self.gap = self._empty_gap(count)
        ThreadTeam(device).map(lambda i: self._fill(i, self.wavelengths[i]), range(count))
        self._free_space: dict[tuple[int, float], Tensor] = {}
        self.illumination = self._all_illumination() if plan.slopes.any() else None
        self.pixel_shapes: tuple[Tensor, Tensor] | None = self._all_pixel_shapes()
        if len(plan.slopes) == 1:
            y, x = self.pixel_shapes
            for block, columns in zip(self.gap, self._gap_columns, strict=True):
                block.mul_(y.mT).mul_(x[..., columns])
            self.pixel_shapes = None

    def of_plane(self, block: int, wavelengths: slice, plane: int) -> Tensor:
        """H × pupil to a plane in a block of columns, (wavelength, k_y, k_x)."""
        stored = self.planes[block][wavelengths, plane]
        return stored if len(self._stored_rows) == len(self.plane_rows) else stored[:, self.plane_rows]

    def flat_plane(self, wavelengths: slice, plane: int) -> FlatView:
        """The stored rows (wavelength, row, k_x) of a plane for compiled passes, which have one block."""
        key = (wavelengths.start, wavelengths.stop, plane)
        if key not in self._flat_planes:
            self._flat_planes[key] = strided_view(self.planes[0][wavelengths, plane])
        return self._flat_planes[key]

    def flat_gap(self, wavelengths: slice) -> FlatView:
        """The same of `gap_storage`."""
        key = (wavelengths.start, wavelengths.stop)
        if key not in self._flat_gaps:
            assert self.gap_storage is not None
            self._flat_gaps[key] = strided_view(self.gap_storage[wavelengths])
        return self._flat_gaps[key]

    @cached_property
    def flat_rows(self) -> NDArray[np.int64]:
        """The same of `plane_rows`."""
        return self.plane_rows.numpy()

    def _find_rows(self) -> tuple[Tensor, Tensor]:
        """The frequencies k_y whose rows of H are stored, as indices, and the row of each frequency."""
        signed = self._frequencies(1)[0].cpu().numpy()
        every = torch.arange(len(signed))
        if not (self._by_rows and self.wavelengths and self._is_even_in_y(signed)):
            return every, every
        _, stored, rows = np.unique(np.abs(signed), return_index=True, return_inverse=True)
        return torch.from_numpy(stored), torch.from_numpy(rows)

    def _is_even_in_y(self, ky: NDArray[np.int64]) -> bool:
        """Whether H × pupil is the same at ±k_y in all planes: in free space it is."""
        plan = self.plan
        if plan.nominal.eye is not None or pupil_with_effects(plan, 1, self.wavelengths[0]) is not None:
            return False
        supports = (plan.transfer(1, λ).support for λ in self.wavelengths)
        return all(np.array_equal(rows[ky % len(rows)], rows[-ky % len(rows)]) for rows in map(np.asarray, supports))

    def _empty_blocks(self, columns: Sequence[slice], *sizes: int) -> list[Tensor]:
        *outer, rows = sizes
        if self._by_rows:
            like = torch.empty(0, dtype=self.dtype, device=self.device)
            return [padded_rows(*outer, rows, part.stop - part.start, like=like) for part in columns]
        shapes = [(*outer, part.stop - part.start, rows) for part in columns]
        return [torch.empty(shape, dtype=self.dtype, device=self.device).mT for shape in shapes]

    def _empty_gap(self, count: int) -> list[Tensor]:
        rows = self.axes[0].gap.frequencies
        if not self._by_rows:
            return self._empty_blocks(self._gap_columns, count, rows)
        widths = [part.stop - part.start for part in self._gap_columns]
        like = torch.empty(0, dtype=self.dtype, device=self.device)
        storage = self.gap_storage = padded_rows(count, rows, len(widths), widths[0], like=like)
        return [storage[:, :, tile, :width] for tile, width in enumerate(widths)]

    def set_eyes(self, plan: Plan) -> None:
        """Changes to a plan whose planes are seen from other places of the pupil (`Plan.seen_from`).

        Without a pupil function, only stops and displacements change: the factors of free space are kept.
        """
        self.plan = plan
        for i, λ in enumerate(self.wavelengths):
            self._fill_planes(i, λ, self._free_space)

    def _fill_planes(self, i: int, wavelength: int, kept: dict[tuple[int, float], Tensor] | None = None) -> None:
        """Evaluates H × pupil of the wavelength that is number `i` of those in use, for each plane.

        kept: factors of free space at all stored frequencies, used and completed; by default none.
        """
        if pupil_with_effects(self.plan, 1, wavelength, self.plan.planes[0].eye) is None:
            self._stop_planes(i, wavelength, kept)
            return
        padded = math.prod(self.plan.grid.padded)
        for k in range(len(self.plan.planes)):
            transfer = self.relay_transfer(1, wavelength, k, self._stored_rows).div_(padded)
            for block, columns in zip(self.planes, self.columns, strict=True):
                block[i, k] = transfer[:, columns]

    def _stop_planes(self, i: int, wavelength: int, kept: dict[tuple[int, float], Tensor] | None) -> None:
        """The same without a pupil function: planes with the same stops share these."""
        ky, kx = (frequencies.to(self._float64_device) for frequencies in self._frequencies(1))
        ky = ky[self._stored_rows]
        if 0 in (len(ky), len(kx)):
            return
        before, stops = None, torch.empty(0)
        for k, plane in enumerate(self.plan.planes):
            transfer, key = self.plan.transfer(1, wavelength, k), (wavelength, plane.true_m)
            if before is None or not transfer.has_stops_of(before):
                whole = torch.ones(len(ky), len(kx), dtype=self.dtype, device=self._float64_device)
                stops, before = stopped(whole, transfer, ky, kx).to(self.device), transfer
            free = None if kept is None else kept.get(key)
            if free is None:
                free = free_space_at(transfer, ky, kx, self.dtype).div_(math.prod(self.plan.grid.padded))
                free = free.to(self.device)
            if kept is not None:
                kept[key] = free
            for block, columns in zip(self.planes, self.columns, strict=True):
                torch.mul(free[:, columns], stops[:, columns], out=block[i, k])

    def _fill(self, i: int, wavelength: int) -> None:
        """Evaluates the transfer functions of the wavelength that is number `i` of those in use."""
        self._fill_planes(i, wavelength)
        if self.plan.system.gap_m is None:
            for block in self.gap:
                block[i] = 1
            return
        transfer = self.relay_transfer(0, wavelength)
        for block, columns in zip(self.gap, self._gap_columns, strict=True):
            block[i] = transfer[:, columns]

    def transmittances(self, wavelength: int) -> tuple[float, float]:
        """Fractions of the power of a pixel's light, from modulator 1 and from the last one, that reach the planes."""
        last = self._transmitted_share(1, wavelength)
        return (1.0 if self.plan.system.gap_m is None else self._transmitted_share(0, wavelength)) * last, last

    def relay_transfer(self, relay: int, wavelength: int, plane: int = 0, rows: Tensor | slice = slice(None)) -> Tensor:
        """H × pupil in a relay's band, over the gap (0) or to a plane (1); complex128 with a pupil.

        rows: of the band's frequencies k_y.
        """
        ky, kx = (frequencies.to(self._float64_device) for frequencies in self._frequencies(relay))
        ky = ky[rows]
        transfer = self.plan.transfer(relay, wavelength, plane)
        if 0 in (len(ky), len(kx)):
            return torch.zeros(len(ky), len(kx), dtype=self.dtype, device=self._float64_device)
        pupil = pupil_with_effects(self.plan, relay, wavelength, self.plan.planes[plane].eye)
        return relay_response(transfer, ky, kx, pupil, self.dtype if pupil is None else torch.complex128)

    def stop_transmittance(self, wavelength: int) -> Tensor:
        """Power transmission of the last relay's stops and pupil without an eye, (frequency_y, frequency_x)."""
        ky, kx = (frequencies.to(self._float64_device) for frequencies in self._frequencies(1))
        stops = self.plan.stops(1, wavelength)
        passes = support_mask(stops, kx, chosen=ky % len(stops.support))
        pupil = pupil_with_effects(replace(self.plan, nominal=self.plan.nominal.with_(eye=None)), 1, wavelength)
        return (
            passes.to(self.dtype.to_real()) if pupil is None else pupil.to(ky.device)[ky][:, kx].abs().square() * passes
        )

    def across_gap(self, wavelength: int) -> Tensor:
        """H × pupil between the modulators, (frequency_y, frequency_x)."""
        assert self.plan.system.gap_m is not None
        return self.relay_transfer(0, wavelength).to(self.dtype).to(self.device)

    def phase_derivative(self, relay: int, wavelength: int) -> Tensor:
        """∂(phase of H)/∂λ per metre of distance, real, (frequency_y, frequency_x)."""
        ky, kx = self._frequencies(relay)
        λ = float(self.plan.system.wavelengths_m[wavelength])
        derivative = phase_wavelength_derivative(λ, self.plan.grid)[ky][:, kx]
        return derivative.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def focus_derivative(self, wavelength: int) -> Tensor | None:
        """∂(phase of H)/∂λ of the last relay because an eye is focused elsewhere, real; None without an eye."""
        eye, λ = self.plan.nominal.eye, float(self.plan.system.wavelengths_m[wavelength])
        if eye is None:
            return None
        (ky, kx), slope = self._frequencies(1), eye.focus_slope(λ)
        turns = [
            df * shift * k.double()
            for df, shift, k in zip(self.plan.grid.frequency_step, eye.image_shift_m(slope), (ky, kx), strict=True)
        ]
        derivative = slope * phase_per_metre(λ, self.plan.grid)[ky][:, kx] - 2 * math.pi * (
            turns[0][:, None] + turns[1]
        )
        return derivative.to(torch.float64 if self.dtype == torch.complex128 else torch.float32).to(self.device)

    def log_pupil_derivative(self, relay: int, wavelength: int) -> Tensor | None:
        """∂(ln pupil)/∂λ of a relay, 1/m; None where it has neither aberration nor apodisation.

        Central differences over 2·10⁻⁶·λ in float64. Stops don't contribute: their edges move with λ in whole samples.
        """
        step, λ = 1e-6, self.plan.system.wavelengths_m[wavelength]
        pupil = pupil_without_effects(self.plan, relay, wavelength)
        if pupil is None:
            return None
        sides = []
        for sign in (1, -1):
            moved = self.plan.system.edit({"wavelengths": self.plan.system.wavelengths_m * (1 + sign * step)})
            side = pupil_without_effects(replace(self.plan, system=moved), relay, wavelength)
            assert side is not None
            sides.append(side)
        derivative = torch.where(pupil.abs() > _MIN_TRANSMISSION, (sides[0] - sides[1]) / (2 * step * λ * pupil), 0)
        ky, kx = self._frequencies(relay)
        return derivative[ky][:, kx].to(self.dtype).to(self.device)

    def _frequencies(self, relay: int) -> tuple[Tensor, Tensor]:
        """Signed frequency indices (y, x) of a relay's band."""
        y, x = (axis.last_frequencies if relay else axis.gap_frequencies for axis in self.axes)
        return y, x

    def _transmitted_share(self, relay: int, wavelength: int) -> float:
        """The fraction of the power of a pixel's light that passes a relay, from the first source."""
        upsample = self.plan.grid.upsample
        shapes = [self._pixel_shape(axis, wavelength, 0, upsample).abs().square() for axis in (0, 1)]
        y, x = (shape[k].to(self._float64_device) for shape, k in zip(shapes, self._frequencies(relay), strict=True))
        passed = self.relay_transfer(relay, wavelength).abs().square().double()
        return float(y @ passed @ x) / float(shapes[0].sum() * shapes[1].sum())

    def _pixel_shape(self, axis: int, wavelength: int, source: int, samples: int) -> Tensor:
        """The spectrum of a square of `samples` along an axis at all frequencies, (P,) complex128."""
        return pixel_spectrum(self.plan.grid.padded[axis], samples, float(self.plan.slopes[source, wavelength, axis]))

    def _all_pixel_shapes(self) -> tuple[Tensor, Tensor]:
        samples, chosen = samples_a_pixel(self.plan), self._frequencies(0)

        def shape(axis: int, wavelength: int, source: int) -> Tensor:
            return self._pixel_shape(axis, wavelength, source, samples)[chosen[axis]]

        return self._for_all_beams(0, shape), self._for_all_beams(1, shape)

    def _all_illumination(self) -> tuple[Tensor, Tensor]:
        stride = samples_a_pixel(self.plan)

        def wave(axis: int, wavelength: int, source: int) -> Tensor:
            return wave_axes(self.plan, wavelength, source, stride)[axis]

        return self._for_all_beams(0, wave), self._for_all_beams(1, wave)

    def _for_all_beams(self, axis: int, vector: Callable[[int, int, int], Tensor]) -> Tensor:
        """A vector for an axis, each wavelength in use and each source, (wavelength, source, n)."""
        sources = range(len(self.plan.slopes))
        rows = [torch.stack([vector(axis, λ, source) for source in sources]) for λ in self.wavelengths]
        return torch.stack(rows).to(self.dtype).to(self.device)
