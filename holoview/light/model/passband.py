"""The spatial frequencies that a relay's stops pass, as rows of integers, decided once in float64.

Symbols as in `holoview.light.model.plan`: λ wavelength, P padded samples, u samples along each side of a modulator
pixel, k signed frequency index, df frequency step; a direction sine is λ·df·k.

`Transfer` is the propagation of one wavelength over one distance, as numbers in float64 from which both executors
evaluate it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.model.bench_parts import Relay
from holoview.light.numerics.sampling import frequency_indices
from holoview.util import units
from holoview.util.errors import UserError

Integers = NDArray[np.int32]
RowsColumns = tuple[int, int]

_HAIR = 1e-12  # of half a side: thousands of roundings of f64
_BEYOND = np.iinfo(np.int32).max // 2  # a frequency index that no grid has


@dataclass(frozen=True)
class Band:
    """A rectangle of spatial frequencies: signed indices (k_y, k_x) from `lowest` to `highest`, both included.

    Made by `Plan.band`; everything that a relay passes lies inside.
    """

    lowest: RowsColumns
    highest: RowsColumns

    @property
    def shape(self) -> RowsColumns:
        """Numbers of rows and columns of frequencies; 0 where nothing passes."""
        rows, columns = (max(0, high - low + 1) for low, high in zip(self.lowest, self.highest, strict=True))
        return rows, columns


def band_limit(padded: int, pitch_m: float, wavelength_m: float, distance_m: float) -> float:
    """The highest spatial frequency (1/m) along an axis whose transfer function is sampled without aliasing.

    1/(λ·√((2·Δu·z)² + 1)) with Δu = 1/(P·dx): Matsushima & Shimobaba, Opt. Express 17, 19662 (2009), eq. 13.
    """
    slope = 2 * distance_m / (padded * pitch_m)
    return 1.0 / (wavelength_m * math.sqrt(slope * slope + 1.0))  # not hypot, which differs between libraries


@lru_cache(maxsize=256)  # edits of a bench ask for the same stops again and again
def stop_rows(
    padded: RowsColumns,
    upsample: int,
    pitch_m: float,
    relay: Relay,
    λ: float,
    limits: RowsColumns | None = None,
    *,
    is_weighted: bool = False,
) -> Integers:
    """The frequencies of light that propagates and that the stops of a relay pass at a wavelength.

    padded: samples (y, x) of the grid. upsample: samples along each side of a pixel. pitch_m: of the pixels. limits:
    the highest |k_y| and |k_x| that pass; None for no limit. is_weighted: with all frequencies of which a part of the
    cell passes (`stop_weights`).

    Returns (P_y, 3) int32: for each row of frequencies in `fftfreq` order the smallest |k_x|, the lowest k_x and the
    highest k_x that pass. Where nothing passes, the lowest lies above the highest. The array can't be written to.
    """
    step_y, step_x = _sine_steps(padded, upsample, pitch_m, λ)
    ky, kx = frequency_indices(padded[0]), np.arange(-(padded[1] // 2), (padded[1] + 1) // 2)
    margin = 0.5 * math.hypot(step_y, step_x) if is_weighted else 0.0
    squares_x = (step_x * np.arange(padded[1] // 2 + 1)) ** 2
    edge = np.searchsorted(squares_x, 1.0 - (step_y * ky) ** 2, side="left") - 1  # A < 1: no evanescent waves
    low, high = np.maximum(-edge, kx[0]), np.minimum(edge, kx[-1])
    if relay.iris_na is not None:
        disc = _disc_rows(relay.iris_na + margin, relay.centre_na, step_y * ky, step_x * kx)
        low, high = np.maximum(low, disc[0] + kx[0]), np.minimum(high, disc[1] + kx[0])
    if relay.square is not None:
        heights, columns = _square_bounds(relay, padded, upsample, pitch_m, λ, 0.5 if is_weighted else 0.0)
        inside = (ky >= heights[0]) & (ky <= heights[1])
        low = np.where(inside, np.maximum(low, columns[0]), _BEYOND)
        high = np.minimum(high, columns[1])
    if limits is not None:
        low = np.where(np.abs(ky) <= limits[0], np.maximum(low, -limits[1]), _BEYOND)
        high = np.minimum(high, limits[1])
    smallest = np.zeros_like(low)
    if relay.dc_block_na is not None and (blocked := relay.dc_block_na - margin) >= 0.0:
        smallest = np.searchsorted(squares_x, blocked**2 - (step_y * ky) ** 2, side="right")
    rows = rows_with_bounds(smallest, low, high)
    rows.setflags(write=False)
    return rows


@lru_cache(maxsize=8)
def all_rows(padded: RowsColumns) -> Integers:
    """The rows of `stop_rows` of a relay that passes every frequency of a grid. The array can't be written to."""
    kx = np.arange(-(padded[1] // 2), (padded[1] + 1) // 2)
    rows = np.tile(np.array([0, kx[0], kx[-1]], dtype=np.int32), (padded[0], 1))
    rows.setflags(write=False)
    return rows


def rows_in_disc(
    rows: Integers, columns: int, radius: float, centre: tuple[float, float], sine_step: tuple[float, float]
) -> Integers:
    """The rows of `stop_rows` without the frequencies outside a disc.

    columns: P_x. radius, centre: of the disc in direction sines, (y, x). sine_step: direction sines (y, x) between
    neighbouring frequencies.
    """
    smallest, low, high = rows.astype(np.int64).T
    kx = np.arange(-(columns // 2), (columns + 1) // 2)
    disc = _disc_rows(radius, centre, sine_step[0] * frequency_indices(len(rows)), sine_step[1] * kx)
    return rows_with_bounds(smallest, np.maximum(low, disc[0] + kx[0]), np.minimum(high, disc[1] + kx[0]))


def rows_with_bounds(smallest: NDArray[np.int64], low: NDArray[np.int64], high: NDArray[np.int64]) -> Integers:
    """Rows (smallest |k_x|, lowest k_x, highest k_x), int32; the bounds are (1, 0) where the highest is too low."""
    is_empty = low > high
    return np.stack([smallest, np.where(is_empty, 1, low), np.where(is_empty, 0, high)], axis=1).astype(np.int32)


def band_of_rows(supports: Sequence[Integers]) -> Band:
    """The smallest rectangle that holds the bounds of all rows of some supports of one grid; empty without any."""
    ky = np.tile(frequency_indices(len(supports[0])), len(supports))
    rows = np.concatenate(supports)
    is_lit = rows[:, 1] <= rows[:, 2]
    if not is_lit.any():
        return Band((1, 1), (0, 0))
    ky, rows = ky[is_lit], rows[is_lit]
    return Band((int(ky.min()), int(rows[:, 1].min())), (int(ky.max()), int(rows[:, 2].max())))


def column_support(support: Integers, columns: int) -> Integers:
    """The same frequencies as `Transfer.support`, by columns instead of rows.

    support: (P_y, 3) for each row of frequencies the smallest |k_x|, the lowest k_x and the highest k_x.
    columns: P_x.

    Returns (P_x, 3) int32: for each column of frequencies in `fftfreq` order the smallest |k_y|, the lowest k_y and the
    highest k_y. The passband of an iris, a square stop and a band limit is convex, so that the bounds of the rows rise
    to one maximum, and those of the columns follow by binary search; the DC block is a disc around zero.
    """
    order = np.argsort(frequency_indices(len(support)), kind="stable")
    ky, kx = frequency_indices(len(support))[order], frequency_indices(columns)
    smallest, low, high = support[order].astype(np.int64).T
    empty = low > high
    low, high = np.where(empty, _BEYOND, low), np.where(empty, -_BEYOND, high)
    first, last = _rows_above(high, kx)
    first_low, last_low = _rows_above(-low, -kx)
    first, last = np.maximum(first, first_low), np.minimum(last, last_low)
    blocked = smallest[len(ky) // 2 :]  # of k_y = 0, 1, …
    hole = np.searchsorted(-blocked, -np.abs(kx), side="left")
    found = first <= last
    bounds = (ky[np.minimum(first, len(ky) - 1)], ky[np.maximum(last, 0)])
    return rows_with_bounds(hole, np.where(found, bounds[0], 1), np.where(found, bounds[1], 0))


def _rows_above(bounds: NDArray[np.int64], at: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last index of `bounds`, which rise to one maximum and fall, where they are at least `at`."""
    rising = np.maximum.accumulate(bounds)
    falling = np.maximum.accumulate(bounds[::-1])
    return np.searchsorted(rising, at, side="left"), len(bounds) - 1 - np.searchsorted(falling, at, side="left")


def _disc_rows(
    radius: float, centre: tuple[float, float], sine_y: NDArray[Any], sine_x: NDArray[Any]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For each sine_y the first and the last index of the rising sine_x that lie in a disc, its edge included."""
    squared = radius**2 - (sine_y - centre[0]) ** 2
    half = np.sqrt(np.maximum(squared, 0.0))
    first = np.searchsorted(sine_x, centre[1] - half, side="left")
    last = np.searchsorted(sine_x, centre[1] + half, side="right") - 1
    return np.where(squared < 0, _BEYOND, first), np.where(squared < 0, -_BEYOND, last)


def _sine_steps(padded: RowsColumns, upsample: int, pitch_m: float, λ: float) -> tuple[float, float]:
    """Direction sines (y, x) between neighbouring frequencies."""
    return λ * (1.0 / (padded[0] * (pitch_m / upsample))), λ * (1.0 / (padded[1] * (pitch_m / upsample)))


def _square_bounds(
    relay: Relay, padded: RowsColumns, upsample: int, pitch_m: float, λ: float, margin: float
) -> tuple[RowsColumns, RowsColumns]:
    """Lowest and highest k_y, lowest and highest k_x inside a square stop, or up to `margin` steps outside.

    Its edges are left out, a hair inwards, so that rounding doesn't decide about a frequency on an edge.
    """
    square = relay.square
    assert square is not None
    bounds = []
    for centre, n in zip(relay.centre_na, padded, strict=True):
        middle = centre * n * (pitch_m / upsample) / λ
        half = square.half_side_bins(λ, n, upsample, pitch_m) * (1 - _HAIR) + margin
        bounds.append((math.floor(middle - half) + 1, math.ceil(middle + half) - 1))
    return bounds[0], bounds[1]


# --- stops whose edges lie between frequencies ------------------------------------------------------------------------


def stop_weights(
    padded: RowsColumns, upsample: int, pitch_m: float, relay: Relay, λ: float
) -> NDArray[np.float64] | None:
    """The share of each frequency's cell that the stops of a relay pass, (P_y, P_x) in `fftfreq` order; None without.

    Arguments as of `stop_rows`. If each frequency passes as a whole or not at all, the edge of a stop is jagged, and
    jagged in another way on every grid: behind irises of 473 frequencies across, pictures of rough patterns on two
    grids differ by 1.8 % of the light, with weights by 0.8 %. Where the edges of two stops meet in a cell, their shares
    are multiplied.
    """
    if not (relay.has_aperture or relay.dc_block_na is not None):
        return None
    steps = _sine_steps(padded, upsample, pitch_m, λ)
    sines = [np.asarray(step * frequency_indices(n), np.float64) for step, n in zip(steps, padded, strict=True)]
    weights = np.ones(padded)
    if relay.iris_na is not None:
        weights *= _disc_weights(relay.iris_na, relay.centre_na, sines, steps)
    if relay.square is not None:
        for axis, (n, centre, step) in enumerate(zip(padded, relay.centre_na, steps, strict=True)):
            half = relay.square.half_side_bins(λ, n, upsample, pitch_m)
            share = np.clip(half - np.abs(sines[axis] - centre) / step + 0.5, 0.0, 1.0)
            weights *= share[:, None] if axis == 0 else share
    if relay.dc_block_na is not None:
        weights *= 1.0 - _disc_weights(relay.dc_block_na, (0.0, 0.0), sines, steps)
    return weights


def _disc_weights(
    radius: float, centre: tuple[float, float], sines: Sequence[NDArray[np.float64]], steps: tuple[float, float]
) -> NDArray[np.float64]:
    """The share of each cell within a disc, whose edge is taken for straight across a cell."""
    y, x = (values - middle for values, middle in zip(sines, centre, strict=True))
    squared = (y * y)[:, None] + (x * x)[None, :]
    weights = (squared < radius * radius).astype(np.float64)
    reach = 0.5 * math.hypot(*steps)
    rows, columns = np.nonzero((squared > max(radius - reach, 0.0) ** 2) & (squared < (radius + reach) ** 2))
    distance = np.sqrt(squared[rows, columns])
    widths = np.abs(y[rows]) * steps[0] / distance, np.abs(x[columns]) * steps[1] / distance
    weights[rows, columns] = _share_within(radius - distance, *widths)
    return weights


def _share_within(
    depth: NDArray[np.float64], width_y: NDArray[np.float64], width_x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The share of a rectangle on one side of a line.

    depth: of the centre beyond the line. width_y, width_x: of the sides, projected onto the line's normal. Along it the
    rectangle is a trapezoid, the convolution of the two.
    """
    wide, narrow = np.maximum(width_y, width_x), np.minimum(width_y, width_x)
    flat = (wide - narrow) / 2
    within = np.minimum(np.abs(depth), flat)
    slope = np.clip(np.abs(depth) - flat, 0.0, narrow)
    within = within + slope - slope**2 / np.maximum(2 * narrow, np.finfo(float).tiny)
    return np.clip(0.5 + np.sign(depth) * within / wide, 0.0, 1.0)


# --- propagation over a distance --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Transfer:
    """Propagation of one wavelength over one distance, and the frequencies that pass the relay's stops.

    H = exp(−2πi·[(z/λ)·A/(1 + √(1 − A)) + u·d]) where the support passes, 0 elsewhere; without carrier, exp(2πi·z/λ).
    Goodman, Introduction to Fourier Optics, 3rd ed., eq. 3-74, in a form without cancellation at small A.

    distance_m: z.
    wavelength_m: λ.
    step: distance between spatial frequencies (y, x), 1/m.
    support: (P_y, 3) int32, for each row of frequencies in `fftfreq` order the smallest |k_x|, the lowest k_x and the
    highest k_x that pass; the lowest lies above the highest where nothing passes.
    shift_m: displacement d of the picture (y, x).
    """

    distance_m: float
    wavelength_m: float
    step: tuple[float, float]
    support: NDArray[np.int32]
    shift_m: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def band(self) -> Band:
        """The smallest rectangle that holds all frequencies that pass."""
        return band_of_rows([self.support])

    @property
    def waves(self) -> float:
        """Distance in wavelengths, z/λ."""
        return self.distance_m / self.wavelength_m

    @property
    def sine_step(self) -> tuple[float, float]:
        """Direction sine between neighbouring frequencies (y, x): λ·df."""
        return self.wavelength_m * self.step[0], self.wavelength_m * self.step[1]

    @property
    def shift_turns(self) -> tuple[float, float]:
        """Phase of the displacement between neighbouring frequencies (y, x), turns."""
        return self.step[0] * self.shift_m[0], self.step[1] * self.shift_m[1]

    def has_stops_of(self, other: Transfer) -> bool:
        """Whether the same frequencies pass as in another transfer, with the same displacement."""
        return self.shift_m == other.shift_m and np.array_equal(self.support, other.support)

    def paraxial_words(self) -> NDArray[np.uint32]:
        """The paraxial phase at k = 1, frac(z·λ/2·df²) turns, in fixed point: (2, 2) uint32 [axis y/x][high, low].

        The high word holds 32 bits of a turn, the low one 16 guard bits. Multiplied by k² in wrapping 32-bit
        arithmetic it is the paraxial phase modulo one turn exactly, which float32 can't hold: z·λ/2·df²·k² reaches
        hundreds of turns.
        """
        return np.stack(
            [turns_to_fixed_point(0.5 * self.distance_m * self.wavelength_m * step * step) for step in self.step]
        )


def turns_to_fixed_point(turns: float) -> NDArray[np.uint32]:
    """A phase in turns, modulo one turn, in fixed point: uint32 [high 32 bits, 16 guard bits]."""
    scaled = round(math.fmod(turns, 1.0) * 2.0**48) % (1 << 48)
    return np.array([scaled >> 16, scaled & 0xFFFF], dtype=np.uint32)


# --- light beyond the band limit --------------------------------------------------------------------------------------


def frequencies_left(padded: RowsColumns, pitch_m: float, wavelength_m: float, distance_m: float) -> float:
    """How many frequencies beside zero the band limit leaves on each side of an axis, the larger of the two axes.

    padded, pitch_m: samples (y, x) of the grid and their distance. Below 1, only light that goes straight on is left,
    and the picture is uniform. Where 2z is large beside the side P·dx of the grid it is (P·dx)²/(2λz).
    """
    return max(n * pitch_m * band_limit(n, pitch_m, wavelength_m, distance_m) for n in padded)


def nothing_left(padded: RowsColumns, pitch_m: float, distance_m: float) -> str:
    """The words which say that a grid holds nothing of the light at a distance."""
    return (
        f"at {units.format_rounded(distance_m, 'mm')}, of which the grid of {padded[1]} x {padded[0]} samples of "
        f"{units.format_rounded(pitch_m, 'um')} holds nothing but light that goes straight on"
    )


def check_eye_sampled(padded: RowsColumns, pitch_m: float, wavelength_m: float, distance_m: float) -> None:
    """Raises UserError if an eye is focused so far away that the band limit leaves only light that goes straight on.

    wavelength_m: the longest one. distance_m: the largest one of all wavelengths.
    """
    if frequencies_left(padded, pitch_m, wavelength_m, distance_m) >= 1.0:
        return
    raise UserError(
        "eye",
        f"it sees a plane {nothing_left(padded, pitch_m, distance_m)}",
        expected="a plane within the band limit",
        remedy="change eye.accommodation, eye.infinity or eye.eyepiece, or raise padding",
    )
