"""Text with a unit, such as "8 um" or "5 mrad", to an SI number and back without losing a digit.

Scaling by powers of ten is done in decimal arithmetic, so that "460 nm" → 4.6e-07 → "460 nm" is exact, which a
multiplication of binary floating-point numbers wouldn't be.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal, InvalidOperation, Overflow
from typing import Any, Literal

import numpy as np

from holoview.util.errors import UserError, suggest_matches

Quantity = Literal["length", "angle", "vergence"]

_EXPONENT: dict[Quantity, dict[str, int]] = {
    "length": {"pm": -12, "nm": -9, "um": -6, "µm": -6, "μm": -6, "mm": -3, "cm": -2, "m": 0},
    "angle": {"urad": -6, "µrad": -6, "μrad": -6, "mrad": -3, "rad": 0},
    "vergence": {"D": 0},
}
_EXAMPLE: dict[Quantity, str] = {
    "length": '"8 um", "550 nm" or "2 mm"',
    "angle": '"5 mrad" or "0.3 rad"',
    "vergence": '"0.5 D"',
}
_TEXT = re.compile(r"\s*+([-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?)\s*+([^\s\d.+-]\S*+)?\s*+")
_LONGEST, _SHOWN = 1000, 80  # characters of a number with its unit, and of them in an error


def parse(value: str | float, where: str, quantity: Quantity = "length") -> float:
    """The SI value (m, rad or dioptres, 1/m) of a text such as "8 um"; a number is taken as an SI value.

    Raises UserError, with the place `where`, when the text isn't a number with a known unit of this quantity.
    """
    a = {"length": "a length", "angle": "an angle", "vergence": "a number of dioptres"}[quantity]
    if isinstance(value, bool) or not isinstance(value, str | int | float | np.integer | np.floating):
        raise UserError(where, f"{value!r} is not {a}", expected=f"text such as {_EXAMPLE[quantity]}")
    if not isinstance(value, str):
        return to_float(value)
    match = _TEXT.fullmatch(value) if len(value) <= _LONGEST else None
    if match is None:
        expected = f"a number and a unit such as {_EXAMPLE[quantity]}"
        raise UserError(where, f'"{value[:_SHOWN]}" is not {a}', expected=expected)
    number, unit = match.groups()
    if unit is None:
        raise UserError(where, f'"{value}" has no unit', expected=f"text such as {_EXAMPLE[quantity]}")
    exponents = _EXPONENT[quantity]
    if unit not in exponents:
        raise UserError(where, f'"{value}" has the unit "{unit}"', expected=a, remedy=suggest_matches(unit, exponents))
    try:
        parsed = float(Decimal(number).scaleb(exponents[unit]))
    except (InvalidOperation, Overflow):
        parsed = math.inf
    if math.isinf(parsed):
        raise UserError(where, f'"{value}" is out of range', expected=f"text such as {_EXAMPLE[quantity]}")
    return parsed


def parse_several(text: str, where: str) -> list[float]:
    """Lengths (m) that are separated by commas; a number without a unit has that of the last one: 2,3,4mm.

    Raises UserError, with the place `where`, for text of another kind.
    """
    parts = [part.strip() for part in text.split(",")]
    unit = parts[-1].lstrip("+-.0123456789 ")
    return [parse(part if part[-1:].isalpha() else f"{part} {unit}", where) for part in parts]


def to_float(value: float | np.integer[Any] | np.floating[Any]) -> float:
    """The value as a float, infinity for whole numbers that are too large for one."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def quantity_of(unit: str) -> Quantity:
    """The quantity that a unit measures.

    >>> quantity_of("mrad"), quantity_of("D")
    ('angle', 'vergence')
    """
    return next(quantity for quantity, table in _EXPONENT.items() if unit in table)


def format_exact(value: float, unit: str) -> str:
    """An SI value in `unit` with all its digits, e.g. 4.6e-07 in "nm" is "460 nm": `parse` returns exactly `value`."""
    return f"{_plain(Decimal(repr(float(value))).scaleb(-_exponent(unit)))} {unit}"


def format_rounded(value: float, unit: str, digits: int = 4) -> str:
    """An SI value in `unit`, rounded to `digits` significant digits."""
    return f"{value * 10.0 ** -_exponent(unit):.{digits}g} {unit}"


def with_symbols(text: str) -> str:
    """A text of units as a window or a drawing shows it, "µm" for "um"; files and the command line keep to ASCII."""
    return re.sub(r"\bum\b", "µm", text)


def format_duration(seconds: float) -> str:
    """A time in words of two digits or so: "0.24 s", "35 s", "4 min", "2.5 h"."""
    if seconds < 99.5:
        return f"{seconds:.2g} s"
    return f"{seconds / 60:.2g} min" if seconds < 5970 else f"{seconds / 3600:.2g} h"


def _exponent(unit: str) -> int:
    """The power of ten of a unit."""
    return next(table[unit] for table in _EXPONENT.values() if unit in table)


def _plain(number: Decimal) -> str:
    """Without an exponent for ordinary sizes."""
    normal = number.normalize()
    return f"{normal:f}" if -7 < normal.adjusted() < 12 else str(normal)
