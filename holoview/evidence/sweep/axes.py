"""The parameters of a sweep and their values, from text such as "gap=1mm:3mm:9" or "frames=1,3".

A key is one of a preset ("relay2.iris_na"), of an effect ("effects.gap.gap_error") or of the optimiser
("optimiser.iterations", an option of `Settings`).
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from holoview.holograms.optimise.settings import Settings
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.fields import Integer, Maybe, field_for, fields_by_key
from holoview.light.model.shorthand import MODULATOR_KEYS, SAMPLING_KEYS
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.tables import parse_toml_value

OPTIMISER = "optimiser"
_SHORTHANDS = (*MODULATOR_KEYS, *SAMPLING_KEYS, "frames")
_MOST_POINTS = 10_000
_RANGE = re.compile(r"\s*([-+.\d][^:\[\]{}\"',]*|[-+]?(?:nan|inf)[^:]*):([^:\[\]{}\"',]*)(?::([^:]*))?", re.IGNORECASE)
_MEASURED = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-zµμ]*)\s*")
_EXPECTED = "FIRST:LAST:COUNT with COUNT of 2 or more, such as gap=1mm:3mm:9, or values with commas"

Point = Mapping[str, Any]
"""The values of the parameters by their keys."""


@dataclass(frozen=True)
class Axis:
    """A parameter and its values.

    values: SI numbers, whole numbers, or anything that a preset may say. unit: in which they are shown, "" for plain
    numbers. is_range: whether they are spaced evenly between two numbers.
    """

    key: str
    values: tuple[Any, ...]
    unit: str = ""
    is_range: bool = False

    @property
    def is_numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in self.values)

    @property
    def heading(self) -> str:
        """The key with the unit."""
        return f"{self.key} ({self.unit})" if self.unit else self.key

    def shown(self, value: Any) -> Any:
        """A value as a number in the unit; texts and lists as they are."""
        return float(units.format_exact(value, self.unit).split()[0]) if self.unit else value

    def text(self, value: Any) -> str:
        """A value with its unit, rounded to four digits."""
        if self.unit:
            return units.format_rounded(value, self.unit)
        return f"{value:.4g}" if isinstance(value, float) else str(value)


def split_changes(changes: Sequence[str]) -> tuple[list[Axis], list[str]]:
    """The axes among KEY=VALUE texts, and the texts with a single value, which change the bench at every point.

    Raises UserError for a text that isn't KEY=VALUE, a range that isn't one, and a key that is swept twice.
    """
    axes: list[Axis] = []
    fixed = []
    for change in changes:
        axis = parse_axis(change)
        if axis is None:
            fixed.append(change)
        elif any(other.key == axis.key for other in axes):
            raise UserError(f"--set {axis.key}", "is swept twice", expected="each parameter once")
        else:
            axes.append(axis)
    count = math.prod(len(axis.values) for axis in axes)
    if count > _MOST_POINTS:
        raise UserError("--set", f"{count} points in all", expected=f"at most {_MOST_POINTS}")
    return axes, fixed


def parse_axis(text: str) -> Axis | None:
    """The axis of KEY=FIRST:LAST:COUNT or KEY=A,B,…; None for KEY=VALUE with a single value.

    A number without a unit has that of the last one. Raises UserError for a range with fewer than two points, that
    doesn't rise, or whose ends aren't finite numbers of one quantity.
    """
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not key:
        raise UserError(f"--set {text}", "isn't KEY=VALUE", expected=_EXPECTED)
    where = f"--set {key}"
    parts = _split(value)
    match = _RANGE.fullmatch(value) if len(parts) == 1 else None
    if match is not None:
        return _parse_range(key, where, value.strip(), *match.groups())
    if len(parts) == 1:
        return None
    if not all(part.strip() for part in parts):
        raise UserError(where, f'"{value}" has an empty value', expected=_EXPECTED)
    unit = _unit_of(parts[-1])
    values = tuple(_parse_value(part, unit, where) for part in parts)
    if len({repr(value) for value in values}) < len(values):
        raise UserError(where, f'"{value}" has a value twice', expected="values that differ")
    return Axis(key, values, unit if all(isinstance(v, int | float) for v in values) else "")


def _parse_range(key: str, where: str, text: str, first: str, last: str, count: str | None) -> Axis:
    unit = _unit_of(last)
    low, high = (_parse_value(end, unit, where) for end in (first, last))
    for end, number in ((first, low), (last, high)):
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            raise UserError(where, f'"{end.strip()}" in {text}', expected="a finite number at each end of a range")
    if bool(_unit_of(first)) and units.quantity_of(_unit_of(first)) != units.quantity_of(unit or "m"):
        raise UserError(where, f"{text} mixes units", expected="ends of one quantity")
    if count is None or not count.strip().isdecimal() or len(count.strip()) > 5 or int(count) < 2:
        raise UserError(where, f"{text} isn't a range", expected=_EXPECTED)
    if not low < high:
        raise UserError(where, f"{text} doesn't rise", expected=_EXPECTED, remedy=f"{last}:{first}:{count}")
    numbers = [float(f"{number:.12g}") for number in np.linspace(low, high, int(count))]  # without rounding errors
    counts = not unit and isinstance(low, int) and isinstance(high, int)
    values = tuple(int(value) if counts and value.is_integer() else value for value in numbers)
    return Axis(key, values, unit, is_range=True)


def _split(text: str) -> list[str]:
    """The parts of a text between commas that stand in no brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for sign in text:
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "\"'":
            quote = sign
        depth += not quote and sign in "[{"
        depth -= not quote and sign in "]}"
        if sign == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += sign
    return parts


def _unit_of(text: str) -> str:
    """The unit of a number with one; "" without."""
    match = _MEASURED.fullmatch(text)
    if match is None or not match[2]:
        return ""
    try:
        units.quantity_of(match[2])
    except StopIteration:
        return ""
    return match[2]


def _parse_value(text: str, unit: str, where: str) -> Any:
    """A value: a length, an angle or a vergence in SI units, or what TOML says. unit: of a number without one."""
    match = _MEASURED.fullmatch(text)
    if match is None:
        return parse_toml_value(text, where)
    own = _unit_of(text) or (unit if not match[2] else "")
    if own:
        return units.parse(f"{match[1]} {own}", where, units.quantity_of(own))
    return parse_toml_value(text, where)


# --- the points of a sweep --------------------------------------------------------------------------------------------


def grid_points(axes: Sequence[Axis]) -> list[dict[str, Any]]:
    """Every combination of the values, the last axis fastest."""
    combinations = itertools.product(*(axis.values for axis in axes))
    return [dict(zip([axis.key for axis in axes], values, strict=True)) for values in combinations]


def point_text(axes: Sequence[Axis], point: Point) -> str:
    """A point in words: "gap = 2 mm, frames = 3"."""
    return ", ".join(f"{axis.key} = {axis.text(point[axis.key])}" for axis in axes)


def bench_changes(point: Point) -> dict[str, Any]:
    """The changes of the bench at a point."""
    return {key: value for key, value in point.items() if not is_of_optimiser(key)}


def optimiser_changes(point: Point) -> dict[str, Any]:
    """The options of the optimiser at a point, by their keys."""
    return {key.partition(".")[2]: value for key, value in point.items() if is_of_optimiser(key)}


def is_of_optimiser(key: str) -> bool:
    """Whether a key is that of an option of the optimiser."""
    return key.partition(".")[0] == OPTIMISER


def settings_with(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Settings of the optimiser with some changed by their keys. Raises UserError for unknown keys and wrong values."""
    values = {field.name: getattr(settings, field.name) for field in fields_by_key(Settings).values()}
    try:
        return Settings(**values | {field_for(Settings, key).name: value for key, value in changes.items()})
    except UserError as error:
        raise error.inside(f"{OPTIMISER}.") from error


def check_key(key: str) -> None:
    """Raises UserError, with similar keys, for one that neither a bench nor the optimiser has."""
    head = key.partition(".")[0]
    known = (*fields_by_key(System), *_SHORTHANDS, OPTIMISER)
    if head not in known:
        raise UserError(f"--set {key}", "unknown parameter", remedy=suggest_matches(head, known))
    if head == OPTIMISER:
        name = key.partition(".")[2]
        if name not in fields_by_key(Settings):
            raise UserError(f"--set {key}", "unknown parameter", remedy=suggest_matches(name, fields_by_key(Settings)))


# --- a bench's own value ----------------------------------------------------------------------------------------------


def own_value(system: System, key: str) -> float:
    """The number that a bench has for a parameter, in SI units: of an effect that isn't active its identity.

    Raises UserError for a parameter that isn't a number which varies continuously, and for one that the bench lacks.
    """
    where = f"--set {key}"
    refusal = UserError(where, "isn't a number that varies continuously", expected="one for --tolerance")
    head, *rest = key.split(".")
    if head == "effects" and len(rest) == 2:
        known = {parameter.name: parameter for parameter in get_effect(rest[0]).parameters}
        if rest[1] not in known:
            raise UserError(where, "unknown parameter", remedy=suggest_matches(rest[1], known))
        value: Any = system.effect_values.get(rest[0], {}).get(rest[1], known[rest[1]].identity)
    else:
        value = system.modulators[0] if head in MODULATOR_KEYS else system
        if head == "elements" and rest and not rest[0].isdecimal():
            rest[0] = str(system.part(rest[0]))
        for part in (head, *rest):
            value, kind = _part_of(value, part, refusal)
            if isinstance(kind.item if isinstance(kind, Maybe) else kind, Integer):
                raise refusal
    if value is None:
        raise UserError(where, "the bench has none", expected="a value about which the tolerance is", remedy="state it")
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating):
        raise refusal
    return float(value)


def _part_of(value: Any, part: str, refusal: UserError) -> tuple[Any, Any]:
    """The value of a part of a description, and its type."""
    if isinstance(value, tuple):
        if part.isdecimal() and int(part) < len(value):
            return value[int(part)], None
        if part[:1] == "Z" and part[1:].isdecimal():
            return dict(value).get(int(part[1:]), 0.0), None
        raise refusal
    if not hasattr(value, "__dataclass_fields__"):
        raise refusal
    if part not in fields_by_key(type(value)):
        raise refusal
    field = field_for(type(value), part)
    return getattr(value, field.name), field.metadata["kind"]
