"""Base class of stuck pixels: what is dead in one modulator shows the same whatever is sent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from holoview.effects.stuck_places import describe_levels, describe_places
from holoview.model.effects.effect import Effect
from holoview.model.effects.list_parameter import ListParameter
from holoview.model.effects.parameter import Parameter, Values
from holoview.model.system import System
from holoview.util.errors import UserError

if TYPE_CHECKING:  # torch takes seconds to import
    from torch import Tensor

    from holoview.model.effects.hook_contexts import ModulatorContext


def _places(name: str, doc: str) -> Parameter:
    return ListParameter(name, doc, low=0, high=65535, prior=4, places=True)


def _levels(name: str, of: str) -> Parameter:
    doc = f"What {of} show, as a share of the stroke; the last one holds for all that have none."
    return ListParameter(name, doc, low=-0.25, high=1.25, prior=0.3)


class SlmStuck(Effect):
    """Stuck columns, rows and pixels of one modulator.

    modulator: 0 for the first.
    """

    modulator: ClassVar[int]
    finding = "{places} of {modulator} stuck at {levels} of the stroke, whatever is sent (counted from 0)."
    parameters = (
        _places("columns", "Columns that are stuck, counted from 0 at the left."),
        _levels("column_levels", "these columns"),
        _places("rows", "Rows that are stuck, counted from 0 at the top."),
        _levels("row_levels", "these rows"),
        _places("pixel_rows", "Rows of single pixels that are stuck."),
        _places("pixel_columns", "Columns of the same pixels, in the same order."),
        _levels("pixel_levels", "these pixels"),
    )
    order = 1  # a dead pixel knows no table and doesn't settle, but its field reaches its neighbours
    varies_over_field = True

    def stroke_response(self, share: Tensor, context: ModulatorContext, v: Values) -> Tensor:
        if len(v["pixel_rows"]) != len(v["pixel_columns"]):
            found = f"{len(v['pixel_rows'])} pixel_rows and {len(v['pixel_columns'])} pixel_columns"
            raise UserError(f"effects.{self.id}", found, expected="a row and a column of each pixel")
        shown = share.clone()
        first = [(whole - n) // 2 for whole, n in zip(context.whole_shape, context.shape, strict=True)]
        inside = [range(low, low + n) for low, n in zip(first, context.shape, strict=True)]
        for row, level in _with_levels(v["rows"], v["row_levels"]):
            if row in inside[0]:
                shown[row - first[0]] = level
        for column, level in _with_levels(v["columns"], v["column_levels"]):
            if column in inside[1]:
                shown[:, column - first[1]] = level
        for (row, column), level in _with_levels(_pixels(v), v["pixel_levels"]):
            if row in inside[0] and column in inside[1]:
                shown[row - first[0], column - first[1]] = level
        return shown

    def finding_fields(self, system: System, v: Values) -> dict[str, str]:
        levels = [
            level
            for places, own in (
                (v["columns"], v["column_levels"]),
                (v["rows"], v["row_levels"]),
                (_pixels(v), v["pixel_levels"]),
            )
            for _, level in _with_levels(places, own)
        ]
        return {
            "places": describe_places(v["columns"], v["rows"], _pixels(v)),
            "modulator": f"modulator {self.modulator + 1} {'is' if len(levels) == 1 else 'are'}",
            "levels": describe_levels(levels),
        }


def _pixels(v: Values) -> list[tuple[int, int]]:
    """(row, column) of each single pixel."""
    return list(zip(v["pixel_rows"], v["pixel_columns"], strict=False))


def _with_levels(places: Sequence[Any], levels: Sequence[float]) -> list[tuple[Any, float]]:
    """Each place with its level: the last one for places that have none, 0 where there is no level at all."""
    known = list(levels) or [0.0]
    return [(place, known[min(i, len(known) - 1)]) for i, place in enumerate(places)]
