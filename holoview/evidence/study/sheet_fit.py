"""How much a part of a page must shrink to be printed on one sheet of A4, from the letters and pictures in it.

A block is a function from the width that it is given to the height that it takes, both in mm. Letters are taken as
wider than those of common sans-serif types are on average, so that heights are rather too large than too small.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable, Sequence

Block = Callable[[float], float]
"""Height of a part of a page at a width, both in mm."""

SHEET_MM = (186.0, 275.0)
"""Width and height inside the margins of a sheet of A4."""

_POINT_MM = 25.4 / 72
_LETTER_EM, _UPPER_EM, _DIGIT_EM = 0.58, 0.78, 0.64  # widths; DejaVu Sans, a wide type, has means of 0.56, 0.70, 0.64
_LINE = 1.36  # height of a line over the size of its type
_SPARE = 0.97  # of a sheet's height that is filled
_ZOOMS = [0.02 * step for step in range(50, 4, -1)]  # from 1 to 0.1


def text(words: str, points: float, space_mm: float = 0.0) -> Block:
    """A paragraph. points: size of its type. space_mm: above and below it together."""
    return lambda width_mm: _lines(words, width_mm, points) * points * _POINT_MM * _LINE + space_mm


def table(rows: Sequence[Sequence[str]], shares: Sequence[float], points: float) -> Block:
    """A table (row, column) of words whose columns have these shares of its width, between lines."""
    return lambda width_mm: sum(
        max(text(words, points, 1.2)(share * width_mm - 1.5) for words, share in zip(row, shares, strict=True))
        for row in rows
    )


def picture(aspect: float, caption: str, points: float, most_mm: float = float("inf")) -> Block:
    """A picture as wide as its place, or as high as `most_mm`. aspect: its height over its width."""
    return lambda width_mm: min(aspect * width_mm, most_mm) + text(caption, points)(width_mm)


def stack(blocks: Sequence[Block]) -> Block:
    """Blocks one below the other."""
    return lambda width_mm: sum(block(width_mm) for block in blocks)


def beside(blocks: Sequence[Block], columns: int, gap_mm: float) -> Block:
    """Blocks in columns of equal width, row by row."""

    def height(width_mm: float) -> float:
        heights = [block((width_mm - (columns - 1) * gap_mm) / columns) for block in blocks]
        return sum(max(heights[n : n + columns]) + gap_mm for n in range(0, len(heights), columns))

    return height


def fitting_zoom(block: Block) -> float:
    """The zoom, 1 or less, at which a block fits on a sheet; as of CSS, where it makes the sheet wider as well."""
    width, height = SHEET_MM
    return next((zoom for zoom in _ZOOMS if zoom * block(width / zoom) <= _SPARE * height), _ZOOMS[-1])


def _lines(words: str, width_mm: float, points: float) -> int:
    """Lines of a paragraph, broken at spaces and hyphens, and within words that are longer than a line."""
    line_em, count, used_em = width_mm / (points * _POINT_MM), 1, 0.0
    for part in re.findall(r"\s+|[^\s-]*-|[^\s-]+", words):
        part_em = sum(map(_letter_em, part))
        if used_em + part_em <= line_em or part.isspace():
            used_em += part_em
            continue
        further = math.ceil(part_em / line_em) - 1
        count, used_em = count + further + (used_em > 0), part_em - further * line_em
    return count


def _letter_em(letter: str) -> float:
    """The width of a letter over the size of its type."""
    if letter in "MWmw%@" or unicodedata.east_asian_width(letter) in "WF":
        return 1.0
    return _UPPER_EM if letter.isupper() else _DIGIT_EM if letter.isdigit() else _LETTER_EM
