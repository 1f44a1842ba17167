"""Types of configuration fields: how a value is parsed from text or numbers, checked, and written to TOML.

A field type serves presets, the command line's `--set`, and the viewer's widgets, so that a field's unit and range are
stated once. Parsed values are in SI units; they are immutable, arrays are read-only.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.tables import ValueType, check_keys, is_required


class FieldType(ValueType, Protocol):
    """The methods of every type of a field."""

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
    words: the range in an error's words; "" for those of `format_range`.
    """

    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    optional: bool = False
    words: str = ""

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
            found = str(number) if self.words and not self.unit else f"{self._show(number)} is out of range"
            raise UserError(where, found, expected=self.format_range())
        return number

    def to_toml(self, value: float | None) -> Any:
        return value if value is None or not self.unit else units.format_exact(value, self.unit)

    def format_range(self) -> str:
        """The range in words, for error messages."""
        if self.words:
            return self.words
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
        if isinstance(value, np.ndarray) and self._holds(value):
            return _read_only(value.copy())
        if self.axes == 1 and isinstance(value, Mapping):
            return self._linspace(value, where)
        if self.axes == 1 and (isinstance(value, str) or not isinstance(value, Iterable)):
            value = [value]
        if self.axes == 2 and isinstance(value, Iterable) and not isinstance(value, str):
            rows = list(value)
            value = [rows] if rows and all(_is_scalar(row) for row in rows) else rows
        return _read_only(self._parse_nested(value, where, self.axes))

    def _holds(self, array: NDArray[Any]) -> bool:
        """Whether an array is one that was parsed, as those of a description that is copied: its numbers, one by one,
        would take most of the time of a change."""
        if array.dtype != np.float64 or array.ndim != self.axes or not 0 < array.size <= self.most:
            return False
        low, high = float(array.min()), float(array.max())
        return math.isfinite(low) and math.isfinite(high) and self.item.low <= low and high <= self.item.high

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


POSITIVE = Number(low=math.nextafter(0.0, 1.0), words="a number greater than 0")
"""A number that can't be 0, such as the power of a laser."""


@dataclasses.dataclass(frozen=True)
class Integer:
    """A whole number from `low` to `high`, both included. words: the range in an error's words; "" for the usual.

    named: words with the numbers, outside the range, for which they stand.
    """

    low: int = 1
    high: int = 1 << 20
    words: str = ""
    named: tuple[tuple[str, int], ...] = ()

    def parse(self, value: Any, where: str) -> int:
        for pair in self.named:
            if value in pair and not isinstance(value, bool):
                return pair[1]
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not self.low <= value <= self.high:
            raise UserError(where, f"{value!r}", expected=self.format_range())
        return int(value)

    def to_toml(self, value: int) -> int:
        return value

    def format_range(self) -> str:
        """The range in words, for error messages."""
        usual = f"a whole number from {self.low} to {self.high}"
        return self.words or ", or ".join([usual, *(f'"{word}"' for word, _ in self.named)])


@dataclasses.dataclass(frozen=True)
class Truth:
    """True or false."""

    def parse(self, value: Any, where: str) -> bool:
        if not isinstance(value, bool | np.bool_):
            raise UserError(where, f"{value!r}", expected="true or false")
        return bool(value)

    def to_toml(self, value: bool) -> bool:
        return value

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return "true or false"


_SECONDS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


@dataclasses.dataclass(frozen=True)
class Duration:
    """A time (s) above 0, which may be infinite, or text such as "90", "90s", "10min" or "1.5h"."""

    def parse(self, value: Any, where: str) -> float:
        seconds = value
        if isinstance(value, str):
            match = re.fullmatch(r"(\d++(?:\.\d*+)?|\.\d++)\s*+(s|min|h|)", value.strip())
            seconds = float(match[1]) * _SECONDS[match[2]] if match is not None else 0.0
        if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not seconds > 0:
            raise UserError(where, str(value), expected=self.format_range())
        return float(seconds)

    def to_toml(self, value: float) -> float:
        return value

    def format_range(self) -> str:
        """What is expected, for error messages."""
        return "a time such as 90s, 10min or 1.5h"


@dataclasses.dataclass(frozen=True)
class WrittenFile:
    """The name of a file that is written from time to time, with this suffix; None for none."""

    suffix: str

    def parse(self, value: Any, where: str) -> Path | None:
        return None if value is None else Path(value)

    def to_toml(self, value: Path | None) -> str | None:
        return None if value is None else str(value)

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return f"a file {self.suffix}"


@dataclasses.dataclass(frozen=True)
class FileContent:
    """What a file holds, which is read before; on a command line the file's name. None for none."""

    def parse(self, value: Any, where: str) -> Any:
        return value

    def to_toml(self, value: Any) -> None:
        return None

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return "of a file"


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
    """A pair (rows, columns), each from 2 to `most`."""

    most: int = 16384

    def parse(self, value: Any, where: str) -> tuple[int, int]:
        if isinstance(value, str) or not isinstance(value, Iterable) or len(pair := list(value)) != 2:
            raise UserError(where, f"{value!r}", expected="[rows, columns]")
        side = Integer(low=2, high=self.most)
        return side.parse(pair[0], f"{where}[0]"), side.parse(pair[1], f"{where}[1]")

    def to_toml(self, value: tuple[int, int]) -> list[int]:
        return list(value)

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return f"[rows, columns], each from 2 to {self.most}"


@dataclasses.dataclass(frozen=True)
class Choice:
    """One of the words in `options`, or any text when there are none.

    unwritten: the value that TOML files leave out.
    """

    options: tuple[str, ...] = ()
    unwritten: str = ""

    def parse(self, value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise UserError(where, f"{value!r} is not text", expected="text in quotes")
        if "\0" in value:
            raise UserError(where, f"{value!r}", expected="text without NUL characters")
        if self.options and value not in self.options:
            raise UserError(where, f'"{value}"', expected=" or ".join(f'"{o}"' for o in self.options))
        return value

    def to_toml(self, value: str) -> str | None:
        return None if value == self.unwritten else value

    def format_range(self) -> str:
        """The words, for the manual."""
        return " or ".join(self.options) or "text"


@dataclasses.dataclass(frozen=True)
class Word:
    """One of the words in `options`, of which "" is nothing; the error suggests similar ones."""

    options: tuple[str, ...]

    def parse(self, value: Any, where: str) -> str:
        if value not in self.options:
            found = f'"{value}"' if isinstance(value, str) else repr(value)
            remedy = suggest_matches(str(value), self.options)
            raise UserError(where, found, expected=self.format_range(), remedy=remedy)
        return str(value)

    def to_toml(self, value: str) -> str:
        return value

    def format_range(self) -> str:
        """The words, for error messages."""
        return (" or " if len(self.options) == 2 else ", ").join(option or "nothing" for option in self.options)


@dataclasses.dataclass(frozen=True)
class Several:
    """A tuple of values of one type, also given as text with commas between them.

    item: type of each. count: how many; None for any number. words: what is expected where one of them is wrong; "" for
    what its own type says.
    """

    item: Any
    count: int | None = None
    words: str = ""

    def parse(self, value: Any, where: str) -> tuple[Any, ...]:
        if isinstance(value, str):
            value = self._parts(value, where)
        if not isinstance(value, Iterable) or (self.count is not None and len(list(value)) != self.count):
            raise UserError(where, f"{value!r}", expected=self.format_range())
        try:
            return tuple(self.item.parse(entry, where) for entry in value)
        except UserError as error:
            raise error if not self.words else UserError(where, str(value), expected=self.words) from error

    def to_toml(self, value: tuple[Any, ...]) -> list[Any]:
        return [self.item.to_toml(entry) for entry in value]

    def format_range(self) -> str:
        """What is expected, for error messages."""
        count = "several" if self.count is None else f"{self.count} of them"
        return self.words or f"{count}, each {self.item.format_range()}"

    def _parts(self, text: str, where: str) -> list[Any]:
        """The values in a text, which are numbers where their type has no unit."""
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if not isinstance(self.item, Integer | Number) or (isinstance(self.item, Number) and self.item.unit):
            return parts
        try:
            return [int(part) if isinstance(self.item, Integer) else float(part) for part in parts]
        except ValueError as error:
            raise UserError(where, f'"{text}"', expected="numbers with commas between them") from error


@dataclasses.dataclass(frozen=True)
class Span:
    """Two numbers of one type, the lower one first."""

    item: Number

    def parse(self, value: Any, where: str) -> tuple[float, float]:
        numbers = Array(self.item).parse(value, where)
        values = () if numbers is None else tuple(map(float, numbers))
        if len(values) != 2 or values[0] > values[1]:
            raise UserError(where, str(list(values)), expected="two values, the lower one first")
        return values[0], values[1]

    def to_toml(self, value: tuple[float, float]) -> list[Any]:
        return [self.item.to_toml(entry) for entry in value]

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return f"two, the lower one first, each {self.item.format_range()}"


@dataclasses.dataclass(frozen=True)
class Maybe:
    """A value of some type, or None."""

    item: Any

    def parse(self, value: Any, where: str) -> Any:
        return None if value is None else self.item.parse(value, where)

    def to_toml(self, value: Any) -> Any:
        return None if value is None else self.item.to_toml(value)

    def format_range(self) -> str:
        """What is expected, for error messages."""
        found: str = self.item.format_range()
        return found


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


# Frozen dataclasses whose fields have a `FieldType`: built from tables, written to tables, and edited by dotted keys.
#
# Such a dataclass is called a description here. In tables its fields are named without their unit: `gap` for `gap_m`.
# Errors name the key from the outermost table inwards, for example `modulators.0.pitch`.


class Description:
    """Equality and hash of a frozen dataclass by value, arrays included."""

    @cached_property
    def _hashable_value(self) -> Any:
        return hashable_value(self)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return type(other) is type(self) and self._hashable_value == other._hashable_value

    def __hash__(self) -> int:
        return hash(self._hashable_value)


@dataclasses.dataclass(frozen=True)
class Nested:
    """Field type of a nested description, given as an instance or as a table of its keys.

    optional: whether there may be none, None or the text "none", with which a preset takes away that of its base.
    """

    description: type[Any]
    optional: bool = False

    def parse(self, value: Any, where: str) -> Any:
        if self.optional and (value is None or (isinstance(value, str) and value == "none")):
            return None
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

    def to_toml(self, value: Any) -> dict[str, Any] | None:
        return None if value is None else to_mapping(value)

    def format_range(self) -> str:
        """What is expected, for the manual."""
        return f"`{self.description.__name__}`"


@dataclasses.dataclass(frozen=True)
class NestedList:
    """Field type of a tuple of nested descriptions."""

    description: type[Any]

    def parse(self, value: Any, where: str) -> tuple[Any, ...]:
        if isinstance(value, Mapping | str) or not isinstance(value, Iterable):
            raise UserError(where, f"{value!r}", expected=f"a list of tables, one [[{where}]] each")
        return tuple(Nested(self.description).parse(entry, f"{where}[{i}]") for i, entry in enumerate(value))

    def to_toml(self, value: tuple[Any, ...]) -> list[dict[str, Any]]:
        return [to_mapping(entry) for entry in value]


def described_field(field_type: ValueType, doc: str, flag: str = "", **kwargs: Any) -> Any:
    """`dataclasses.field` with the field's type and a sentence that explains it, as metadata "kind" and "doc".

    flag: its name on the command line, such as "until-psnr"; "" for its key.
    """
    return dataclasses.field(metadata={"kind": field_type, "doc": doc, "flag": flag}, **kwargs)


def flag_of(field: dataclasses.Field[Any]) -> str:
    """The flag of a field on the command line, such as "--until-psnr"."""
    return f"--{field.metadata['flag'] or key_without_unit(field.name).replace('_', '-')}"


def spaced_key(field: dataclasses.Field[Any]) -> str:
    """The key of a field in words, such as "plane weights"."""
    return key_without_unit(field.name).replace("_", " ")


def same_field(description: type[Any], name: str) -> Any:
    """A field as another description declares it: type, sentence and default."""
    (field,) = [field for field in dataclasses.fields(description) if field.name == name]
    return dataclasses.field(metadata=field.metadata, default=field.default)


def with_field_docs(description: type[Any]) -> type[Any]:
    """A class decorator: the docstring ends with the sentence of each field."""
    sentences = [f"{field.name}: {field.metadata['doc']}" for field in dataclasses.fields(description)]
    description.__doc__ = "\n    ".join([(description.__doc__ or "").rstrip(), "", *sentences]) + "\n    "
    return description


@cache
def key_without_unit(name: str) -> str:
    """A field's key in tables: its name without the unit."""
    for unit in ("_m", "_s", "_rad", "_dpt", "_deg", "_db"):
        name = name.removesuffix(unit)
    return name


def fields_by_key(description: type[Any]) -> Mapping[str, dataclasses.Field[Any]]:
    """The fields of a description by their keys in tables."""
    return _fields_by_key(description)  # type: ignore[arg-type]  # mypy doesn't know that classes are hashable


@cache
def _fields_by_key(description: type[Any]) -> Mapping[str, dataclasses.Field[Any]]:
    return MappingProxyType({key_without_unit(field.name): field for field in dataclasses.fields(description)})


def field_for(description: type[Any], key: str) -> dataclasses.Field[Any]:
    """The field of a key. Raises UserError, which suggests similar keys, when there is none."""
    known = fields_by_key(description)
    check_keys([key], known)
    return known[key]


def validate(instance: Any, named: Callable[[dataclasses.Field[Any]], str] | None = None) -> None:
    """Replaces every field of a frozen description by what its type parses from it; called first in `__post_init__`.

    named: the name of a field in errors, `spaced_key` or `flag_of`; its key if absent.
    """
    for key, field in fields_by_key(type(instance)).items():
        where = key if named is None else named(field)
        object.__setattr__(instance, field.name, field.metadata["kind"].parse(getattr(instance, field.name), where))


def from_mapping(description: type[Any], table: Mapping[str, Any]) -> Any:
    """Builds a description from a table. Raises UserError that names a key that is unknown, missing or wrong."""
    values = {field_for(description, key).name: value for key, value in table.items()}
    for key, field in fields_by_key(description).items():
        if is_required(field) and field.name not in values:
            raise UserError(key, "is missing", expected=field.metadata["doc"])
    return description(**values)


def to_mapping(instance: Any) -> dict[str, Any]:
    """The table of a description, ready for TOML, without options that are None and texts and tables that are empty."""
    written = {
        key: field.metadata["kind"].to_toml(getattr(instance, field.name))
        for key, field in fields_by_key(type(instance)).items()
    }
    return {key: value for key, value in written.items() if value is not None and value != "" and value != {}}


def with_changes(instance: Any, changes: Mapping[str, Any]) -> Any:
    """A copy of a description with some keys changed; dots reach nested ones ("relay1.iris_na", "modulators.0.pitch").

    All changes are applied before the copy is checked, so that several may depend on each other. Raises UserError for
    unknown keys and wrong values.
    """
    values: dict[str, Any] = {}
    nested_changes: dict[str, dict[str, Any]] = {}
    for key, value in changes.items():
        head, _, rest = key.partition(".")
        field = field_for(type(instance), head)
        if rest:
            nested_changes.setdefault(field.name, {})[rest] = value
        else:
            values[field.name] = value
    for name, inner in nested_changes.items():
        key = key_without_unit(name)
        field_type = fields_by_key(type(instance))[key].metadata["kind"]
        before = field_type.parse(values.get(name, getattr(instance, name)), key)
        values[name] = _change_nested(field_type, before, inner, key)
    return dataclasses.replace(instance, **values)


def _change_nested(field_type: FieldType, value: Any, changes: Mapping[str, Any], where: str) -> Any:
    """The value of a field with changes inside it."""
    if isinstance(field_type, NestedList):
        return _change_entries(field_type, value, changes, where)
    if isinstance(field_type, TableType):
        return field_type.with_changes(value, changes, where)
    if not isinstance(field_type, Nested):
        raise UserError(f"{where}.{next(iter(changes))}", "unknown key", remedy=f"{where} has no parts")
    try:
        return with_changes(field_type.description() if value is None else value, changes)
    except UserError as error:
        raise error.inside(f"{where}.") from error


def _change_entries(
    field_type: NestedList, value: tuple[Any, ...], changes: Mapping[str, Any], where: str
) -> tuple[Any, ...]:
    """The tuple of a `NestedList` with changes in some entries: {"0.pitch": …}."""
    entries = list(value)
    for key, change in changes.items():
        index, _, rest = key.partition(".")
        if not rest or index not in map(str, range(len(entries))):
            expected = f"{where}.0 to {where}.{len(entries) - 1} and a key"
            raise UserError(f"{where}.{key}", "unknown key", expected=expected)
        entry_type = Nested(field_type.description)
        entries[int(index)] = _change_nested(entry_type, entries[int(index)], {rest: change}, f"{where}.{index}")
    return tuple(entries)


def hashable_value(value: Any) -> Any:
    """A hashable equivalent of a description, for equality and as a cache key."""
    if dataclasses.is_dataclass(value):
        return tuple(hashable_value(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    return tuple(hashable_value(v) for v in value) if isinstance(value, tuple) else value
