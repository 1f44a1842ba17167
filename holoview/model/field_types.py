"""What a parameter is: its unit, its range, how it is read from people's text and written to it.

A `Kind` serves presets, the command line's `--set` and, through the metadata of a description's fields, sliders and
tooltips, so that a parameter is described once.
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


class FieldType(Protocol):
    """How a field's value is read (text or plain values → checked SI) and written (SI → TOML value)."""

    def parse(self, value: Any, where: str) -> Any: ...

    def to_toml(self, value: Any) -> Any: ...


@runtime_checkable
class TableType(FieldType, Protocol):
    """A kind whose value is a table of named entries, which can be changed one by one."""

    def with_changes(self, value: Any, changes: Mapping[str, Any], where: str) -> Any: ...


@dataclasses.dataclass(frozen=True)
class Number:
    """A real number, or a physical quantity when `unit` is given; `low`/`high` are inclusive SI bounds."""

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def parse(self, value: Any, where: str) -> float | None:
        if value is None and self.optional:
            return None
        if self.unit:
            number = units.parse(value, where, "angle" if self.unit.endswith("rad") else "length")
        elif isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
            raise UserError(where, f"{value!r} is not a number", expected=self.format_range())
        else:
            number = float(value)
        if not (self.low <= number <= self.high):
            raise UserError(where, f"{self._show(number)} is out of range", expected=self.format_range())
        return number

    def to_toml(self, value: float | None) -> Any:
        return value if value is None or not self.unit else units.format_exact(value, self.unit)

    def format_range(self) -> str:
        if math.isinf(self.low) and math.isinf(self.high):
            return "a finite number" + (f" in {self.unit}" if self.unit else "")
        if math.isinf(self.high):
            return f"at least {self._show(self.low)}"
        return f"between {self._show(self.low)} and {self._show(self.high)}"

    def _show(self, number: float) -> str:
        return units.format_rounded(number, self.unit, 6) if self.unit else f"{number:g}"


@dataclasses.dataclass(frozen=True)
class Array:
    """An array of `Number`s with a fixed number of axes.

    One axis also accepts a single value and {first, last, count}; two axes also accept a single row.
    """

    item: Number
    axes: int = 1
    optional: bool = False

    def parse(self, value: Any, where: str) -> NDArray[np.float64] | None:
        if value is None and self.optional:
            return None
        if self.axes == 1 and isinstance(value, Mapping):
            return self._ramp(value, where)
        if self.axes == 1 and (isinstance(value, str) or not isinstance(value, Iterable)):
            value = [value]
        if self.axes == 2 and isinstance(value, Iterable) and not isinstance(value, str):
            rows = list(value)
            value = [rows] if rows and all(_is_scalar(row) for row in rows) else rows
        return _frozen(self._nested(value, where, self.axes))

    def to_toml(self, value: NDArray[np.float64] | None) -> Any:
        return None if value is None else self._written(value)

    def _written(self, value: NDArray[np.float64]) -> list[Any]:
        if value.ndim > 1:
            return [self._written(row) for row in value]
        return [self.item.to_toml(float(x)) for x in value]

    def _nested(self, value: Any, where: str, axes: int) -> NDArray[np.float64]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r} is not a list", expected=f"a list, nested {self.axes} deep")
        entries = list(value)
        if axes == 1:
            return np.array([self.item.parse(x, f"{where}[{i}]") for i, x in enumerate(entries)], dtype=np.float64)
        rows = [self._nested(row, f"{where}[{i}]", axes - 1) for i, row in enumerate(entries)]
        if len({row.shape for row in rows}) > 1:
            raise UserError(where, f"rows have lengths {[len(row) for row in rows]}", expected="rows of equal length")
        return np.array(rows, dtype=np.float64)

    def _ramp(self, value: Mapping[str, Any], where: str) -> NDArray[np.float64]:
        if set(value) != {"first", "last", "count"}:
            raise UserError(where, f"has the keys {sorted(value)}", expected="the keys first, last and count")
        first, last = (self.item.parse(value[key], f"{where}.{key}") for key in ("first", "last"))
        count = Integer(low=1).parse(value["count"], f"{where}.count")
        return _frozen(np.linspace(first, last, count))  # type: ignore[arg-type]


@dataclasses.dataclass(frozen=True)
class Integer:
    """A whole number."""

    low: int = 1
    high: int = 1 << 20

    def parse(self, value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not self.low <= value <= self.high:
            raise UserError(where, f"{value!r}", expected=f"a whole number from {self.low} to {self.high}")
        return int(value)

    def to_toml(self, value: int) -> int:
        return value


@dataclasses.dataclass(frozen=True)
class Shape:
    """Rows and columns."""

    def parse(self, value: Any, where: str) -> tuple[int, int]:
        if isinstance(value, str) or not isinstance(value, Iterable) or len(pair := list(value)) != 2:
            raise UserError(where, f"{value!r}", expected="[rows, columns]")
        side = Integer(low=2, high=16384)
        return side.parse(pair[0], f"{where}[0]"), side.parse(pair[1], f"{where}[1]")

    def to_toml(self, value: tuple[int, int]) -> list[int]:
        return list(value)


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of a few words; any text when `options` is empty."""

    options: tuple[str, ...] = ()

    def parse(self, value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise UserError(where, f"{value!r} is not text", expected="text in quotes")
        if self.options and value not in self.options:
            raise UserError(where, f'"{value}"', expected=" or ".join(f'"{o}"' for o in self.options))
        return value

    def to_toml(self, value: str) -> str:
        return value


@dataclasses.dataclass(frozen=True)
class Coefficients:
    """Named lengths, such as Zernike terms {"Z4" = "50 nm"}; kept as sorted (index, metres) pairs."""

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
        """With some terms changed: {"Z4": "50 nm"}."""
        return self.parse({**self.to_toml(value), **changes}, where)

    def _index(self, key: Any, where: str) -> int:
        digits = str(key).removeprefix(self.prefix)
        if not (digits.isascii() and digits.isdigit()) or not 1 <= int(digits) <= self.highest:
            raise UserError(where, f'"{key}"', expected=f"{self.prefix}1 to {self.prefix}{self.highest}")
        return int(digits)


def _is_scalar(value: Any) -> bool:
    return (
        isinstance(value, str) or not isinstance(value, Iterable) or (isinstance(value, np.ndarray) and value.ndim == 0)
    )


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array.setflags(write=False)
    return array
