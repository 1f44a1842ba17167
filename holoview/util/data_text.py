"""Parses TOML and JSON from unknown sources: nesting and whole numbers are bounded, and every fault is a UserError."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from holoview.util.errors import UserError
from holoview.util.input_file import TEXT_LIMIT

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

    Raises UserError as `parse_toml` does for what is too long, too deep or too large.
    """
    try:
        return _load_toml(f"value = {text}", where, "a value in TOML")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def _load_toml(text: str, where: str, expected: str) -> dict[str, Any]:
    """The table of a TOML text. Raises TOMLDecodeError for text that isn't TOML, UserError for what is too much."""
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
    """Refuses what is too deep, and whole numbers that are too large; without recursion."""
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
