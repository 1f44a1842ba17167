"""A parameter of an effect whose value is a list of numbers, such as the columns of a modulator that are stuck."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from holoview.model.effects.parameter import Parameter
from holoview.model.field_types import Integer, Number
from holoview.util import units
from holoview.util.errors import UserError

MAX_FREE_ENTRIES = 32
"""Longer lists keep their values in a fit, since each entry costs a prediction of every capture."""

_MAX_PLACE = 1 << 16  # rows or columns of a modulator


@dataclass(frozen=True)
class ListParameter(Parameter):
    """A list of numbers, empty where the effect does nothing; bounds, prior and unit are those of an entry.

    Presets and JSON hold a list; text such as "3, 17" or "4, 6 mm" is read too. Its value is a tuple.

    places: entries are rows or columns, counted from 0. No fit varies them, as nothing depends on them smoothly.
    fixed: no fit varies the entries, which say what those of another list are of.
    """

    identity: Any = ()
    places: bool = False
    fixed: bool = False

    @property
    def has_sound_bounds(self) -> bool:
        return self.identity == () and self.low <= self.high and self.prior > 0

    def parse(self, value: Any, where: str) -> Any:
        """The entries of a list, of text with commas or blanks, or of a single number, as a tuple in SI units."""
        if isinstance(value, str):
            texts = value.replace(",", " ").split()
            value = _with_units(texts) if self.is_quantity else [_number(text, f"{where}: {value}") for text in texts]
        entries = list(value) if isinstance(value, Iterable) else [value]
        low, high = (max(self.low, 0), min(self.high, _MAX_PLACE)) if self.places else (self.low, self.high)
        unit = self.display_unit if self.is_quantity else ""
        kind = Integer(int(low), int(high)) if self.places else Number(unit, low, high)
        found = tuple(kind.parse(_whole(entry), f"{where}[{i}]") for i, entry in enumerate(entries))
        for i, entry in enumerate(found):
            if not math.isfinite(entry or 0):
                raise UserError(f"{where}[{i}]", f"{entry:g}", expected="a finite number")
        return found

    def to_toml(self, value: Any) -> Any:
        return [units.format_exact(entry, self.display_unit) for entry in value] if self.is_quantity else list(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The entries as rounded text, with the unit behind the last one."""
        texts = [Parameter.format(self, entry, digits).removesuffix(self.display_unit).rstrip() for entry in value]
        return f"{', '.join(texts)} {self.display_unit if texts else ''}".rstrip()

    def nudged(self, priors: float) -> Any:
        """A list of one entry, which is so many priors; places are counted from 0."""
        entry = min(max(abs(priors) * self.prior, self.low), self.high)
        return (int(entry) if self.places else entry,)

    def added(self, known: Any, found: Any) -> Any:
        """The entries of both."""
        return (*known, *found)

    def free_entries(self, value: Any) -> tuple[Parameter, ...]:
        """A parameter for each number of the list; none for places and other fixed ones, and none for a long list."""
        if self.places or self.fixed or len(value) > MAX_FREE_ENTRIES:
            return ()
        own = {f.name: getattr(self, f.name) for f in dataclasses.fields(Parameter)}
        return tuple(
            ListEntry(**{**own, "name": f"{self.name}[{i}]", "identity": math.nan}, list_name=self.name, index=i)
            for i in range(len(value))
        )


@dataclass(frozen=True)
class ListEntry(Parameter):
    """One number of a list, which a fit varies. It has no identity (NaN): only the empty list does nothing."""

    list_name: str = ""
    index: int = 0

    def read(self, values: Mapping[str, Any]) -> Any:
        return values[self.list_name][self.index]

    def written(self, values: Mapping[str, Any], value: Any) -> dict[str, Any]:
        entries = list(values[self.list_name])
        entries[self.index] = value
        return {**values, self.list_name: tuple(entries)}


def _number(text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise UserError(where, f'"{text}"', expected="numbers, with commas between them") from error


def _with_units(texts: list[str]) -> list[str]:
    """The numbers of a text that was split at blanks, each with its unit: its own, or that of the last one."""
    joined: list[str] = []
    for text in texts:
        if text.isalpha() and joined:
            joined[-1] += text
        else:
            joined.append(text)
    unit = joined[-1].lstrip("+-.0123456789eE") if joined else ""
    return [text if text[-1].isalpha() else text + unit for text in joined]


def _whole(entry: Any) -> Any:
    """A whole number as one, whatever its type; anything else unchanged."""
    return int(entry) if isinstance(entry, float) and entry.is_integer() else entry
