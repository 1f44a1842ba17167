"""What separates the numbers of a text, and which sign is their decimal sign: of pictures, sweeps and vendors' tables.

A comma is a decimal sign where something else separates the numbers, and where it couldn't as well group thousands or
join pairs: such texts are refused.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass

from holoview.util.errors import UserError

_SPACED = re.compile(r"[^,;\s][ \t]+[^,;\s]")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_WITH_POINTS = "write its numbers with decimal points"


@dataclass(frozen=True)
class NumberLayout:
    """What separates numbers, "" for spaces and tabs, and whether commas are decimal signs."""

    separator: str
    has_decimal_commas: bool

    def words(self, line: str) -> list[str]:
        """The words of a line, with decimal points; separators at its end separate nothing."""
        trimmed = line.rstrip(f"{self.separator} \t").replace(",", "." if self.has_decimal_commas else ",")
        return [word.strip() for word in trimmed.split(self.separator or None)]


def find_layout(lines: Sequence[str], where: str) -> NumberLayout:
    """The layout of lines of numbers, without headings and comments.

    where: the file, for the UserError that is raised where the commas may mean either.
    """
    text = "\n".join(lines)
    separator = ";" if ";" in text else "" if _SPACED.search(text) else ","
    if "," not in text:
        return NumberLayout("" if separator == "," else separator, False)
    if separator == ",":
        _check_plain_commas(lines, where)
        return NumberLayout(separator, False)
    words = [word.strip() for line in lines for word in line.split(separator or None)]
    with_commas = [word for word in words if "," in word]
    odd = next((word for word in with_commas if not _DECIMAL_COMMA.fullmatch(word)), None)
    if odd is not None or any("." in word for word in words):
        shown = odd or next(word for word in words if "." in word)
        found = f'both commas and {"semicolons" if separator else "spaces"} stand between digits, as in "{shown[:24]}"'
        raise UserError(where, found, expected="one separator", remedy=f"{_WITH_POINTS} and one separator")
    if all(_GROUPED.fullmatch(word) for word in with_commas):
        found = f'"{with_commas[0]}" may be {with_commas[0].replace(",", ".")} or {with_commas[0].replace(",", "")}'
        raise UserError(where, found, expected="decimal points", remedy=_WITH_POINTS)
    return NumberLayout(separator, True)


def read_csv(text: str, where: str) -> tuple[list[dict[str, str | None]], bool]:
    """The lines of a table with headings, {heading: cell}, None where cells are missing; whether its commas are decimal
    signs, which they are where semicolons separate the headings.

    where: the file. Raises UserError for a line with more cells than headings, as decimal commas between commas make,
    and for a table that can't be read.
    """
    separator = ";" if ";" in text.partition("\n")[0] else ","
    try:
        lines = list(csv.DictReader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise UserError(where, f"can't be read: {error}", expected="a table with headings") from error
    for number, line in enumerate(lines, start=2):
        cells = [cell for cell in line.pop(None, []) if cell.strip()]
        if cells:
            found = f"{len(line) + len(cells)} cells below {len(line)} headings"
            remedy = f"{_WITH_POINTS}, or semicolons between them"
            raise UserError(f"{where}, line {number}", found, expected="as many as headings", remedy=remedy)
    return lines, separator == ";"


def _check_plain_commas(lines: Sequence[str], where: str) -> None:
    """Raises UserError where commas seem to be both decimal signs and separators: every second word is the digits
    behind a decimal comma if there are no points, and some of these words begin with 0 as no whole number does."""
    rows = [[word.strip() for word in line.rstrip(", \t").split(",")] for line in lines]
    behind = [word for row in rows for word in row[1::2]]
    is_doubtful = all(word.isdecimal() for word in behind) and any(len(w) > 1 and w[0] == "0" for w in behind)
    if is_doubtful and all(len(row) % 2 == 0 and row[0].lstrip("-+").isdecimal() for row in rows):
        shown = ",".join(rows[0][:4])
        found = f'commas may be decimal signs as well as separators, as in "{shown}"'
        raise UserError(where, found, expected="one meaning", remedy=f"{_WITH_POINTS}, or semicolons between them")
