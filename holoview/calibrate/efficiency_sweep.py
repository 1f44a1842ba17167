"""Reads a diffraction-efficiency sweep of a modulator from a CSV file.

A binary grating of equal bars is shown. One half of the bars stays at the lowest grey level, the other half steps
through all grey levels; the power in the first diffraction order is measured at each step.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.files import read_text

Floats = NDArray[np.float64]

_EXPECTED = "two columns, grey level and power, separated by comma, semicolon or space"
_MIN_ROWS = 12
_MIN_CONTRAST = 0.2  # (highest − lowest power) / highest power


@dataclass(frozen=True)
class EfficiencySweep:
    """The first-order power of a grating whose bars are at two grey levels.

    levels: (n,), grey level of every other bar, strictly ascending; the bars between them are at levels[0].
    power: (n,), power in the first order, in any unit.
    """

    levels: Floats
    power: Floats

    @property
    def relative_levels(self) -> Floats:
        """The levels scaled linearly to 0 … 1, (n,)."""
        return (self.levels - self.levels[0]) / (self.levels[-1] - self.levels[0])


def read_sweep(path: str | os.PathLike[str]) -> EfficiencySweep:
    """Reads the columns grey level and power, separated by comma, semicolon, tab or space.

    The first line may hold headings, lines that begin with # are comments, and the rows may have any order.

    Raises UserError when the file is missing or a line isn't two finite numbers (it names the line), and when there are
    fewer than 12 levels, a level occurs twice, or the power hardly changes.
    """
    file = Path(path)
    lines = read_text(file, f"a CSV file of {_EXPECTED}").splitlines()
    rows = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip() and line.strip()[0] != "#"]
    if rows and not any(_is_number(cell) for cell in _split_cells(rows[0][1])):
        rows = rows[1:]
    try:
        table = np.array([_parse_row(number, line) for number, line in rows], dtype=np.float64).reshape(-1, 2)
        return _validated_sweep(table)
    except UserError as error:
        raise error.inside(f"{file}: ") from error


def _split_cells(line: str) -> list[str]:
    return re.split(r"\s*[,;\t]\s*|\s+", line)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _parse_row(number: int, line: str) -> tuple[float, float]:
    cells = _split_cells(line)
    if len(cells) != 2:
        raise UserError(f"line {number}", f'"{line[:40]}", {len(cells)} columns', expected=_EXPECTED)
    for cell in cells:
        if not _is_number(cell) or not math.isfinite(float(cell)):
            raise UserError(f"line {number}", f'"{cell[:40]}" isn\'t a finite number', expected=_EXPECTED)
    return float(cells[0]), float(cells[1])


def _validated_sweep(table: Floats) -> EfficiencySweep:
    """The sweep of a table (n, 2) of levels and powers, sorted by level. Raises UserError if it can't be one."""
    if len(table) < _MIN_ROWS:
        raise UserError("sweep", f"{len(table)} rows", expected=f"at least {_MIN_ROWS} grey levels")
    table = table[np.argsort(table[:, 0], kind="stable")]
    levels, power = table[:, 0], table[:, 1]
    repeated = np.flatnonzero(np.diff(levels) == 0)
    if len(repeated):
        raise UserError("sweep", f"grey level {levels[repeated[0]]:g} occurs twice", expected="each grey level once")
    if levels[0] < 0:
        raise UserError("sweep", f"grey level {levels[0]:g}", expected="levels from 0")
    if power.max() <= 0 or power.max() - power.min() < _MIN_CONTRAST * power.max():
        found = f"power from {power.min():g} to {power.max():g}"
        remedy = "the columns are grey level, then power; the first level must leave the grating flat"
        raise UserError("sweep", found, expected="power that rises from almost none", remedy=remedy)
    return EfficiencySweep(levels, power)
