"""Tables from unknown sources: TOML and JSON are parsed, keys and values are checked, and every fault is a UserError.

parse_toml, parse_json    a text as tables, lists and numbers; nesting and whole numbers are bounded
check_keys                refuses unknown and missing keys
read_table                the values of a table whose keys have types, such as those of `holoview.light.model.fields`
read_record               a dataclass from the JSON text of its fields, by their annotations
record_from_table         the same from the parsed table; typed_value: one value as an annotation says

`ArraySchema` and `NumberSchema` state types, sizes and bounds of arrays and numbers of a file. A reader compares the
header of each array (type, sizes) before it allocates anything, and the values afterwards; tests make files from them.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
import tomllib
import types
import typing
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import TEXT_LIMIT

MAX_DEPTH = 32
"""Most tables and lists inside each other; a bench has 4, a saved session 6."""

_INT_RANGE = range(-(2**63), 2**63)  # of TOML's whole numbers
# MAX_DEPTH keys with dots between them: tomllib takes memory and time as the square of their number
_DEEP_KEY = re.compile(r"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){32}")


def parse_toml(text: str, where: str, expected: str) -> dict[str, Any]:
    """The table of a TOML text.

    where: how errors name the text. expected: the kind of table that is wanted. Raises UserError for text that isn't
    TOML, is too long or too deep, or holds whole numbers of more than 64 bits.
    """
    try:
        return _load_toml(text, where, expected)
    except tomllib.TOMLDecodeError as error:
        raise UserError(where, f"isn't TOML: {error}", expected=expected) from error


def parse_toml_value(text: str, where: str) -> Any:
    """The value of a TOML expression such as [1, 2]; text that isn't TOML stands for itself.

    Raises UserError as `parse_toml` does for text that is too long, tables that are too deep and numbers too large.
    """
    try:
        return _load_toml(f"value = {text}", where, "a value in TOML")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def _load_toml(text: str, where: str, expected: str) -> dict[str, Any]:
    """The table of a TOML text. Raises TOMLDecodeError for text that isn't TOML, UserError beyond the limits."""
    if len(text) > TEXT_LIMIT:
        raise UserError(where, f"has {len(text)} characters", expected=f"{expected} of at most {TEXT_LIMIT}")
    if _DEEP_KEY.search(text):
        raise _too_deep(where, expected)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError as error:
        raise _too_deep(where, expected) from error
    except (ValueError, OverflowError) as error:  # numbers of thousands of digits, impossible dates
        raise UserError(where, f"isn't TOML: {error}", expected=expected) from error
    _check_values(table, where, expected)
    return table


def parse_json(text: str, where: str, expected: str, *, finite: bool = False) -> Any:
    """The value of a JSON text; finite: without NaN and infinity. Raises UserError as `parse_toml` does."""
    try:
        value = json.loads(text)
    except RecursionError as error:
        raise _too_deep(where, expected) from error
    except (ValueError, OverflowError) as error:
        raise UserError(where, f"can't be read: {error}", expected=expected) from error
    _check_values(value, where, expected, finite=finite)
    return value


def parse_json_table(text: str, where: str, expected: str, *, finite: bool = False) -> dict[str, Any]:
    """The table of a JSON text; finite: without NaN and infinity. Raises UserError as `parse_json` does, else too."""
    value = parse_json(text, where, expected, finite=finite)
    if not isinstance(value, dict):
        raise UserError(where, f"{type(value).__name__} in place of a table", expected=expected)
    return value


def _check_values(value: Any, where: str, expected: str, *, finite: bool = False) -> None:
    """Refuses tables that are too deep and whole numbers that are too large; without recursion."""
    level, depth = [value], 0
    while level:
        below: list[Any] = []
        for entry in level:
            if isinstance(entry, Mapping):
                below.append(entry.values())
            elif isinstance(entry, list):
                below.append(entry)
            elif isinstance(entry, int) and entry not in _INT_RANGE:
                raise UserError(where, "a whole number of more than 64 bits", expected=expected)
            elif finite and isinstance(entry, float) and not math.isfinite(entry):
                raise UserError(where, f"holds {entry}", expected=f"{expected} with finite numbers")
        depth += 1 if below else 0
        if depth > MAX_DEPTH:
            raise _too_deep(where, expected)
        level = [entry for entries in below for entry in entries]


def _too_deep(where: str, expected: str) -> UserError:
    return UserError(where, f"more than {MAX_DEPTH} tables or lists inside each other", expected=expected)


class ValueType(Protocol):
    """The type of a value in a table."""

    def parse(self, value: Any, where: str) -> Any:
        """The checked value. Raises UserError, with the place `where`, if it is wrong."""


def check_keys(
    keys: Iterable[str],
    known: Collection[str],
    outer: str = "",
    *,
    required: Iterable[str] = (),
    expected: str = "",
    noun: str = "key",
) -> None:
    """Raises UserError for a key that isn't known, with similar ones that are, and for a required one that is missing.

    outer: the text before the key in errors, with its punctuation, such as "bench.toml: camera.". expected: the words
    for a missing key in the error. noun: the kind of things that the keys name, such as "key" or "table".
    """
    given = list(keys)
    for key in given:
        if key not in known:
            raise UserError(f"{outer}{key}", f"unknown {noun}", remedy=suggest_matches(str(key), known))
    for key in required:
        if key not in given:
            raise UserError(f"{outer}{key}", "is missing", expected=expected)


def read_table(
    table: Mapping[str, Any],
    types_by_key: Mapping[str, ValueType],
    outer: str = "",
    *,
    required: Iterable[str] = (),
    expected: str = "",
    noun: str = "key",
) -> dict[str, Any]:
    """The checked values of a table, in its order; the arguments and errors are those of `check_keys`.

    Raises UserError also for values that aren't of their key's type.

    >>> from holoview.light.model.fields import Number
    >>> read_table({"gap": "2 mm"}, {"gap": Number("mm")}, "bench.toml: ")
    {'gap': 0.002}
    """
    check_keys(table, types_by_key, outer, required=required, expected=expected, noun=noun)
    return {key: types_by_key[key].parse(value, f"{outer}{key}") for key, value in table.items()}


Record = TypeVar("Record")


def read_record(record: type[Record], text: str, where: str, expected: str) -> Record:
    """An instance of a dataclass from the JSON table of its fields; tuples are lists in JSON.

    Values must have the types of the fields' annotations: bool, int, float (whole numbers too), str, None, and tuples
    of these. Raises UserError, with the place `where`, for other tables, and what the class raises, which is to check
    ranges: numbers may be infinite or NaN.
    """
    return record_from_table(record, parse_json_table(text, where, expected), f"{where}: ", expected=expected)


def record_from_table(
    record: type[Record],
    table: Mapping[str, Any],
    outer: str = "",
    *,
    expected: str = "",
    skips_unknown: bool = False,
    **given: Any,
) -> Record:
    """An instance of a dataclass from the table of its fields, as JSON has them; see `read_record`.

    outer: the text before a key in errors, with its punctuation. skips_unknown: leave keys out that aren't fields.
    given: values of fields that the table doesn't tell.
    """
    hints = typing.get_type_hints(record)
    fields = {field.name: field for field in dataclasses.fields(typing.cast(Any, record)) if field.name not in given}
    stated = {key: value for key, value in table.items() if key in fields} if skips_unknown else table
    required = [name for name, field in fields.items() if is_required(field)]
    check_keys(stated, fields, outer, required=required, expected=expected)
    values = {name: typed_value(value, hints[name], f"{outer}{name}") for name, value in stated.items()}
    try:
        return record(**values, **given)
    except UserError as error:
        raise error.inside(outer) from error


def is_required(field: dataclasses.Field[Any]) -> bool:
    """Whether a field of a dataclass has no default."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def typed_value(value: Any, hint: Any, where: str) -> Any:
    """A value of JSON as its annotation says: see `read_record`, and sets (lists in JSON) and dataclasses (tables).

    Raises UserError, with the place `where`, for another value.
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in arguments:
            return None
        return typed_value(value, next(argument for argument in arguments if argument is not type(None)), where)
    if origin is frozenset and isinstance(value, list):
        return frozenset(typed_value(entry, arguments[0], where) for entry in value)
    if dataclasses.is_dataclass(hint) and isinstance(value, Mapping):
        return record_from_table(typing.cast(type, hint), value, f"{where}.")
    if origin is tuple and isinstance(value, list):
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else list(arguments)
        if len(kinds) == len(value):
            pairs = zip(value, kinds, strict=True)
            return tuple(typed_value(entry, kind, f"{where}[{i}]") for i, (entry, kind) in enumerate(pairs))
    elif origin is typing.Literal and value in arguments:
        return value
    elif hint is float and type(value) in (int, float):
        return float(value)
    elif hint in (bool, int, str) and type(value) is hint:
        return value
    raise UserError(where, short_repr(value), expected=getattr(hint, "__name__", str(hint)))


def short_repr(value: Any) -> str:
    """The value in an error, as Python writes it, cut to 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


# --- arrays and numbers of files --------------------------------------------------------------------------------------


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
        if array.size != 1 or array.dtype.kind not in ("fiub" if self.whole else "fiu"):
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
