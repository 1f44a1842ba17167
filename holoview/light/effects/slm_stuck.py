"""Columns, rows or pixels of a modulator are stuck: they show other levels than those that are sent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from holoview.light.model.effects.effect import Effect, ListParameter, Needs, Parameter, StartKind, Values
from holoview.light.model.system import System
from holoview.util.errors import UserError

if TYPE_CHECKING:
    from torch import Tensor

    from holoview.light.model.effects.hook_contexts import ModulatorContext


def _places(name: str, doc: str) -> Parameter:
    return ListParameter(name, doc, low=0, high=65535, prior=4, places=True)


def _levels(name: str, of: str) -> Parameter:
    doc = f"What {of} show, as a share of full drive; the last one holds for all that have none."
    return ListParameter(name, doc, low=-0.25, high=1.25, prior=0.3)


_SIDES = ("first_rows", "last_rows", "first_columns", "last_columns")
_PARTS = tuple(f"part_{side}" for side in _SIDES)
_TO_THE_EDGE = 65535


class SlmStuck(Effect):
    """Stuck columns, rows, parts of them and pixels of one modulator, and lines that show an earlier pattern.

    modulator: 0 for the first.
    """

    modulator: ClassVar[int]
    finding = element_finding = "{found} (counted from 0)."
    parameters = (
        _places("columns", "Columns that are stuck, counted from 0 at the left."),
        _levels("column_levels", "these columns"),
        _places("rows", "Rows that are stuck, counted from 0 at the top."),
        _levels("row_levels", "these rows"),
        _places("pixel_rows", "Rows of single pixels that are stuck."),
        _places("pixel_columns", "Columns of the same pixels, in the same order."),
        _levels("pixel_levels", "these pixels"),
        *(_places(part, f"{part[5:].replace('_', ' ').capitalize()} of rectangles that are stuck.") for part in _PARTS),
        _levels("part_levels", "these rectangles"),
        _places("kept_columns", "Columns that keep the first pattern of all."),
        _places("kept_rows", "Rows that keep the first pattern of all."),
        _places("late_columns", "Columns that show the pattern before."),
        _places("late_rows", "Rows that show the pattern before."),
    )
    element_kinds = ("phase", "amplitude")
    element_id = "slm_stuck"
    start_kinds = (StartKind.STUCK_PIXELS,)
    order = 1  # a dead pixel knows no table and doesn't settle, but its field reaches its neighbours
    varies_over_field = True

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        self._check(v, context.whole_shape, context.element or f"modulator {self.modulator + 1}")
        shown = share.clone()
        for place, level in _dead_places(v):
            shown[_inside(place, context)] = level
        return shown

    def settled_share(self, share: Tensor, before: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        shown = share.clone()
        for earlier, rows, columns in (
            (before, v["late_rows"], v["late_columns"]),
            (context.first_shown, v["kept_rows"], v["kept_columns"]),
        ):
            for place in (*((row, row, 0, _TO_THE_EDGE) for row in rows), *((0, _TO_THE_EDGE, x, x) for x in columns)):
                if earlier is not None:
                    inside = _inside(place, context)
                    shown[inside] = earlier[inside]
        return shown

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        levels = [level for _, level in _dead_places(v)]
        places = describe_places(v["columns"], v["rows"], _pixels(v), _parts(v))
        modulator = f"of modulator {self.modulator + 1}"
        verb = is_or_are(levels) if not _parts(v) else "are"
        dead = f"{places} {modulator} {verb} stuck at {describe_levels(levels)} of full drive"
        found = [f"{dead}, whatever is sent"] if levels else []
        for what, columns, rows in (
            ("the first pattern of all", v["kept_columns"], v["kept_rows"]),
            ("the pattern before", v["late_columns"], v["late_rows"]),
        ):
            if lines := [*columns, *rows]:
                verb = "shows" if len(lines) == 1 else "show"
                found.append(f"{describe_places(columns, rows, ())} {modulator} {verb} {what} instead of what is sent")
        first, *others = found or [f"No pixels {modulator} are stuck"]
        return {"found": "; ".join([first, *(text[0].lower() + text[1:] for text in others)])}

    def _check(self, v: Values, shape: tuple[int, int], where: str) -> None:
        """Raises UserError unless all places begin inside. shape: rows and columns of the modulator `where`."""
        for name, count in _counted(shape):
            if max(v[name], default=0) >= count:
                size = f"{where} has {shape[0]} rows and {shape[1]} columns, counted from 0"
                raise UserError(
                    name, f"{max(v[name]):g}", expected=f"at most {count - 1}, since {size}", remedy="leave it out"
                )

    def contradiction(self, v: Values) -> str:
        for lists in (("pixel_rows", "pixel_columns"), _PARTS):
            if len({len(v[name]) for name in lists}) > 1:
                return f"has {', '.join(f'{len(v[name])} {name}' for name in lists)}: as many of each are needed"
        return ""


def _counted(shape: tuple[int, int]) -> list[tuple[str, int]]:
    """Each parameter that has to lie inside a modulator, with the number of rows or columns there."""
    names = ("rows", "pixel_rows", "part_first_rows", "kept_rows", "late_rows")
    return [(n, shape[0]) for n in names] + [(n.replace("rows", "columns"), shape[1]) for n in names]


Place = tuple[int, int, int, int]
"""First and last row, first and last column."""


def _dead_places(v: Values) -> list[tuple[Place, float]]:
    """Each place that keeps to a level, with that level; where places overlap, the last one is seen."""
    rows = [((y, y, 0, _TO_THE_EDGE), level) for y, level in _with_levels(v["rows"], v["row_levels"])]
    columns = [((0, _TO_THE_EDGE, x, x), level) for x, level in _with_levels(v["columns"], v["column_levels"])]
    pixels = [((y, y, x, x), level) for (y, x), level in _with_levels(_pixels(v), v["pixel_levels"])]
    return [*rows, *columns, *_with_levels(_parts(v), v["part_levels"]), *pixels]


def _inside(place: Place, context: ModulatorContext) -> tuple[slice, slice]:
    """Its rows and columns among those of the context, which may be a part of a modulator."""
    top, left = context.first_pixel
    first_row, last_row, first_column, last_column = place
    return (
        slice(max(first_row - top, 0), max(last_row + 1 - top, 0)),
        slice(max(first_column - left, 0), max(last_column + 1 - left, 0)),
    )


def _parts(v: Values) -> list[Place]:
    """First and last row, first and last column of each rectangle."""
    return list(zip(*(v[part] for part in _PARTS), strict=False))


def _pixels(v: Values) -> list[tuple[int, int]]:
    """(row, column) of each single pixel."""
    return list(zip(v["pixel_rows"], v["pixel_columns"], strict=False))


def _with_levels(places: Sequence[Any], levels: Sequence[float]) -> list[tuple[Any, float]]:
    """Each place with its level: the last one for places that have none, 0 where there is no level at all."""
    known = list(levels) or [0.0]
    return [(place, known[min(i, len(known) - 1)]) for i, place in enumerate(places)]


class Slm1Stuck(SlmStuck):
    """Fraction of the stroke = level_j at the stuck place j, whatever was sent.

    The backplane addresses pixels by a driver for each column and a gate for each row. Where one of them, or a
    contact, fails, a whole line keeps one voltage, and single pixels stay at theirs (Armitage, Underwood & Wu,
    Introduction to Microdisplays, Wiley 2006, chapter 2). Where lines cross, the column is seen.
    """

    id = "slm1_stuck"
    cause = "Columns, rows or pixels of modulator 1 are stuck: they show the same whatever is sent."
    acts_on = ("modulator 1",)
    modulator = 0


class Slm2Stuck(SlmStuck):
    """Fraction of the stroke = level_j at the stuck place j, as for modulator 1 (`slm1_stuck`)."""

    id = "slm2_stuck"
    cause = "Columns, rows or pixels of modulator 2 are stuck: they show the same whatever is sent."
    acts_on = ("modulator 2",)
    modulator = 1
    needs = Needs(modulators=2)


# --- stuck places in words ------------------------------------------------------------------------------------------


Pixel = tuple[int, int]
_MAX_GROUPS = 4


def describe_places(
    columns: Sequence[int], rows: Sequence[int], pixels: Sequence[Pixel], rectangles: Sequence[Place] = ()
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


def _rectangle(sides: Place) -> str:
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
