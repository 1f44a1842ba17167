"""View settings as values for JSON and back; what a file holds is checked, since anything may have happened to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, fields, replace
from typing import Any

from holoview.model.pupil_path import PupilPath
from holoview.render.view_settings import ComparisonSide, ViewSettings


def view_settings_table(view: ViewSettings) -> dict[str, Any]:
    """The fields as values that JSON can hold, without the path of the pupil."""
    return asdict(replace(view, pupil_path=None)) | {"muted": sorted(view.muted)}


def view_settings_from_table(table: Mapping[str, Any], pupil_path: PupilPath | None = None) -> ViewSettings:
    """The view settings of a table; a field that is missing gets its default, an unknown one is left out.

    Raises TypeError or KeyError for a value of a wrong type, UserError or ValueError for one out of range.
    """
    read_values = {name: read(table[name]) for name, read in _READERS.items() if name in table}
    return ViewSettings(**read_values, pupil_path=pupil_path)


def pupil_path_from_table(table: Mapping[str, Any]) -> PupilPath:
    """The path whose columns a table holds. Raises as `view_settings_from_table` does."""
    read = _several(finite)
    columns = {field.name: read(table[field.name]) for field in fields(PupilPath) if field.default is MISSING}
    further = {
        field.name: _optional(read)(table[field.name]) for field in fields(PupilPath) if field.name not in columns
    }
    return PupilPath(**columns, **further)


def finite(value: Any) -> float:
    """A finite number. Raises TypeError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"{value!r} is no finite number")
    return float(value)


def text(value: Any) -> str:
    """A text. Raises TypeError for anything else."""
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value


def index(value: Any) -> int:
    """A whole number from 0. Raises TypeError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise TypeError(f"{value!r} is no whole number from 0")
    return value


def _optional(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else read(value)


def _several(read: Callable[[Any], Any], count: int | None = None) -> Callable[[Any], tuple[Any, ...]]:
    """A list of values, of a fixed number of them if `count` says so, as a tuple."""

    def read_all(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or count not in (None, len(value)):
            raise TypeError(f"{value!r} is no list of {count or 'values'}")
        return tuple(map(read, value))

    return read_all


def _side(value: Any) -> ComparisonSide:
    return ComparisonSide(text(value["kind"]), text(value["name"]))


_READERS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("plane_m", "exposure_stops", "gamma", "low", "high", "wipe", "zoom"), finite),
    **dict.fromkeys(("channel", "false_colour", "page", "compare", "score"), text),
    **dict.fromkeys(("frame", "modulator"), index),
    **dict.fromkeys(("a", "b"), _side),
    "solo": _optional(index),
    "muted": lambda value: frozenset(_several(index)(value)),
    "region": _optional(_several(index, 4)),
    "profile": _optional(_several(finite, 4)),
    "centre": _several(finite, 2),
}
