"""Stuck places of a modulator in words: columns, rows, parts of them and groups of pixels, and their levels."""

from __future__ import annotations

from collections.abc import Sequence

Pixel = tuple[int, int]
Rectangle = tuple[int, int, int, int]
"""First and last row, first and last column."""

_MAX_GROUPS = 4


def describe_places(
    columns: Sequence[int], rows: Sequence[int], pixels: Sequence[Pixel], rectangles: Sequence[Rectangle] = ()
) -> str:
    """Such as "Columns 12, 40 to 42 and row 7 and 16 pixels (rows 10 to 13, columns 20 to 23)"."""
    parts = [_lines("column", columns), _lines("row", rows), *map(_rectangle, rectangles), _groups(pixels)]
    text = _listed([part for part in parts if part]) or "no pixels"
    return text[0].upper() + text[1:]


def is_or_are(things: Sequence[object]) -> str:
    """The verb for one thing or for several."""
    return "is" if len(things) == 1 else "are"


def describe_levels(levels: Sequence[float]) -> str:
    """The range of the levels, such as "0.2 to 0.85"."""
    if not levels:
        return "nothing"
    low, high = (f"{round(level, 3) + 0.0:g}" for level in (min(levels), max(levels)))  # without the sign of −0
    return low if low == high else f"{low} to {high}"


def _lines(name: str, numbers: Sequence[int]) -> str:
    if not numbers:
        return ""
    return f"{name}{'s' * (len(set(numbers)) > 1)} {_listed(_runs(numbers))}"


def _rectangle(sides: Rectangle) -> str:
    """Such as "rows 48 to 95 of column 70", "columns 0 to 31 of row 5" or "rows 2 to 5 of columns 7 to 9"."""
    top, bottom, left, right = sides
    rows, columns = _stretch("row", top, bottom), _stretch("column", left, right)
    return f"{columns} of {rows}" if top == bottom else f"{rows} of {columns}"


def _stretch(name: str, first: int, last: int) -> str:
    return f"{name} {first}" if first == last else f"{name}s {first} to {last}"


def _groups(pixels: Sequence[Pixel]) -> str:
    """Pixels that touch each other, with the rows and columns between which they lie; the largest groups first."""
    if not pixels:
        return ""
    groups = sorted(_touching(pixels), key=lambda group: (-len(group), group))
    texts = [
        f"{_lines('row', _between(y for y, _ in group))}, {_lines('column', _between(x for _, x in group))}"
        for group in groups[:_MAX_GROUPS]
    ]
    more = [f"{len(groups) - _MAX_GROUPS} more places"] if len(groups) > _MAX_GROUPS else []
    count = len(set(pixels))
    return f"{count} pixel{'s' * (count > 1)} ({'; '.join([*texts, *more])})"


def _between(numbers: object) -> list[int]:
    known = sorted(numbers)  # type: ignore[call-overload]
    return list(range(known[0], known[-1] + 1))


def _touching(pixels: Sequence[Pixel]) -> list[list[Pixel]]:
    """Groups of pixels that have an edge or a corner in common."""
    left, groups = set(pixels), []
    while left:
        group, fresh = [], [left.pop()]
        while fresh:
            y, x = fresh.pop()
            group.append((y, x))
            near = {(y + dy, x + dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)} & left
            left -= near
            fresh += near
        groups.append(sorted(group))
    return groups


def _runs(numbers: Sequence[int]) -> list[str]:
    """Sorted numbers, three or more that follow each other as "3 to 5"."""
    ordered, texts = sorted(set(numbers)), []
    while ordered:
        length = next((i for i, n in enumerate(ordered) if n != ordered[0] + i), len(ordered))
        run, ordered = ordered[:length], ordered[length:]
        texts += [f"{run[0]} to {run[-1]}"] if length > 2 else [str(n) for n in run]
    return texts


def _listed(texts: Sequence[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)
