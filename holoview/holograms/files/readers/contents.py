"""The contents of a file: arrays that are read part by part, single numbers, and facts that the format states."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.request import ReadRequest
from holoview.util.plain_arrays import read_window

HEAD_BYTES = 4096
"""Bytes from the start of a file by which a reader recognises its format."""

_MOST_LETTERS = 200  # of a text that is a property of the field
_MOST_NUMBERS = 16  # of a variable that is a property of the field; three colours' pitches are 6

Window = tuple[slice, ...]
"""The part of an array that is wanted: a slice without steps for each axis."""

Load = Callable[[Window], NDArray[Any]]


@dataclass(frozen=True)
class StoredArray:
    """An array of a file, of which parts can be read.

    name: of the variable, with the names of the structures around it ("CGH.Hol"); "" where a file holds one array.
    shape, dtype: as `load` returns them. load: reads a window.
    role: what the format says the numbers are ("phase", "real", "r" …), "" where it doesn't.
    axes: what the format says the axes are, a letter for each of frame, colour, y and x ("yxc"), "" where it doesn't.
    whole_bytes: memory that `load` takes besides its result, such as of an array that can only be decompressed whole.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    load: Load
    role: str = ""
    axes: str = ""
    whole_bytes: int = 0

    @property
    def nbytes(self) -> int:
        """Size of the whole array in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize

    def at(self, axis: int, index: int, role: str = "") -> StoredArray:
        """The array at one index of an axis, which keeps the size 1."""

        def load(window: Window) -> NDArray[Any]:
            return self.load((*window[:axis], slice(index, index + 1), *window[axis + 1 :]))

        shape = (*self.shape[:axis], 1, *self.shape[axis + 1 :])
        return replace(self, shape=shape, load=load, role=role or self.role)

    @staticmethod
    def mapped(
        path: Path,
        dtype: np.dtype[Any],
        shape: tuple[int, ...],
        offset: int,
        order: Literal["C", "F"] = "C",
        name: str = "",
        role: str = "",
        axes: str = "",
    ) -> StoredArray:
        """Plain numbers in a file, of which each window is read by itself, so that no more of it stays in memory."""

        def load(window: Window) -> NDArray[Any]:
            return read_window(path, dtype, shape, offset, window, order)

        return StoredArray(name, shape, dtype, load, role, axes)

    @staticmethod
    def of(name: str, values: NDArray[Any], role: str = "", axes: str = "") -> StoredArray:
        """An array that is in memory already."""
        return StoredArray(name, values.shape, values.dtype, lambda window: values[window], role, axes)


@dataclass(frozen=True)
class Facts:
    """The facts that a format states about a field in its own units; None, or an empty tuple, for others.

    Names and units are those of `ReadRequest`.
    """

    pitch_m: tuple[float, float] | None = None
    wavelengths_m: tuple[float, ...] = ()
    distance_m: float | None = None
    reference_radius_m: float | None = None
    phase_levels: float | None = None


@dataclass(frozen=True)
class Contents:
    """arrays: all with at least two axes. numbers: small variables by their names. texts: short ones.

    facts: what the format states. notes: remarks for the user on what was found.
    """

    arrays: tuple[StoredArray, ...]
    numbers: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    facts: Facts = field(default_factory=Facts)
    notes: tuple[str, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of(variables: Iterable[StoredArray], facts: Facts | None = None, notes: tuple[str, ...] = ()) -> Contents:
        """Variables of any size: those of a few real numbers are read, those with two long axes are the arrays.

        Texts are arrays of characters.
        """
        arrays, numbers, texts = [], {}, {}
        for variable in variables:
            if variable.dtype.kind == "U" and variable.nbytes <= _MOST_LETTERS * 4:
                letters = variable.load(tuple(slice(0, n) for n in variable.shape))
                texts[variable.name] = "".join(map(str, np.ravel(letters)))
            if variable.dtype.kind not in "biufc":
                continue
            size = math.prod(variable.shape)
            if 0 < size <= _MOST_NUMBERS and variable.dtype.kind != "c":
                values = variable.load(tuple(slice(0, n) for n in variable.shape))
                numbers[variable.name] = tuple(float(value) for value in np.ravel(values))
            elif sum(n > 1 for n in variable.shape) > 1:
                arrays.append(variable)
        return Contents(tuple(arrays), numbers, facts or Facts(), notes, texts)


class Reader(Protocol):
    """A reader of one file format. Laboratories add their own as entry points of the group `holoview.readers`."""

    @property
    def name(self) -> str:
        """Of the format, for messages."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Usual endings of names, in lower case with the dot."""

    def recognises(self, head: bytes) -> bool:
        """Whether a file that begins with these bytes (at most `HEAD_BYTES`) has the format."""

    def open(self, path: Path, request: ReadRequest) -> AbstractContextManager[Contents]:
        """Opens a file; arrays are read only inside the block.

        Raises UserError, also from `StoredArray.load`; other exceptions are reported as a damaged file.
        """
