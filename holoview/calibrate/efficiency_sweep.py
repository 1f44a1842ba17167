"""A diffraction-efficiency sweep: power in the first order of a binary grating against the grey level of its bars."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError

Floats = NDArray[np.float64]

_EXPECTED = "two columns, grey level and power, separated by comma, semicolon or space"
_FEWEST = 12
_LEAST_CONTRAST = 0.2  # of the highest power, between the lowest and the highest reading


@dataclass(frozen=True)
class EfficiencySweep:
    """levels (n,): grey levels of every other bar, rising, the bars between at the first of them; power (n,)."""

    levels: Floats
    power: Floats

    @property
    def relative_levels(self) -> Floats:
        """Levels as a share of the sweep's range, 0 … 1."""
        return (self.levels - self.levels[0]) / (self.levels[-1] - self.levels[0])


def read_sweep(path: str | os.PathLike[str]) -> EfficiencySweep:
    """The sweep of a CSV file; one line of headings is allowed, rows may come in any order.

    Raises UserError that names the line when the file is missing, isn't two columns of numbers, or tells too little.
    """
    file = Path(path)
    if not file.is_file():
        raise UserError(str(file), "no such file", expected=f"a CSV file of {_EXPECTED}")
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(str(file), f"can't be read: {error}", expected=f"a text file of {_EXPECTED}") from error
    rows = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip() and line.strip()[0] != "#"]
    if rows and not any(_is_number(cell) for cell in _cells(rows[0][1])):
        rows = rows[1:]
    try:
        return _validated_sweep(
            np.array([_row(number, line) for number, line in rows], dtype=np.float64).reshape(-1, 2)
        )
    except UserError as error:
        raise error.inside(f"{file}: ") from error


def _cells(line: str) -> list[str]:
    return re.split(r"\s*[,;\t]\s*|\s+", line)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _row(number: int, line: str) -> tuple[float, float]:
    cells = _cells(line)
    if len(cells) != 2:
        raise UserError(f"line {number}", f'"{line[:40]}", {len(cells)} columns', expected=_EXPECTED)
    for cell in cells:
        if not _is_number(cell) or not math.isfinite(float(cell)):
            raise UserError(f"line {number}", f'"{cell[:40]}" isn\'t a finite number', expected=_EXPECTED)
    return float(cells[0]), float(cells[1])


def _validated_sweep(table: Floats) -> EfficiencySweep:
    if len(table) < _FEWEST:
        raise UserError("sweep", f"{len(table)} rows", expected=f"at least {_FEWEST} grey levels")
    table = table[np.argsort(table[:, 0], kind="stable")]
    levels, power = table[:, 0], table[:, 1]
    twice = np.flatnonzero(np.diff(levels) == 0)
    if len(twice):
        raise UserError("sweep", f"grey level {levels[twice[0]]:g} occurs twice", expected="each grey level once")
    if levels[0] < 0:
        raise UserError("sweep", f"grey level {levels[0]:g}", expected="levels from 0")
    if power.max() <= 0 or power.max() - power.min() < _LEAST_CONTRAST * power.max():
        found = f"power from {power.min():g} to {power.max():g}"
        remedy = "the columns are grey level, then power; the first level must leave the grating flat"
        raise UserError("sweep", found, expected="power that rises from almost none", remedy=remedy)
    return EfficiencySweep(levels, power)
