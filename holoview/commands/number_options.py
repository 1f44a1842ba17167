"""Numbers as values of options: finite and in range before a command begins.

Every option that takes a number has one of these types; options with a unit are parsed by `util.units`.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

_LONGEST = 40  # characters; Python takes the square of the time for integers of many


def number(low: float = -1e30, high: float = 1e30) -> Callable[[str], float]:
    """An argparse type: a real number from `low` to `high`, both included, never NaN or infinite."""

    def parse(text: str) -> float:
        try:
            value = float(text) if len(text) <= _LONGEST else math.nan
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            expected = "a finite number" if (low, high) == (-1e30, 1e30) else f"a number from {low:g} to {high:g}"
            raise argparse.ArgumentTypeError(f"{_short(text)}; expected {expected}")
        return value

    return parse


def whole(low: int, high: int = 1_000_000) -> Callable[[str], int]:
    """An argparse type: a whole number from `low` to `high`, both included."""

    def parse(text: str) -> int:
        try:
            value = int(text) if len(text) <= _LONGEST else high + 1
        except ValueError:
            value = high + 1
        if not low <= value <= high:
            above = f"a whole number of at least {low}, at most {high}"
            raise argparse.ArgumentTypeError(f"{_short(text)}; expected {above}")
        return value

    return parse


def _short(text: str) -> str:
    return repr(text) if len(text) <= _LONGEST else f"{text[:20]!r}… of {len(text)} characters"
