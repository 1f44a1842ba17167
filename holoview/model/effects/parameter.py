"""A parameter of an effect: unit, bounds, prior width, scan range, and the value at which the effect is off."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from holoview.model.fields import Integer, Number
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.tables import check_keys

_SI = {"pm": "m", "nm": "m", "um": "m", "mm": "m", "cm": "m", "urad": "rad", "mrad": "rad", "": "1"}


@dataclass(frozen=True)
class Parameter:
    """A number that describes by how much something is wrong. Values, bounds, prior and scan are in SI units.

    name: the key in presets and results.
    doc: a sentence that explains it.
    display_unit: the unit in which it is written and read: "mm", "nm", "mrad", "" for a plain number, or a name such as
    "counts" or "px", which isn't converted.
    low, high: inclusive bounds.
    prior: its usual size, one standard deviation.
    identity: the value at which the effect changes no bit.
    scan: (first, last, step) of a search along this parameter; None if a local fit finds it.
    even_symmetric: images depend on its square only, so that a fit varies the square: the derivative of images with
    respect to the square isn't zero at zero.
    non_smooth: images are discontinuous in it (hard edges), so that derivatives don't exist.
    secondary: it is calibrated, but no cause is named for it alone; a diagnosis holds it at its identity at first.
    """

    name: str
    doc: str
    display_unit: str = ""
    low: float = -np.inf
    high: float = np.inf
    prior: float = 1.0
    identity: float = 0.0
    scan: tuple[float, float, float] | None = None
    even_symmetric: bool = False
    non_smooth: bool = False
    secondary: bool = False

    @property
    def unit(self) -> str:
        """The unit of its values: "m", "rad", "1", or `display_unit` where that isn't converted."""
        return _SI.get(self.display_unit, self.display_unit)

    @property
    def is_quantity(self) -> bool:
        """Whether it is a length or an angle, which are written with a unit."""
        return self.display_unit in _SI and self.display_unit != ""

    def parse(self, value: Any, where: str) -> Any:
        """The SI value of text or a number. Raises UserError, with the place `where`, if wrong or out of bounds."""
        if isinstance(value, str) and not self.is_quantity:
            value = self._parse_plain(value, where)
        number = Number(self.display_unit if self.is_quantity else "", self.low, self.high).parse(value, where)
        assert number is not None
        if not np.isfinite(number):
            raise UserError(where, f"{number:g}", expected="a finite number")
        return number

    def to_toml(self, value: Any) -> str | float:
        """The value in TOML, without losing a digit: text with a unit for lengths and angles, else a number."""
        return units.format_exact(value, self.display_unit) if self.is_quantity else float(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The value as rounded text with its unit, such as "0.108 mm" or "12 counts"."""
        if self.is_quantity:
            return units.format_rounded(value, self.display_unit, digits)
        return f"{value:.{digits}g} {self.display_unit}".rstrip()

    @property
    def has_sound_bounds(self) -> bool:
        """Whether the identity lies within the bounds and the prior is positive."""
        return bool(self.low <= self.identity <= self.high and self.prior > 0)

    def nudged(self, priors: float) -> Any:
        """The value so many priors from the identity, within the bounds."""
        return min(max(self.identity + priors * self.prior, self.low), self.high)

    def added(self, known: Any, found: Any) -> Any:
        """The whole deviation of a bench: a `known` part and the part `found` in addition, within the bounds."""
        return min(max(known + found - self.identity, self.low), self.high)

    def free_entries(self, value: Any) -> tuple[Parameter, ...]:
        """The parameters that a fit varies where this one has this value: itself, or the entries of a list."""
        return (self,)

    def read(self, values: Mapping[str, Any]) -> Any:
        """Its value among those of its effect, the identity where none is given."""
        return values.get(self.name, self.identity)

    def written(self, values: Mapping[str, Any], value: Any) -> dict[str, Any]:
        """The values of its effect with this one changed."""
        return {**values, self.name: value}

    def scan_values(self) -> Iterator[float]:
        """The values of `scan` without the identity."""
        if self.scan is not None:
            first, last, step = self.scan
            steps = round((last - first) / step)
            yield from (v for k in range(steps + 1) if abs((v := first + k * step) - self.identity) > step / 1e6)

    def to_fit(self, value: float) -> float:
        """The number that a fit varies: the value, or its square if `even_symmetric`."""
        return value * value if self.even_symmetric else value

    def from_fit(self, number: float) -> float:
        """The value for the number that a fit varies, clipped to the bounds."""
        value = max(number, 0.0) ** 0.5 if self.even_symmetric else number
        return min(max(value, self.low), self.high)

    def _parse_plain(self, text: str, where: str) -> float:
        try:
            return float(text.removesuffix(self.display_unit).strip() if self.display_unit else text)
        except ValueError as error:
            raise UserError(
                where, f'"{text}"', expected=f"a number{' of ' + self.display_unit if self.display_unit else ''}"
            ) from error


class FileParameter(Parameter):
    """A parameter whose value is the path of a file. In a preset it is relative to the preset's folder."""

    def parse(self, value: Any, where: str) -> str:
        """The path, as text. Raises UserError unless it is text."""
        if not isinstance(value, str) or not value.strip():
            raise UserError(where, f"{value!r}", expected="the path of a file")
        return value

    def to_toml(self, value: Any) -> str:
        """The path unchanged."""
        return str(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """The path unchanged."""
        return str(value)


class Values(Mapping[str, float]):
    """The values of all parameters of an effect, {name: SI value}; identities where no value was given.

    Raises UserError for a name that isn't a parameter.
    """

    def __init__(self, parameters: tuple[Parameter, ...], given: Mapping[str, Any] | None = None) -> None:
        given = given or {}
        check_keys(given, {p.name for p in parameters}, noun="parameter")
        self._values = {p.name: given.get(p.name, p.identity) for p in parameters}
        self._is_identity = all(_is_identity(self._values[p.name], p.identity) for p in parameters)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def is_identity(self) -> bool:
        """Whether all values are identities, so that the effect is off."""
        return self._is_identity

    @property
    def cache_key(self) -> tuple[Any, ...]:
        """A hashable key, equal for equal values."""
        return tuple(self._values.values())


def _is_identity(value: Any, identity: Any) -> bool:
    return not isinstance(value, str) and bool(value == identity)


# --- lists of numbers -------------------------------------------------------------------------------------------------


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
