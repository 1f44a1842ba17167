"""People's units at the edges: text such as "8 um" or "550 nm" to SI and back, without losing a digit.

Numbers are moved by powers of ten in decimal, so that "460 nm" → 4.6e-07 → "460 nm" is exact.
"""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation, Overflow
from typing import Literal

import numpy as np

from holoview.util.errors import UserError, suggest_matches

Quantity = Literal["length", "angle"]

_EXPONENT: dict[Quantity, dict[str, int]] = {
    "length": {"pm": -12, "nm": -9, "um": -6, "µm": -6, "μm": -6, "mm": -3, "cm": -2, "m": 0},
    "angle": {"urad": -6, "µrad": -6, "μrad": -6, "mrad": -3, "rad": 0},
}
_EXAMPLE: dict[Quantity, str] = {"length": '"8 um", "550 nm" or "2 mm"', "angle": '"5 mrad" or "0.3 rad"'}
_TEXT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d.+-]\S*)?\s*")


def parse(value: str | float, where: str, quantity: Quantity = "length") -> float:
    """SI value of people's text such as "8 um"; a plain number is SI already.

    Raises UserError that names `where` when the text isn't a number with a known unit of this quantity.
    """
    a = "an angle" if quantity == "angle" else "a length"
    if isinstance(value, bool) or not isinstance(value, str | int | float | np.integer | np.floating):
        raise UserError(where, f"{value!r} is not {a}", expected=f"text such as {_EXAMPLE[quantity]}")
    if not isinstance(value, str):
        return float(value)
    match = _TEXT.fullmatch(value)
    if match is None:
        raise UserError(where, f'"{value}" is not {a}', expected=f"a number and a unit such as {_EXAMPLE[quantity]}")
    number, unit = match.groups()
    if unit is None:
        raise UserError(where, f'"{value}" has no unit', expected=f"text such as {_EXAMPLE[quantity]}")
    exponents = _EXPONENT[quantity]
    if unit not in exponents:
        raise UserError(where, f'"{value}" has the unit "{unit}"', expected=a, remedy=suggest_matches(unit, exponents))
    try:
        return float(Decimal(number).scaleb(exponents[unit]))
    except (InvalidOperation, Overflow) as error:
        raise UserError(where, f'"{value}" is out of range', expected=f"text such as {_EXAMPLE[quantity]}") from error


def format_exact(value: float, unit: str) -> str:
    """`value` (SI) in people's `unit`, e.g. text(4.6e-07, "nm") = "460 nm"; parse() gives exactly `value` back."""
    exponent = next(table[unit] for table in _EXPONENT.values() if unit in table)
    return f"{_plain(Decimal(repr(float(value))).scaleb(-exponent))} {unit}"


def format_rounded(value: float, unit: str, digits: int = 4) -> str:
    """`value` (SI) in people's `unit`, rounded for reading."""
    exponent = next(table[unit] for table in _EXPONENT.values() if unit in table)
    return f"{value * 10.0**-exponent:.{digits}g} {unit}"


def _plain(number: Decimal) -> str:
    normal = number.normalize()
    return f"{normal:f}" if -7 < normal.adjusted() < 12 else str(normal)
