"""Parts of arrays as complex amplitudes, strip by strip, so that nothing but the result is held in memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.interpret.axes import Axes
from holoview.holograms.fields.interpret.candidates import Component
from holoview.light.numerics.sampling import Region
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.util.progress import StepCallback

_STRIP_BYTES = 32 << 20
_STRIP_COPIES = 6  # in complex128 and in the file's type, while a strip is converted


@dataclass(frozen=True)
class PlacedArray:
    """A component with the meaning of its axes.

    zero: the number in the file that stands for 0. scale: what numbers are multiplied by then: to rad for phases.
    only_colour: the index of the colour that is taken, None for all.
    """

    component: Component
    axes: Axes
    zero: float = 0.0
    scale: float = 1.0
    only_colour: int | None = None

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Frames, colours, rows, columns."""
        frames, colours, rows, columns = self.axes.sizes(self.component.array.shape)
        return frames, colours if self.only_colour is None else 1, rows, columns

    def load(self, region: Region) -> NDArray[Any]:
        """The numbers of a region, (frame, colour, y, x), as they stand in the file."""
        x, y, width, height = region
        axes, array = self.axes, self.component.array
        window = [slice(0, 1)] * len(array.shape)
        window[axes.y], window[axes.x] = slice(y, y + height), slice(x, x + width)
        for axis in (axes.frame, axes.colour):
            if axis is not None:
                window[axis] = slice(0, array.shape[axis])
        if self.only_colour is not None and axes.colour is not None:
            window[axes.colour] = slice(self.only_colour, self.only_colour + 1)
        loaded = array.load(tuple(window))
        if loaded.shape != tuple(w.stop - w.start for w in window):
            raise UserError(array.name, f"{loaded.shape} read of {array.shape}", expected="all of the wanted part")
        order = [axis for axis in (axes.frame, axes.colour) if axis is not None]
        rest = [a for a in range(loaded.ndim) if a not in (*order, axes.y, axes.x)]
        moved = loaded.transpose(*rest, *order, axes.y, axes.x)
        return moved.reshape(
            -1 if axes.frame is not None else 1,
            moved.shape[-3] if axes.colour is not None else 1,
            *moved.shape[-2:],
        )


def check_region(region: Region | None, rows: int, columns: int, decimate: int) -> Region:
    """The region that is read, cut to whole blocks of `decimate` samples. Raises UserError unless it lies inside."""
    x, y, width, height = region or (0, 0, columns, rows)
    if x + width > columns or y + height > rows:
        found = f"{width} × {height} at ({x}, {y})"
        raise UserError("region", found, expected=f"a part of the {columns} × {rows} samples")
    if min(width, height) < decimate:
        raise UserError("decimate", f"{decimate} for {width} × {height} samples", expected="at most their number")
    return x, y, width // decimate * decimate, height // decimate * decimate


def assemble(
    groups: Sequence[Sequence[Sequence[PlacedArray]]],
    region: Region,
    decimate: int,
    where: str,
    as_field: bool,
    progress: StepCallback | None = None,
) -> NDArray[Any]:
    """The samples (frame, colour, y, x) of a region: complex64 amplitudes, or float32 as they stand in the file.

    groups: by frame and colour of separate files, the arrays that are parts of one field.
    decimate: the mean of so many samples in both directions becomes one.
    progress: called after each strip of rows where there are several; its exceptions end the reading.
    Raises UserError for values that aren't finite, and when memory doesn't suffice.
    """
    _, _, width, height = region
    inner_frames, inner_colours, _, _ = groups[0][0][0].sizes
    frames, colours = len(groups) * inner_frames, len(groups[0]) * inner_colours
    dtype = np.dtype(np.complex64 if as_field else np.float32)
    size = frames * colours * (height // decimate) * (width // decimate) * dtype.itemsize
    row_bytes = inner_frames * inner_colours * width * 16
    strip = max(_STRIP_BYTES // row_bytes // decimate, 1) * decimate
    whole = max(placed.component.array.whole_bytes for row in groups for parts in row for placed in parts)
    needed = 1.2 * size + _STRIP_COPIES * min(strip, height) * row_bytes + whole
    require_memory(where, needed, remedy="read a region of it, or decimate it")
    result = np.empty((frames, colours, height // decimate, width // decimate), dtype)
    total, done = height * sum(len(row) for row in groups), 0
    for f, row in enumerate(groups):
        for c, parts in enumerate(row):
            target = result[f * inner_frames : (f + 1) * inner_frames, c * inner_colours : (c + 1) * inner_colours]
            for part, first in _strips(region, strip):
                values = _combine(parts, part, as_field)
                rows = slice(first // decimate, (first + part[3]) // decimate)
                target[:, :, rows] = _narrowed(where, values, part, decimate, dtype)
                done += part[3]
                if progress is not None and total > strip:
                    progress(done, total)
    return result


def _strips(region: Region, rows: int) -> Iterator[tuple[Region, int]]:
    """Parts of the region with so many rows at most, and the first row of each counted in the region."""
    x, y, width, height = region
    for first in range(0, height, rows):
        yield (x, y + first, width, min(rows, height - first)), first


def _combine(parts: Sequence[PlacedArray], region: Region, as_field: bool) -> NDArray[Any]:
    values = {part.component.role: _scaled(part.load(region), part) for part in parts}
    if not as_field:
        return next(iter(values.values())).astype(np.float64)
    match values:
        case {"complex": u}:
            return u
        case {"real": a, "imaginary": b}:
            return a + 1j * b
        case {"amplitude": a, "phase": b}:
            return a * np.exp(1j * b)
        case {"intensity": a, "phase": b}:
            return _root(a) * np.exp(1j * b)
        case {"phase": b}:
            return np.exp(1j * b)
        case {"intensity": a}:
            return _root(a) + 0j
        case _:
            return next(iter(values.values())) + 0j


def _scaled(values: NDArray[Any], part: PlacedArray) -> NDArray[Any]:
    """Integers become float64, floats and complex numbers keep their type."""
    if values.dtype.kind in "biu":
        return (values - np.float64(part.zero)) * part.scale
    return values if part.scale == 1 else values * part.scale


def _root(intensity: NDArray[Any]) -> NDArray[Any]:
    if intensity.size and float(intensity.min()) < 0:
        raise UserError("intensity", f"values down to {float(intensity.min()):g}", expected="values from 0")
    return np.sqrt(intensity)


def _narrowed(where: str, values: NDArray[Any], region: Region, decimate: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The means of blocks in the type of the result. Raises UserError for numbers beyond its range, and as
    `check_finite`: a mean is finite only if all its numbers are."""
    with np.errstate(over="ignore", invalid="ignore"):
        narrow = _mean(values, decimate).astype(dtype)
    if not np.isfinite(narrow).all():
        check_finite(where, values, region)
        raise UserError(where, "numbers beyond 1e38", expected="numbers that 32 bits can hold", remedy="rescale them")
    return narrow


def _mean(values: NDArray[Any], decimate: int) -> NDArray[Any]:
    """The means of blocks, rows first, because sums along rows of memory are the fast ones."""
    if decimate == 1:
        return values
    frames, colours, rows, columns = values.shape
    sums = values.reshape(frames, colours, rows // decimate, decimate, columns).sum(axis=3)
    return sums.reshape(frames, colours, rows // decimate, columns // decimate, decimate).mean(axis=4) / decimate


def half_spectrum(values: NDArray[Any]) -> NDArray[np.complex64]:
    """The part of bilevel patterns (…, y, x) whose frequencies along y are above 0.

    A real pattern holds its field at frequencies of one sign and the conjugate field at those of the other, on
    either side of a carrier along y (JPEG Pleno's bilevel holograms); the other half is that of the conjugated field.
    """
    result = np.empty(values.shape, np.complex64)
    rows = values.shape[-2]
    step = max(_STRIP_BYTES // (rows * 16), 1)
    for plane in np.ndindex(values.shape[:-2]):
        for first in range(0, values.shape[-1], step):
            columns = slice(first, first + step)
            spectrum = np.fft.fft(values[plane][:, columns], axis=0)
            spectrum[0] = 0
            spectrum[(rows + 1) // 2 :] = 0
            result[plane][:, columns] = np.fft.ifft(spectrum, axis=0)
    return result


def check_finite(where: str, values: NDArray[Any], region: Region) -> None:
    """Raises UserError, with the first place, for NaN and infinity among the numbers (frame, colour, y, x)."""
    finite = np.isfinite(values)
    if not finite.all():
        place = np.unravel_index(int(np.argmin(finite)), finite.shape)
        y, x = int(place[2]) + region[1], int(place[3]) + region[0]
        count = finite.size - int(np.count_nonzero(finite))
        found = f"{values[place]} at row {y}, column {x}, one of {count} numbers that aren't finite in the part read"
        raise UserError(where, found, expected="finite numbers")
