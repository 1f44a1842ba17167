"""Types, sizes and bounds of the arrays and numbers of a file: readers check them, and tests make files from them.

A reader compares the header of each array (type, sizes) before it allocates anything, and the values afterwards.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.tables import short_repr


@dataclass(frozen=True)
class ArraySchema:
    """An array of a file.

    name: in the file. types: numpy's names of the types that its numbers may have, such as "float32".
    axes: of each axis its size, or the name of a size, which is the same wherever it stands in the file; None for any
    number of axes.
    low, high: inclusive bounds of its values, which are finite; of unsigned integers any value of their type will do.
    may_be_infinite: whether values may be ±∞; NaN is always refused.
    """

    name: str
    types: tuple[str, ...]
    axes: tuple[int | str, ...] | None
    low: float = -math.inf
    high: float = math.inf
    may_be_infinite: bool = False

    def alike(self, name: str, low: float = -math.inf, high: float = math.inf) -> ArraySchema:
        """The schema of an array of the same types and axes with another name and other bounds."""
        return dataclasses.replace(self, name=name, low=low, high=high)

    def check_header(self, type_name: str, shape: Iterable[int], sizes: dict[str, int]) -> None:
        """Raises UserError, with the array's name, for another type or shape.

        sizes: the known sizes that `axes` names; the sizes of this array are added.
        """
        found = tuple(shape)
        if type_name not in self.types:
            raise UserError(self.name, f"numbers of type {type_name}", expected=" or ".join(self.types))
        if self.axes is None:
            return
        fits = len(found) == len(self.axes)
        for axis, size in zip(self.axes, found, strict=False):
            fits = fits and size == (axis if isinstance(axis, int) else sizes.setdefault(axis, size))
        if not fits:
            raise UserError(self.name, f"an array of shape {found}", expected=self._describe(sizes))

    def check_values(self, array: NDArray[Any]) -> None:
        """Raises UserError, with the array's name, for NaN, infinity, and values out of bounds."""
        if array.size == 0 or array.dtype.kind in "ub":
            return
        low, high = float(array.min()), float(array.max())  # NaN if any value is
        if math.isnan(low) or (not self.may_be_infinite and not (math.isfinite(low) and math.isfinite(high))):
            raise UserError(self.name, f"holds {self._first_not_finite(array)}", expected="finite numbers")
        if low < self.low or high > self.high:
            found = f"values outside {self.low:g}…{self.high:g}"
            raise UserError(self.name, found, expected=self._range(), remedy=f"it has {low:g} to {high:g}")

    def _first_not_finite(self, array: NDArray[Any]) -> str:
        """The first value that isn't finite and where it is, such as "nan at capture 1"."""
        flat = int(np.flatnonzero(~np.isfinite(array))[0])
        place = [int(i) for i in np.unravel_index(flat, array.shape)]
        names = [axis if isinstance(axis, str) else "entry" for axis in self.axes or ("entry",) * array.ndim]
        return f"{array.flat[flat]} at {', '.join(f'{name} {i}' for name, i in zip(names, place, strict=True))}"

    def _describe(self, sizes: Mapping[str, int]) -> str:
        """The axes in words, such as "(capture = 8, row, column)"."""
        assert self.axes is not None
        names = (str(axis) if axis not in sizes else f"{axis} = {sizes[str(axis)]}" for axis in self.axes)
        return f"({', '.join(names)})"

    def _range(self) -> str:
        if math.isinf(self.high):
            return f"numbers of at least {self.low:g}"
        return f"numbers from {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class NumberSchema:
    """A single number of a file, such as an attribute of HDF5.

    low, high: inclusive bounds; it is always finite. whole: whether it is a whole number, of whatever type.
    optional: whether it may be absent.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False
    optional: bool = False

    def read(self, value: Any, where: str) -> float:
        """The number. Raises UserError, with the place `where`, for anything else and for numbers out of bounds."""
        array = np.asarray(value)
        if array.size != 1 or array.dtype.kind not in "fiu":
            raise UserError(where, short_repr(value), expected=self._describe())
        number = float(array.reshape(())[()])
        if not (math.isfinite(number) and self.low <= number <= self.high and (not self.whole or number.is_integer())):
            raise UserError(where, f"{number:.10g}", expected=self._describe())
        return number

    def _describe(self) -> str:
        kind = "a whole number" if self.whole else "a finite number"
        if math.isinf(self.high):
            return kind if math.isinf(self.low) else f"{kind} of at least {self.low:g}"
        return f"{kind} from {self.low:g} to {self.high:g}"
