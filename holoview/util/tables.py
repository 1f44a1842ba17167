"""Tables from unknown sources: TOML and JSON are parsed, keys and values are checked, and every fault is a UserError.

parse_toml, parse_json    a text as tables, lists and numbers; nesting and whole numbers are bounded
check_keys                refuses unknown and missing keys
read_table                the values of a table whose keys have types, such as those of `holoview.model.fields`
read_record               a dataclass from the JSON text of its fields, by their annotations
record_from_table         the same from the parsed table; typed_value: one value as an annotation says
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
from typing import Any, Protocol, TypeVar

from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import TEXT_LIMIT

MAX_DEPTH = 32
"""Most tables and lists inside each other; a bench has 4, a saved session 6."""

_INT_RANGE = range(-(2**63), 2**63)  # of TOML's whole numbers
# MAX_DEPTH keys with dots between them: tomllib takes memory and time as the square of their number
_DEEP_KEY = re.compile(r"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){32}")


def parse_toml(text: str, where: str, expected: str) -> dict[str, Any]:
    """The table of a TOML text.

    where: how errors name the text. expected: what it is to be. Raises UserError for text that isn't TOML, is too long
    or too deep, or holds whole numbers of more than 64 bits.
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

    outer: what comes before the key in errors, with its punctuation, such as "bench.toml: camera.".
    expected: what the error for a missing key expects. noun: what the keys name, such as "key" or "table".
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

    >>> from holoview.model.fields import Number
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

    outer: what comes before a key in errors, with its punctuation. skips_unknown: leave keys out that aren't fields.
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
    elif hint is float and type(value) in (int, float):
        return float(value)
    elif hint in (bool, int, str) and type(value) is hint:
        return value
    raise UserError(where, short_repr(value), expected=getattr(hint, "__name__", str(hint)))


def short_repr(value: Any) -> str:
    """The value in an error, as Python writes it, cut to 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"
