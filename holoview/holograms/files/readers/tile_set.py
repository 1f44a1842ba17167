"""Tile sets: one large field in many files, whose names state the row and the column of each."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, Reader, StoredArray, Window
from holoview.holograms.files.readers.registry import open_file
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError

_NAMES = (
    re.compile(r"(?P<start>.*_)(?P<y>\d+)_(?P<x>\d+)(?P<end>\.\w+)"),  # dices200k_<y>_<x>.bmp
    re.compile(r"(?P<start>.*_)(?P<y>\d\d)(?P<x>\d\d)(?P<end>\.\w+)"),  # P00_<yy><xx>.tif
)


@contextmanager
def open_tiles(path: Path, request: ReadRequest) -> Iterator[tuple[Reader, Contents]]:
    """The whole field that a tile and the tiles beside it make, as one array; a window opens only the tiles it needs.

    Raises UserError where a tile of the rectangle is missing, and for tiles of other sizes or types.
    """
    grid = _grid(path)
    rows, columns = (sorted({place[axis] for place in grid}) for axis in (0, 1))
    missing = [(y, x) for y in rows for x in columns if (y, x) not in grid]
    if missing:
        found = f"the tile at row {missing[0][0]}, column {missing[0][1]} and {len(missing) - 1} more are missing"
        raise UserError(str(path.parent), found, expected=f"{len(rows)} × {len(columns)} tiles")
    with open_file(path, request) as (reader, contents):
        first = contents.arrays[0]
    files = [[grid[y, x] for x in columns] for y in rows]

    def load(window: Window) -> NDArray[Any]:
        height, width = first.shape[:2]
        pieces = []
        for row in _covered(window[0], height):
            pieces.append(
                [_part(files[row][column], first, window, (row, column)) for column in _covered(window[1], width)]
            )
        return np.concatenate([np.concatenate(row, axis=1) for row in pieces], axis=0)

    shape = (first.shape[0] * len(rows), first.shape[1] * len(columns), *first.shape[2:])
    note = f"{len(rows)} × {len(columns)} tiles by their names: one field"
    yield reader, replace(contents, arrays=(replace(first, shape=shape, load=load),), notes=(*contents.notes, note))


def _grid(path: Path) -> dict[tuple[int, int], Path]:
    """The tiles beside a file by row and column, itself among them."""
    found = next((match for pattern in _NAMES if (match := pattern.fullmatch(path.name))), None)
    if found is None:
        return {(0, 0): path}
    grid = {}
    for other in path.parent.iterdir():
        match = found.re.fullmatch(other.name)
        if match and (match["start"], match["end"]) == (found["start"], found["end"]):
            grid[int(match["y"]), int(match["x"])] = other
    return grid


def _covered(part: slice, size: int) -> range:
    """The tiles of a size that a part of an axis touches."""
    return range(part.start // size, -(-part.stop // size))


def _part(file: Path, first: StoredArray, window: Window, place: tuple[int, int]) -> NDArray[Any]:
    """The part of a window that lies in one tile."""
    inside = tuple(
        slice(max(part.start - index * size, 0), min(part.stop - index * size, size))
        for part, index, size in zip(window, place, first.shape, strict=False)
    )
    with open_file(file, ReadRequest()) as (_, contents):
        array = contents.arrays[0]
        if (array.shape, array.dtype) != (first.shape, first.dtype):
            found = f"a tile of shape {array.shape}, {array.dtype}"
            raise UserError(str(file), found, expected=f"{first.shape}, {first.dtype}")
        return array.load((*inside, *window[2:]))
