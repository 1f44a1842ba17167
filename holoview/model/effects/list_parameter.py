"""A parameter of an effect whose value is a list of numbers, such as the columns of a modulator that are stuck."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from holoview.model.effects.parameter import Parameter
from holoview.model.field_types import Integer, Number
from holoview.util.errors import UserError

MAX_FREE_ENTRIES = 32
"""Longer lists keep their values in a fit, since each entry costs a prediction of every capture."""

_MAX_PLACE = 1 << 16  # rows or columns of a modulator


@dataclass(frozen=True)
class ListParameter(Parameter):
    """A list of numbers, empty where the effect does nothing; bounds, prior and unit are those of an entry.

    Presets and JSON hold a list; text such as "3, 17" is read too. Its value is a tuple.

    places: entries are rows or columns, counted from 0. No fit varies them, as nothing depends on them smoothly.
    """

    identity: Any = ()
    places: bool = False

    @property
    def has_sound_bounds(self) -> bool:
        return self.identity == () and self.low <= self.high and self.prior > 0

    def parse(self, value: Any, where: str) -> Any:
        """The entries of a list, of text with commas or blanks, or of a single number, as a tuple in SI units."""
        if isinstance(value, str):
            value = [_number(text, f"{where}: {value}") for text in value.replace(",", " ").split()]
        entries = list(value) if isinstance(value, Iterable) else [value]
        low, high = (max(self.low, 0), min(self.high, _MAX_PLACE)) if self.places else (self.low, self.high)
        kind = Integer(int(low), int(high)) if self.places else Number("", low, high)
        found = tuple(kind.parse(_whole(entry), f"{where}[{i}]") for i, entry in enumerate(entries))
        for i, entry in enumerate(found):
            if not math.isfinite(entry or 0):
                raise UserError(f"{where}[{i}]", f"{entry:g}", expected="a finite number")
        return found

    def to_toml(self, value: Any) -> Any:
        return list(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The entries as rounded text, with the unit behind the last one."""
        return f"{', '.join(f'{entry:.{digits}g}' for entry in value)} {self.shown}".rstrip()

    def nudged(self, priors: float) -> Any:
        """A list of one entry, which is so many priors; places are counted from 0."""
        entry = min(max(abs(priors) * self.prior, self.low), self.high)
        return (int(entry) if self.places else entry,)

    def added(self, known: Any, found: Any) -> Any:
        """The entries of both."""
        return (*known, *found)

    def free_entries(self, value: Any) -> tuple[Parameter, ...]:
        """A parameter for each number of the list; none for places, and none for a long list."""
        if self.places or len(value) > MAX_FREE_ENTRIES:
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


def _whole(entry: Any) -> Any:
    """A whole number as one, whatever its type; anything else unchanged."""
    return int(entry) if isinstance(entry, float) and entry.is_integer() else entry
