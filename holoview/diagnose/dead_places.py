"""Dead places of a modulator: lines, parts of lines and pixels, what they show, and an effect's lists of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.model.effects.effect import Effect, StartKind

Key = tuple[int | None, int | None]


class Shows(StrEnum):
    """What a dead place shows: one level, the first pattern of the session, or the pattern of the capture before."""

    LEVEL = "level"
    FIRST = "kept"
    BEFORE = "late"


@dataclass(frozen=True)
class DeadPlace:
    """A column (row is None), row (column is None) or pixel, counted in the modulator's pixels.

    level: share of the stroke, a tensor while derivatives are computed. shows: what it shows; pixels and parts show
    levels. span: first and last pixel along a line of which a part is dead; None for all of it.
    """

    row: int | None
    column: int | None
    level: float | torch.Tensor = 0.0
    shows: Shows = Shows.LEVEL
    span: tuple[int, int] | None = None

    @property
    def key(self) -> Key:
        """Which place it is, whatever it shows and however much of it is dead."""
        return self.row, self.column

    @property
    def is_line(self) -> bool:
        """Whether it is a row, a column, or a part of one."""
        return self.row is None or self.column is None

    def stands_for(self, line: DeadPlace) -> bool:
        """Whether it is a pixel of a line, or beside it, which may have been taken for a part of what the line does."""
        if self.row is None or self.column is None or not line.is_line:
            return False
        distance = self.column - line.column if line.column is not None else self.row - (line.row or 0)
        return abs(distance) <= 1

    @property
    def has_level(self) -> bool:
        """Whether it shows one level."""
        return self.shows is Shows.LEVEL

    @property
    def order(self) -> tuple[bool, bool, bool, int, int]:
        """Columns, rows, pixels; whole lines before parts of lines."""
        return (not self.is_line, self.row is not None, self.span is not None, self.row or 0, self.column or 0)

    @property
    def sides(self) -> tuple[int, int, int, int]:
        """First and last row, first and last column, of a part of a line."""
        first, last = self.span or (0, 0)
        rows = (first, last) if self.row is None else (self.row, self.row)
        columns = (first, last) if self.column is None else (self.column, self.column)
        return (*rows, *columns)


def is_stuck_effect(effect: Effect) -> bool:
    """Whether an effect is one of dead places."""
    return StartKind.STUCK_PIXELS in effect.start_kinds


def modulator_of(effect: Effect) -> int:
    """The number of the modulator that an effect acts on, 0 for the first."""
    return int(effect.acts_on[0].removeprefix("modulator ")) - 1


def as_values(places: Sequence[DeadPlace]) -> dict[str, Any]:
    """The lists of an effect's parameters, in the order of the places."""
    places = sorted(places, key=lambda place: place.order)
    whole = [p for p in places if p.is_line and p.span is None]
    columns = [p for p in whole if p.row is None and p.has_level]
    rows = [p for p in whole if p.column is None and p.has_level]
    parts, pixels = [p for p in places if p.span is not None], [p for p in places if not p.is_line]
    values: dict[str, Any] = {
        "columns": tuple(p.column for p in columns),
        "column_levels": tuple(p.level for p in columns),
        "rows": tuple(p.row for p in rows),
        "row_levels": tuple(p.level for p in rows),
        "pixel_rows": tuple(p.row for p in pixels),
        "pixel_columns": tuple(p.column for p in pixels),
        "pixel_levels": tuple(p.level for p in pixels),
        "part_levels": tuple(p.level for p in parts),
    }
    for i, side in enumerate(("first_rows", "last_rows", "first_columns", "last_columns")):
        values[f"part_{side}"] = tuple(p.sides[i] for p in parts)
    for shows in (Shows.FIRST, Shows.BEFORE):
        own = [p for p in whole if p.shows is shows]
        values[f"{shows}_columns"] = tuple(p.column for p in own if p.row is None)
        values[f"{shows}_rows"] = tuple(p.row for p in own if p.column is None)
    return values


def spans_near(span: tuple[int, int], count: int, steps: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Spans of a line of `count` pixels whose inner end is moved by each of the steps; the other is at the edge."""
    first, last = span
    for step in steps:
        moved = (first + step, last) if last == count - 1 else (first, last + step)
        if 0 <= moved[0] < moved[1] < count and moved != (0, count - 1):
            yield moved


def likely_span(gains: NDArray[np.float64]) -> tuple[int, int]:
    """The part of a line, from one edge on or all of it, that gains: of the gain of each pixel along the line.

    A change point between pixels whose gain is g on average, the highest of any part of three eighths, and others of
    none: the sum of gain − g/2 over the part is largest.
    """
    count = len(gains)
    least = max(2, 3 * count // 8)
    means = [np.convolve(gains, np.ones(least) / least, mode="valid")[i] for i in (0, -1)]
    beyond = gains - max(float(gains.mean()), *map(float, means)) / 2
    from_start, from_end = np.cumsum(beyond), np.cumsum(beyond[::-1])
    if from_start.max() >= from_end.max():
        return 0, int(from_start.argmax())
    return count - 1 - int(from_end.argmax()), count - 1
