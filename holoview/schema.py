"""What a parameter of the bench is: its unit, its range, how it is read from and written to people's text.

A field of a description carries one `Kind` in its metadata. Presets, the command line's `--set` and (through the same
metadata) sliders and tooltips all use it, so that a parameter is described once.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview import units
from holoview.errors import UserError, near_matches


class Kind(Protocol):
    """How a field's value is read (text or plain values → checked SI) and written (SI → TOML value)."""

    def read(self, value: Any, where: str) -> Any: ...

    def write(self, value: Any) -> Any: ...


@dataclasses.dataclass(frozen=True)
class Number:
    """A real number, or a physical quantity when `unit` is given; `low`/`high` are inclusive SI bounds."""

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False

    def read(self, value: Any, where: str) -> float | None:
        if value is None and self.optional:
            return None
        if self.unit:
            number = units.parse(value, where, "angle" if self.unit.endswith("rad") else "length")
        elif isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
            raise UserError(where, f"{value!r} is not a number", expected=self.range_text())
        else:
            number = float(value)
        if not (self.low <= number <= self.high):
            raise UserError(where, f"{self._show(number)} is out of range", expected=self.range_text())
        return number

    def write(self, value: float | None) -> Any:
        return value if value is None or not self.unit else units.text(value, self.unit)

    def range_text(self) -> str:
        if math.isinf(self.low) and math.isinf(self.high):
            return "a finite number" + (f" in {self.unit}" if self.unit else "")
        if math.isinf(self.high):
            return f"at least {self._show(self.low)}"
        return f"between {self._show(self.low)} and {self._show(self.high)}"

    def _show(self, number: float) -> str:
        return units.short(number, self.unit, 6) if self.unit else f"{number:g}"


@dataclasses.dataclass(frozen=True)
class Array:
    """An array of `Number`s with a fixed number of axes.

    One axis also accepts a single value and {first, last, count}; two axes also accept a single row.
    """

    item: Number
    axes: int = 1
    optional: bool = False

    def read(self, value: Any, where: str) -> NDArray[np.float64] | None:
        if value is None and self.optional:
            return None
        if self.axes == 1 and isinstance(value, Mapping):
            return self._ramp(value, where)
        if self.axes == 1 and (isinstance(value, str) or not isinstance(value, Iterable)):
            value = [value]
        if self.axes == 2 and isinstance(value, Iterable) and not isinstance(value, str):
            rows = list(value)
            value = rows if not rows or np.ndim(rows[0]) else [rows]
        return _frozen(self._nested(value, where, self.axes))

    def write(self, value: NDArray[np.float64] | None) -> Any:
        return None if value is None else self._written(value)

    def _written(self, value: NDArray[np.float64]) -> list[Any]:
        if value.ndim > 1:
            return [self._written(row) for row in value]
        return [self.item.write(float(x)) for x in value]

    def _nested(self, value: Any, where: str, axes: int) -> NDArray[np.float64]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r} is not a list", expected=f"a list, nested {self.axes} deep")
        entries = list(value)
        if axes == 1:
            return np.array([self.item.read(x, f"{where}[{i}]") for i, x in enumerate(entries)], dtype=np.float64)
        rows = [self._nested(row, f"{where}[{i}]", axes - 1) for i, row in enumerate(entries)]
        if len({row.shape for row in rows}) > 1:
            raise UserError(where, f"rows have lengths {[len(row) for row in rows]}", expected="rows of equal length")
        return np.array(rows, dtype=np.float64)

    def _ramp(self, value: Mapping[str, Any], where: str) -> NDArray[np.float64]:
        if set(value) != {"first", "last", "count"}:
            raise UserError(where, f"has the keys {sorted(value)}", expected="the keys first, last and count")
        first, last = (self.item.read(value[key], f"{where}.{key}") for key in ("first", "last"))
        count = Count(low=1).read(value["count"], f"{where}.count")
        return _frozen(np.linspace(first, last, count))  # type: ignore[arg-type]


@dataclasses.dataclass(frozen=True)
class Count:
    """A whole number."""

    low: int = 1
    high: int = 1 << 20

    def read(self, value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not self.low <= value <= self.high:
            raise UserError(where, f"{value!r}", expected=f"a whole number from {self.low} to {self.high}")
        return int(value)

    def write(self, value: int) -> int:
        return value


@dataclasses.dataclass(frozen=True)
class Shape:
    """Rows and columns."""

    def read(self, value: Any, where: str) -> tuple[int, int]:
        if isinstance(value, str) or not isinstance(value, Iterable) or len(pair := list(value)) != 2:
            raise UserError(where, f"{value!r}", expected="[rows, columns]")
        side = Count(low=2, high=16384)
        return side.read(pair[0], f"{where}[0]"), side.read(pair[1], f"{where}[1]")

    def write(self, value: tuple[int, int]) -> list[int]:
        return list(value)


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of a few words; any text when `options` is empty."""

    options: tuple[str, ...] = ()

    def read(self, value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise UserError(where, f"{value!r} is not text", expected="text in quotes")
        if self.options and value not in self.options:
            raise UserError(where, f'"{value}"', expected=" or ".join(f'"{o}"' for o in self.options))
        return value

    def write(self, value: str) -> str:
        return value


@dataclasses.dataclass(frozen=True)
class Coefficients:
    """Named lengths, such as Zernike terms {"Z4" = "50 nm"}; kept as sorted (index, metres) pairs."""

    prefix: str
    item: Number
    highest: int

    def read(self, value: Any, where: str) -> tuple[tuple[int, float], ...]:
        pairs = value.items() if isinstance(value, Mapping) else value
        if isinstance(pairs, str) or not isinstance(pairs, Iterable):
            raise UserError(where, f"{value!r}", expected=f'a table such as {{ {self.prefix}4 = "50 nm" }}')
        terms = {self._index(key, where): self.item.read(x, f"{where}.{key}") or 0.0 for key, x in pairs}
        return tuple(sorted(terms.items()))

    def write(self, value: tuple[tuple[int, float], ...]) -> dict[str, Any]:
        return {f"{self.prefix}{index}": self.item.write(x) for index, x in value}

    def _index(self, key: Any, where: str) -> int:
        digits = str(key).removeprefix(self.prefix)
        if not digits.isdigit() or not 1 <= int(digits) <= self.highest:
            raise UserError(where, f'"{key}"', expected=f"{self.prefix}1 to {self.prefix}{self.highest}")
        return int(digits)


@dataclasses.dataclass(frozen=True)
class Item:
    """A nested description, given as an instance or as a table of its keys."""

    description: type[Any]

    def read(self, value: Any, where: str) -> Any:
        if isinstance(value, self.description):
            return value
        if not isinstance(value, Mapping):
            raise UserError(
                where, f"{value!r}", expected=f"a table with the keys {', '.join(fields_by_key(self.description))}"
            )
        try:
            return from_mapping(self.description, value)
        except UserError as error:
            raise error.inside(f"{where}.") from error

    def write(self, value: Any) -> dict[str, Any]:
        return to_mapping(value)


@dataclasses.dataclass(frozen=True)
class Items:
    """A tuple of nested descriptions."""

    description: type[Any]

    def read(self, value: Any, where: str) -> tuple[Any, ...]:
        if isinstance(value, Mapping | str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r}", expected=f"a list of tables, one [[{where}]] each")
        return tuple(Item(self.description).read(entry, f"{where}[{i}]") for i, entry in enumerate(value))

    def write(self, value: tuple[Any, ...]) -> list[dict[str, Any]]:
        return [to_mapping(entry) for entry in value]


def param(kind: Kind, doc: str, **kwargs: Any) -> Any:
    """A dataclass field that carries its `Kind` and a sentence that explains it."""
    return dataclasses.field(metadata={"kind": kind, "doc": doc}, **kwargs)


def key_of(name: str) -> str:
    """The name that people write: the field's name without its unit."""
    return name.removesuffix("_m").removesuffix("_rad")


def fields_by_key(description: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    """The fields of a description by the name that people write."""
    return {key_of(field.name): field for field in dataclasses.fields(description)}


def field_for(description: type[Any], key: str) -> dataclasses.Field[Any]:
    """The field that people call `key`; UserError with near matches when there is none."""
    known = fields_by_key(description)
    if key not in known:
        raise UserError(key, "unknown key", remedy=near_matches(key, known))
    return known[key]


def check(instance: Any) -> None:
    """Reads every field of a frozen description through its kind; call it first in `__post_init__`."""
    for key, field in fields_by_key(type(instance)).items():
        object.__setattr__(instance, field.name, field.metadata["kind"].read(getattr(instance, field.name), key))


def from_mapping(description: type[Any], table: Mapping[str, Any]) -> Any:
    """Builds a description from people's keys and values; UserError names the key that is unknown, missing or wrong."""
    values = {field_for(description, key).name: value for key, value in table.items()}
    for key, field in fields_by_key(description).items():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and field.name not in values:
            raise UserError(key, "is missing", expected=field.metadata["doc"])
    return description(**values)


def to_mapping(instance: Any) -> dict[str, Any]:
    """People's keys and values of a description, ready for TOML; absent options and empty text are left out."""
    written = {
        key: field.metadata["kind"].write(getattr(instance, field.name))
        for key, field in fields_by_key(type(instance)).items()
    }
    return {key: value for key, value in written.items() if value is not None and value != "" and value != {}}


def edited(instance: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a description with some keys changed; dots reach inside ("relay1.iris_na", "modulators.0.pitch").

    All changes are applied together and checked once, so that several may depend on each other.
    """
    values: dict[str, Any] = {}
    inner: dict[str, dict[str, Any]] = {}
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        field = field_for(type(instance), head)
        if rest:
            inner.setdefault(field.name, {})[rest] = value
        else:
            values[field.name] = value
    for name, nested in inner.items():
        values[name] = _edited_inside(values.get(name, getattr(instance, name)), nested, key_of(name))
    return dataclasses.replace(instance, **values)


def _edited_inside(value: Any, changes: Mapping[str, Any], where: str) -> Any:
    if isinstance(value, tuple):
        entries = list(value)
        for key, change in changes.items():
            index, _, rest = key.partition(".")
            if not index.isdigit() or int(index) >= len(entries) or not rest:
                raise UserError(
                    f"{where}.{key}", "unknown key", expected=f"{where}.0 to {where}.{len(entries) - 1} and a key"
                )
            entries[int(index)] = _edited_inside(entries[int(index)], {rest: change}, f"{where}.{index}")
        return tuple(entries)
    if not dataclasses.is_dataclass(value):
        raise UserError(f"{where}.{next(iter(changes))}", "unknown key", remedy=f"{where} has no parts")
    try:
        return edited(value, changes)
    except UserError as error:
        raise error.inside(f"{where}.") from error


def identity(value: Any) -> Any:
    """A hashable equivalent of a description, for equality and as a cache key."""
    if dataclasses.is_dataclass(value):
        return tuple(identity(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    return tuple(identity(v) for v in value) if isinstance(value, tuple) else value


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array.setflags(write=False)
    return array
