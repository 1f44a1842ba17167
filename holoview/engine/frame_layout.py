"""What the fused kernels store between them: how many rows and columns of numbers, and in which order.

Along x and along y only the frequencies of the relays' bands are stored. The field behind the first modulator follows
from one sample for each pixel, and its spectrum, which repeats itself, from as many numbers as there are pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from holoview.gpu.device import Device
from holoview.gpu.line_fft import ROW_PADDING, Strategy, can_transform_repeats, spectrum_order, supported_strategies
from holoview.gpu.spectrum_order import Range, SpectrumOrder
from holoview.model.plan import Grid, Plan
from holoview.numerics.sampling import round_up

TILE_X, TILE_Y = 4, 16
"""Samples of a tile of stored rows: see `shaders/frame/rows.wgsl`."""
_PARTS = 8  # bands end at multiples of this share of the grid, so that small edits of a stop need no new kernels

Bands = tuple[tuple[Range, Range], tuple[Range, Range]]
"""The ranges of k_y and k_x that are computed, for either relay."""


@dataclass(frozen=True)
class FrameShape:
    """All of a plan that the code of the kernels depends on.

    bands: contain what the relays pass. modulators: their number. has_plain_pixels: whether the field behind the first
    modulator follows from one sample for each of its pixels.
    """

    grid: Grid
    bands: Bands
    modulators: int
    has_plain_pixels: bool = True

    def contains(self, other: FrameShape) -> bool:
        """Whether kernels of this shape compute frames of the other one: its bands lie inside."""
        pairs = zip(sum(self.bands, ()), sum(other.bands, ()), strict=True)
        is_inside = all(mine[0] <= theirs[0] and theirs[1] <= mine[1] for mine, theirs in pairs)
        rest = (self.grid, self.modulators, self.has_plain_pixels)
        return is_inside and rest == (other.grid, other.modulators, other.has_plain_pixels)


def frame_shape(plan: Plan, *, has_plain_pixels: bool = True) -> FrameShape:
    """The shape of a plan's frames.

    has_plain_pixels: whether the transmission of the first modulator is constant over each of its pixels.
    """
    grid = plan.grid
    first, second = (
        tuple(_outwards((low, high), n) for low, high, n in zip(band.lowest, band.highest, grid.padded, strict=True))
        for band in (plan.band(0), plan.band(1))
    )
    is_divisible = all(n % grid.upsample == 0 for n in grid.padded) and grid.upsample > 1
    bands = ((first[0], first[1]), (second[0], second[1]))
    return FrameShape(grid, bands, len(plan.system.modulators), has_plain_pixels and is_divisible)


def _outwards(band: Range, n: int) -> Range:
    """A band that ends at multiples of n/8 and contains the given one, which may be empty."""
    if band[0] > band[1]:
        return 0, 0
    lowest = band[0] * _PARTS // n * n // _PARTS
    highest = -(-(band[1] + 1) * _PARTS // n) * n // _PARTS - 1
    return max(lowest, -(n // 2)), min(max(highest, band[1]), (n - 1) // 2)


@dataclass(frozen=True)
class StoredRows:
    """Rows of complex numbers in device memory."""

    rows: int
    columns: int

    @property
    def stride(self) -> int:
        """Complex numbers from one row to the next (without tiles): whole tiles and padding."""
        return round_up(self.columns, TILE_X) + ROW_PADDING

    @property
    def samples(self) -> int:
        """Complex numbers of all rows, with padding."""
        return round_up(self.rows, TILE_Y) * self.stride


@dataclass(frozen=True)
class FrameLayout:
    """The rows between the kernels of a frame with a strategy of the FFTs.

    first: behind the first modulator, transformed along x. gap: behind the gap, transformed along x. second: behind the
    last modulator, transformed along x; with one modulator it is `first`. spectrum: `second`, transformed along y as
    well. plane: at the focal plane, transformed along x.
    """

    device: Device
    shape: FrameShape
    strategy: Strategy

    @cached_property
    def pixel_grid(self) -> Grid:
        """The grid of the samples behind the first modulator that are computed: one for each pixel, or all."""
        grid = self.shape.grid
        if not self.has_plain_pixels:
            return grid
        u = grid.upsample
        padded, shape, offset = ((y // u, x // u) for y, x in (grid.padded, grid.shape, grid.offset))
        return Grid(shape, padded, offset, grid.pitch_m * u, 1)

    @cached_property
    def has_plain_pixels(self) -> bool:
        """Whether the field behind the first modulator is computed at one sample for each pixel."""
        grid, u = self.shape.grid, self.shape.grid.upsample
        if not self.shape.has_plain_pixels:
            return False
        pixels = (grid.padded[0] // u, grid.padded[1] // u)
        return self.strategy in supported_strategies(self.device, pixels) and can_transform_repeats(
            self.device, grid.padded[0], u, self.strategy
        )

    def band(self, relay: int, axis: int) -> Range:
        """The frequencies of a relay that are computed, along y (0) or x (1)."""
        return self.shape.bands[relay][axis]

    @property
    def first_relay(self) -> int:
        """The relay behind the first modulator."""
        return 0 if self.shape.modulators > 1 else 1

    def columns(self, relay: int) -> SpectrumOrder:
        """The frequencies along x that are stored of the light in a relay."""
        return self._order(self.shape.grid.padded[1], self.band(relay, 1))

    @cached_property
    def first_columns(self) -> SpectrumOrder:
        """The frequencies along x that are stored of the field behind the first modulator."""
        return self._order(self.pixel_grid.padded[1], self.band(self.first_relay, 1))

    def spectrum_rows(self) -> SpectrumOrder:
        """The frequencies along y that are stored of the light in the last relay."""
        return self._order(self.shape.grid.padded[0], self.band(1, 0))

    @cached_property
    def first(self) -> StoredRows:
        return StoredRows(self.pixel_grid.shape[0], self.first_columns.count)

    @cached_property
    def gap(self) -> StoredRows:
        return StoredRows(self.shape.grid.shape[0], self.columns(0).count)

    @cached_property
    def plane(self) -> StoredRows:
        return StoredRows(self.shape.grid.shape[0], self.columns(1).count)

    @property
    def second(self) -> StoredRows:
        return self.first if self.shape.modulators == 1 else self.plane

    @property
    def spectrum(self) -> StoredRows:
        return StoredRows(self.spectrum_rows().count, self.columns(1).count)

    @property
    def keeps_spectrum(self) -> bool:
        """Whether `spectrum` is kept for other focal planes instead of `second`, because it is smaller."""
        return self.shape.modulators > 1 and self.spectrum.samples < self.second.samples

    def _order(self, n: int, band: Range) -> SpectrumOrder:
        return spectrum_order(self.device, n, self.strategy, band)
