"""Wavelengths or distances that are recorded for the wrong captures, or in the wrong unit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from holoview.captures.dataset import Captures, Floats
from holoview.captures.records.correction import Correction, apply_corrections
from holoview.captures.validation import check_captures, check_lengths
from holoview.util.errors import UserError

Column = Literal["wavelength", "distance"]
_FIELDS: dict[Column, str] = {"wavelength": "wavelength_m", "distance": "distance_m"}
_SHOWN: dict[Column, tuple[float, str]] = {"wavelength": (1e9, "nm"), "distance": (1e3, "mm")}
_UNITS: dict[Column, tuple[tuple[float, str, str], ...]] = {
    "wavelength": ((1e3, "nm", "µm"), (1e-3, "µm", "nm"), (1e9, "nm", "m"), (1e6, "µm", "m")),
    "distance": ((1e3, "mm", "m"), (1e-3, "m", "mm"), (1e6, "µm", "m")),
}
"""(recorded over true value, the unit meant, the unit taken) of common mistakes."""


def column_values(captures: Captures, column: Column) -> Floats:
    """The distinct values of a column (m) in ascending order."""
    return np.unique(getattr(captures, _FIELDS[column]))


def _replaced(captures: Captures, column: Column, values: Floats) -> Captures:
    return dataclasses.replace(captures, **{_FIELDS[column]: values})  # type: ignore[arg-type]


@dataclass(frozen=True)
class ColumnCorrection(Correction):
    """A correction of one column of the records."""

    column: Column

    @property
    def effect(self) -> str:
        return f"{self.column}_order"


@dataclass(frozen=True)
class ValueOrder(ColumnCorrection):
    """The values of a column are mixed up: where the i-th smallest is recorded, the true one is the p[i]-th smallest.

    permutation: p, counted from 0. values: the distinct values (m), ascending; others stay.
    """

    permutation: tuple[int, ...]
    values: tuple[float, ...]

    @property
    def choice(self) -> str:
        if self.permutation == tuple(reversed(range(len(self.permutation)))):
            return "reversed"
        return f"permutation:{','.join(map(str, self.permutation))}"

    @property
    def sentence(self) -> str:
        scale, unit = _SHOWN[self.column]
        moved = [
            f"{self.values[i] * scale:.6g} {unit} stands for {self.values[p] * scale:.6g} {unit}"
            for i, p in enumerate(self.permutation)
            if i != p
        ]
        return f"The {self.column}s are mixed up in the records: {', '.join(moved)}."

    def apply(self, captures: Captures) -> Captures:
        values, recorded = np.array(self.values), getattr(captures, _FIELDS[self.column])
        index = np.abs(recorded[:, None] - values[None]).argmin(axis=1)
        moved = values[np.array(self.permutation)[index]]
        return _replaced(captures, self.column, np.where(recorded == values[index], moved, recorded))


@dataclass(frozen=True)
class ColumnReversal(ColumnCorrection):
    """The column stands in the file from the last capture to the first."""

    choice = "reversed"

    @property
    def sentence(self) -> str:
        return f"The {self.column}s are recorded from the last capture to the first."

    def apply(self, captures: Captures) -> Captures:
        return _replaced(captures, self.column, getattr(captures, _FIELDS[self.column])[::-1].copy())


@dataclass(frozen=True)
class WrongUnit(ColumnCorrection):
    """The numbers of a column were meant in one unit and taken in another.

    factor: recorded value over true value.
    """

    factor: float
    meant: str
    taken: str

    @property
    def choice(self) -> str:
        return f"unit:{self.meant} taken as {self.taken}"

    @property
    def sentence(self) -> str:
        return f"The {self.column}s are recorded in a wrong unit: numbers in {self.meant} were taken as {self.taken}."

    def apply(self, captures: Captures) -> Captures:
        return _replaced(captures, self.column, getattr(captures, _FIELDS[self.column]) / self.factor)


def unit_candidates(captures: Captures, column: Column) -> list[WrongUnit]:
    """Common mistakes with the unit of a column after which lengths are plausible."""
    found = [WrongUnit(column, *each) for each in _UNITS[column]]
    return [unit for unit in found if _has_plausible_lengths(unit.apply(captures))]


def plausible_units(captures: Captures) -> tuple[WrongUnit, ...]:
    """The units that must be corrected before the session is plausible; usually none.

    Raises UserError for a session that is impossible for another reason (`check_captures`).
    """
    units = units_of_lengths(captures)
    check_captures(apply_corrections(captures, units))
    return units


def units_of_lengths(captures: Captures) -> tuple[WrongUnit, ...]:
    """The same, where lengths alone are checked. Raises UserError for lengths that no unit makes plausible."""
    units: tuple[WrongUnit, ...] = ()
    if not _has_plausible_lengths(captures):
        of_columns = [[None, *(WrongUnit(column, *each) for each in _UNITS[column])] for column in _UNITS]
        for pair in sorted(product(*of_columns), key=lambda pair: sum(unit is not None for unit in pair)):
            chosen = tuple(unit for unit in pair if unit is not None)
            if _has_plausible_lengths(apply_corrections(captures, chosen)):
                units = chosen
                break
    check_lengths(apply_corrections(captures, units))
    return units


def _has_plausible_lengths(captures: Captures) -> bool:
    try:
        check_lengths(captures)
    except UserError:
        return False
    return True


def cyclic_orders(captures: Captures, column: Column) -> list[ValueOrder]:
    """The cyclic permutations of a column's values, the identity first: together they pair every value with every."""
    values = tuple(column_values(captures, column).tolist())
    n = len(values)
    return [ValueOrder(column, tuple((i + step) % n for i in range(n)), values) for step in range(n)]


def exchanges(captures: Captures, column: Column, indices: Sequence[int]) -> list[Correction]:
    """The exchanges of the values that these captures have with each other value."""
    values = column_values(captures, column)
    own = set(value_indices(captures, column, indices))
    pairs = {(min(i, j), max(i, j)) for i in own for j in range(len(values)) if i != j}
    found: list[Correction] = []
    for i, j in sorted(pairs):
        order = list(range(len(values)))
        order[i], order[j] = j, i
        found.append(ValueOrder(column, tuple(order), tuple(values.tolist())))
    return found


def value_indices(captures: Captures, column: Column, indices: Sequence[int]) -> list[int]:
    """Which of the column's distinct values each of these captures has."""
    values = column_values(captures, column)
    return [int(np.searchsorted(values, getattr(captures, _FIELDS[column])[k])) for k in indices]
