"""Types of configuration fields: how a value is parsed from text or numbers, checked, and written to TOML.

A field type serves presets, the command line's `--set`, and the viewer's widgets, so that a field's unit and range are
stated once. Parsed values are in SI units; they are immutable, arrays are read-only.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.tables import ValueType


class FieldType(ValueType, Protocol):
    """What every type of a field offers."""

    def parse(self, value: Any, where: str) -> Any:
        """The checked SI value of text, numbers or an SI value. Raises UserError, with the place `where`, if wrong."""

    def to_toml(self, value: Any) -> Any:
        """The value that a TOML file holds for a checked value; `parse` gives an equal value back."""


@runtime_checkable
class TableType(FieldType, Protocol):
    """A field type whose value is a table of named entries, which can be changed one by one."""

    def with_changes(self, value: Any, changes: Mapping[str, Any], where: str) -> Any:
        """The checked value with some entries changed, {key: new value}."""


@dataclasses.dataclass(frozen=True)
class Number:
    """A finite real number, or a length, an angle or a vergence.

    unit: in which text is written, such as "mm", "mrad" or "D"; "" for a plain number.
    low, high: inclusive bounds, in SI units.
    optional: whether None is allowed.
    """

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def parse(self, value: Any, where: str) -> float | None:
        if value is None and self.optional:
            return None
        if self.unit:
            number = units.parse(value, where, units.quantity_of(self.unit))
        elif isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
            raise UserError(where, f"{value!r} is not a number", expected=self.format_range())
        else:
            number = units.to_float(value)
        if not (math.isfinite(number) and self.low <= number <= self.high):
            raise UserError(where, f"{self._show(number)} is out of range", expected=self.format_range())
        return number

    def to_toml(self, value: float | None) -> Any:
        return value if value is None or not self.unit else units.format_exact(value, self.unit)

    def format_range(self) -> str:
        """The range in words, for error messages."""
        if math.isinf(self.low) and math.isinf(self.high):
            return "a finite number" + (f" in {self.unit}" if self.unit else "")
        if math.isinf(self.high):
            return f"a finite number of at least {self._show(self.low)}"
        return f"between {self._show(self.low)} and {self._show(self.high)}"

    def _show(self, number: float) -> str:
        return units.format_rounded(number, self.unit, 6) if self.unit else f"{number:g}"


@dataclasses.dataclass(frozen=True)
class Array:
    """A read-only float64 array of `Number`s.

    item: type of each number.
    axes: number of axes. One axis also accepts a single number, and {first, last, count} for equally spaced numbers;
    two axes also accept a single row.
    optional: whether None is allowed.
    most: entries along an axis.
    """

    item: Number
    axes: int = 1
    optional: bool = False
    most: int = 1 << 16

    def parse(self, value: Any, where: str) -> NDArray[np.float64] | None:
        if value is None and self.optional:
            return None
        if self.axes == 1 and isinstance(value, Mapping):
            return self._linspace(value, where)
        if self.axes == 1 and (isinstance(value, str) or not isinstance(value, Iterable)):
            value = [value]
        if self.axes == 2 and isinstance(value, Iterable) and not isinstance(value, str):
            rows = list(value)
            value = [rows] if rows and all(_is_scalar(row) for row in rows) else rows
        return _read_only(self._parse_nested(value, where, self.axes))

    def to_toml(self, value: NDArray[np.float64] | None) -> Any:
        return None if value is None else self._to_list(value)

    def _to_list(self, value: NDArray[np.float64]) -> list[Any]:
        if value.ndim > 1:
            return [self._to_list(row) for row in value]
        return [self.item.to_toml(float(x)) for x in value]

    def _parse_nested(self, value: Any, where: str, axes: int) -> NDArray[np.float64]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r} is not a list", expected=f"a list, nested {self.axes} deep")
        entries = list(value)
        if len(entries) > self.most:
            raise UserError(where, f"{len(entries)} entries", expected=f"at most {self.most}")
        if axes == 1:
            return np.array([self.item.parse(x, f"{where}[{i}]") for i, x in enumerate(entries)], dtype=np.float64)
        rows = [self._parse_nested(row, f"{where}[{i}]", axes - 1) for i, row in enumerate(entries)]
        if len({row.shape for row in rows}) > 1:
            raise UserError(where, f"rows have lengths {[len(row) for row in rows]}", expected="rows of equal length")
        return np.array(rows, dtype=np.float64)

    def _linspace(self, value: Mapping[str, Any], where: str) -> NDArray[np.float64]:
        if set(value) != {"first", "last", "count"}:
            raise UserError(where, f"has the keys {sorted(value)}", expected="the keys first, last and count")
        first, last = (self.item.parse(value[key], f"{where}.{key}") for key in ("first", "last"))
        count = Integer(low=1, high=self.most).parse(value["count"], f"{where}.count")
        return _read_only(np.linspace(first, last, count))  # type: ignore[arg-type]


@dataclasses.dataclass(frozen=True)
class Integer:
    """A whole number from `low` to `high`, both included."""

    low: int = 1
    high: int = 1 << 20

    def parse(self, value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not self.low <= value <= self.high:
            raise UserError(where, f"{value!r}", expected=f"a whole number from {self.low} to {self.high}")
        return int(value)

    def to_toml(self, value: int) -> int:
        return value


@dataclasses.dataclass(frozen=True)
class Truth:
    """True or false."""

    def parse(self, value: Any, where: str) -> bool:
        if not isinstance(value, bool | np.bool_):
            raise UserError(where, f"{value!r}", expected="true or false")
        return bool(value)

    def to_toml(self, value: bool) -> bool:
        return value


@dataclasses.dataclass(frozen=True)
class LevelFractions:
    """Fractions of the stroke that a modulator can show, rising from 0 to 1; None for a continuous modulator.

    Text "continuous" means None; a whole number means so many equal steps.
    """

    def parse(self, value: Any, where: str) -> NDArray[np.float64] | None:
        if value is None or (isinstance(value, str) and value == "continuous"):
            return None
        if isinstance(value, int | np.integer) and not isinstance(value, bool):
            count = Integer(low=2, high=65536).parse(value, where)
            value = np.linspace(0.0, 1.0, count)
        fractions = Array(Number(low=0.0, high=1.0)).parse(value, where)
        assert fractions is not None
        if len(fractions) < 2 or np.any(np.diff(fractions) <= 0) or fractions[0] != 0.0 or fractions[-1] != 1.0:
            raise UserError(
                where, f"{fractions.tolist()}", expected="stroke fractions that rise from 0 to 1, or a number of levels"
            )
        return fractions

    def to_toml(self, value: NDArray[np.float64] | None) -> Any:
        if value is None:
            return None
        equal = np.array_equal(value, np.linspace(0.0, 1.0, len(value)))
        return len(value) if equal else [float(x) for x in value]


@dataclasses.dataclass(frozen=True)
class Shape:
    """A pair (rows, columns), each from 2 to 16384."""

    def parse(self, value: Any, where: str) -> tuple[int, int]:
        if isinstance(value, str) or not isinstance(value, Iterable) or len(pair := list(value)) != 2:
            raise UserError(where, f"{value!r}", expected="[rows, columns]")
        side = Integer(low=2, high=16384)
        return side.parse(pair[0], f"{where}[0]"), side.parse(pair[1], f"{where}[1]")

    def to_toml(self, value: tuple[int, int]) -> list[int]:
        return list(value)


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of the words in `options`, or any text when there are none."""

    options: tuple[str, ...] = ()

    def parse(self, value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise UserError(where, f"{value!r} is not text", expected="text in quotes")
        if "\0" in value:
            raise UserError(where, f"{value!r}", expected="text without NUL characters")
        if self.options and value not in self.options:
            raise UserError(where, f'"{value}"', expected=" or ".join(f'"{o}"' for o in self.options))
        return value

    def to_toml(self, value: str) -> str:
        return value


@dataclasses.dataclass(frozen=True)
class Coefficients:
    """A table of numbered coefficients, such as Zernike terms { Z4 = "50 nm" }; its value is sorted (index, SI) pairs.

    prefix: of the keys, here "Z".
    item: type of each coefficient.
    highest: the largest index; the smallest is 1.
    """

    prefix: str
    item: Number
    highest: int

    def parse(self, value: Any, where: str) -> tuple[tuple[int, float], ...]:
        pairs = value.items() if isinstance(value, Mapping) else value
        if isinstance(pairs, str) or not isinstance(pairs, Iterable):
            raise UserError(where, f"{value!r}", expected=f'a table such as {{ {self.prefix}4 = "50 nm" }}')
        terms: dict[int, float] = {}
        for pair in pairs:
            if isinstance(pair, str) or not isinstance(pair, Iterable) or len(both := tuple(pair)) != 2:
                raise UserError(where, f"{pair!r}", expected=f'a table such as {{ {self.prefix}4 = "50 nm" }}')
            index = self._index(both[0], where)
            if index in terms:
                raise UserError(f"{where}.{both[0]}", "given twice", expected="each term once")
            terms[index] = self.item.parse(both[1], f"{where}.{both[0]}") or 0.0
        return tuple(sorted(terms.items()))

    def to_toml(self, value: tuple[tuple[int, float], ...]) -> dict[str, Any]:
        return {f"{self.prefix}{index}": self.item.to_toml(x) for index, x in value}

    def with_changes(self, value: tuple[tuple[int, float], ...], changes: Mapping[str, Any], where: str) -> Any:
        """The pairs with some coefficients changed, {"Z4": "50 nm"}."""
        return self.parse({**self.to_toml(value), **changes}, where)

    def _index(self, key: Any, where: str) -> int:
        digits = str(key).removeprefix(self.prefix)
        if not (digits.isascii() and digits.isdigit()) or len(digits) > 9 or not 1 <= int(digits) <= self.highest:
            raise UserError(where, f'"{key}"', expected=f"{self.prefix}1 to {self.prefix}{self.highest}")
        return int(digits)


def _is_scalar(value: Any) -> bool:
    return (
        isinstance(value, str) or not isinstance(value, Iterable) or (isinstance(value, np.ndarray) and value.ndim == 0)
    )


def _read_only(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array.setflags(write=False)
    return array
