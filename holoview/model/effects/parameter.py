"""A parameter of an effect: unit, range, prior, and the value at which the effect is off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from holoview.model.field_types import Number
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches

_SI = {"pm": "m", "nm": "m", "um": "m", "mm": "m", "cm": "m", "urad": "rad", "mrad": "rad", "": "1"}


@dataclass(frozen=True)
class Parameter:
    """What may be wrong by how much, in SI units.

    name: the key in presets and results. shown: the unit that people read: "mm", "nm", "mrad", "" for a plain number,
    or a unit of its own such as "counts" or "px". low, high: inclusive bounds. prior: how large it commonly is (1 σ).
    identity: the value at which it changes nothing, not a bit. scan: (first, last, step) of a search along this
    parameter alone; None where a local fit finds it. even: images depend on its square, so that a fit must vary
    the square, which has a slope at zero. sharp: images jump as it varies (hard edges): search without slopes. fine:
    too small a matter to name a cause by, but worth calibrating; a diagnosis leaves it at its identity at first.
    """

    name: str
    doc: str
    shown: str = ""
    low: float = -np.inf
    high: float = np.inf
    prior: float = 1.0
    identity: float = 0.0
    scan: tuple[float, float, float] | None = None
    even: bool = False
    sharp: bool = False
    fine: bool = False

    @property
    def unit(self) -> str:
        """The unit of its values: m, rad, 1, or a unit of its own."""
        return _SI.get(self.shown, self.shown)

    @property
    def is_quantity(self) -> bool:
        """Whether people write it with a unit that is a length or an angle."""
        return self.shown in _SI and self.shown != ""

    def parse(self, value: Any, where: str) -> Any:
        """The value (SI) of people's text or a number; UserError when it is wrong or out of bounds."""
        if isinstance(value, str) and not self.is_quantity:
            value = self._plain(value, where)
        number = Number(self.shown if self.is_quantity else "", self.low, self.high).parse(value, where)
        assert number is not None
        if not np.isfinite(number):
            raise UserError(where, f"{number:g}", expected="a finite number")
        return number

    def to_toml(self, value: Any) -> str | float:
        """For TOML: text with its unit where it has one that `read` knows, else the number. No digit is lost."""
        return units.format_exact(value, self.shown) if self.is_quantity else float(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """For reading: "0.108 mm", "12 counts"."""
        if self.is_quantity:
            return units.format_rounded(value, self.shown, digits)
        return f"{value:.{digits}g} {self.shown}".rstrip()

    def scan_values(self) -> Iterator[float]:
        """Values to try in a search along this parameter, its identity left out."""
        if self.scan is not None:
            first, last, step = self.scan
            steps = round((last - first) / step)
            yield from (v for k in range(steps + 1) if abs((v := first + k * step) - self.identity) > step / 1e6)

    def to_fit(self, value: float) -> float:
        """The number that a fit varies: the value, or its square where images depend on that."""
        return value * value if self.even else value

    def from_fit(self, number: float) -> float:
        """The value of a number that a fit varies, inside the bounds."""
        value = max(number, 0.0) ** 0.5 if self.even else number
        return min(max(value, self.low), self.high)

    def _plain(self, text: str, where: str) -> float:
        try:
            return float(text.removesuffix(self.shown).strip() if self.shown else text)
        except ValueError as error:
            raise UserError(
                where, f'"{text}"', expected=f"a number{' of ' + self.shown if self.shown else ''}"
            ) from error


class FileParameter(Parameter):
    """The path of a file that holds what numbers can't say. In a preset it is relative to the preset's own folder."""

    def parse(self, value: Any, where: str) -> str:
        """The path."""
        if not isinstance(value, str) or not value.strip():
            raise UserError(where, f"{value!r}", expected="the path of a file")
        return value

    def to_toml(self, value: Any) -> str:
        """As it was read."""
        return str(value)

    def format(self, value: Any, digits: int = 3) -> str:
        """As it was read."""
        return str(value)


class Values(Mapping[str, float]):
    """The values of an effect's parameters; those that weren't given are at their identity."""

    def __init__(self, parameters: tuple[Parameter, ...], given: Mapping[str, Any] | None = None) -> None:
        given = given or {}
        known = {p.name for p in parameters}
        for name in given:
            if name not in known:
                raise UserError(name, "unknown parameter", remedy=suggest_matches(name, known))
        self._values = {p.name: given.get(p.name, p.identity) for p in parameters}
        self._is_identity = all(_same(self._values[p.name], p.identity) for p in parameters)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    @property
    def is_identity(self) -> bool:
        """Whether nothing is changed."""
        return self._is_identity

    @property
    def cache_key(self) -> tuple[Any, ...]:
        """Equal for equal values, hashable."""
        return tuple(self._values.values())


def _same(value: Any, identity: float) -> bool:
    return isinstance(value, int | float) and value == identity
