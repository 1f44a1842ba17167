"""Sweeps of a modulator's grey level, from text files and arrays, checked and with their noise.

read_sweep, parse_sweep        of a file, of a text
read_sweeps, format_readings   of a table of several: periods, wavelengths, orders

The table of several sweeps has the headings level and power, and any of period (pixels), wavelength_nm, order (1, -1, 0
or interferometer) and deviation; rows that agree in the first three are a sweep.

Half of the modulator's pixels (the other bars of a binary grating, or half of an interferometer's field) stays at the
reference level while the level of the others steps through its range; at each step the power of one spot is read.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.files import opened_file, read_text
from holoview.util.number_text import find_layout, read_csv
from holoview.util.plain_arrays import read_npy_arrays
from holoview.util.units import format_rounded

Floats = NDArray[np.float64]
Order = Literal["1", "0", "interferometer"]
ORDERS: tuple[Order, ...] = get_args(Order)

_EXPECTED = (
    "two columns, grey level and power, separated by comma, semicolon or space; a third may hold standard errors"
)
MIN_ROWS = 12
_MOST_NUMBERS = 3 << 16  # three columns of 16 bits' levels
_SMALLEST = 1e-100  # power whose square is a number; its reciprocal the largest
_MIN_SIGNAL = 8.0  # range of the power over its noise; of 256 readings of white noise alone the range is 6 (sd 0.5)
_SHORTEST_PLATEAU, _STEEP = 4, 6.0  # equal readings; fall two beyond them, in steps of rounding
_SHORTEST_CUT = 3  # equal readings in a row at the end of a sweep that can't be measured ones


@dataclass(frozen=True, eq=False)
class Sweep:
    """The power of a spot while a grey level is varied.

    levels: (n,), strictly ascending. power: (n,), in any unit; negative where it is a difference of two powers.
    starts_high: whether the reference level, which the other pixels keep, is levels[-1] instead of levels[0].
    deviation: (n,), standard errors of the power; None where they aren't known.
    name: of the file. notes: what was assumed and left out, for people.

    >>> import numpy as np
    >>> Sweep(np.arange(3.0), np.ones(3)).distance.tolist()
    [0.0, 0.5, 1.0]
    """

    levels: Floats
    power: Floats
    starts_high: bool = False
    deviation: Floats | None = None
    name: str = "sweep"
    notes: tuple[str, ...] = ()

    @property
    def distance(self) -> Floats:
        """Distance of each level from the reference level as a share of the range, (n,)."""
        share = (self.levels - self.levels[0]) / (self.levels[-1] - self.levels[0])
        return share[-1] - share if self.starts_high else share

    @property
    def range(self) -> float:
        """Highest minus lowest power."""
        return float(np.ptp(self.power))

    @property
    def noise(self) -> float:
        """Standard deviation of a reading: third differences of the power, √20 times as large, contain little else."""
        return float(np.median(np.abs(np.diff(self.power, n=3)))) / (0.6745 * math.sqrt(20))


@dataclass(frozen=True, eq=False)
class LabelledSweep:
    """A sweep and how it was measured, as far as its file tells.

    period_px: of the grating. wavelength_m: of the laser. order: of the spot. Each None where it isn't known.
    """

    sweep: Sweep
    period_px: float | None = None
    wavelength_m: float | None = None
    order: Order | None = None

    @property
    def label(self) -> str:
        """What is known, for people."""
        told = [
            "" if self.wavelength_m is None else format_rounded(self.wavelength_m, "nm"),
            "" if self.period_px is None else f"period {self.period_px:g}",
            "" if self.order is None else f"order {self.order}" if self.order in "10" else self.order,
        ]
        return ", ".join(text for text in told if text) or self.sweep.name


def read_sweep(path: str | os.PathLike[str]) -> Sweep:
    """Reads the columns grey level and power, and perhaps standard errors, separated by comma, semicolon, tab or space.

    The first line may hold headings, and lines that begin with # are comments. A single column holds powers, of levels
    that are counted from 0. Rows may have any order; where levels fall from row to row, the reference level is the
    highest one. Readings at the end that are all equal, after a jump, are left out: there the sweep was cut off.
    A .npy file holds the same numbers: (n,) powers, or columns (n, 2 or 3), or these as rows.

    Raises UserError when the file is missing or a line isn't two or three finite numbers (it names the line), and when
    there are fewer than 12 levels, a level occurs twice, or the power changes by less than 8 times its noise.
    """
    file = Path(path)
    try:
        if file.suffix.lower() == ".npy":
            return _sweep_of_table(_read_array(file), file.name)
        return parse_sweep(_read_text(file), file.name)
    except UserError as error:
        raise error if str(error).startswith(str(file)) else error.inside(f"{file}: ") from error


def _read_text(file: Path) -> str:
    expected = f"a CSV file of {_EXPECTED}"
    if file.is_file():
        with file.open("rb") as opened:
            if opened.read(9) == b"SIMPLE  =":
                remedy = "write level and power as text; astropy does: Table.read(FILE)['LEVEL', 'POWER'].write(CSV)"
                raise UserError(str(file), "a FITS file", expected=expected, remedy=remedy)
    return read_text(file, expected)


def _read_array(file: Path) -> Floats:
    """The numbers of a .npy file as a table (row, column)."""
    with opened_file(file, f"an array of {_EXPECTED}") as opened:
        arrays = read_npy_arrays(file, opened)
    if len(arrays) != 1:
        raise UserError("array", f"{len(arrays)} arrays", expected=f"one: {_EXPECTED}")
    found = arrays[0]
    if found.size > _MOST_NUMBERS or found.dtype.kind == "c" or found.ndim not in (1, 2):
        raise UserError("array", f"shape {found.shape} of {found.dtype}", expected=_EXPECTED)
    values = found.astype(np.float64)
    table = values[:, None] if values.ndim == 1 else values.T if len(values) <= 3 else values
    if not 1 <= table.shape[1] <= 3:
        raise UserError("array", f"shape {found.shape}", expected=_EXPECTED)
    if not np.isfinite(table).all():
        row = int(np.argmax(~np.isfinite(table).all(axis=1)))
        raise UserError(f"row {row}", "isn't finite", expected=_EXPECTED)
    return table


def parse_sweep(text: str, name: str = "sweep") -> Sweep:
    """`read_sweep` of a text."""
    return _sweep_of_table(parse_columns(text, 3, _EXPECTED, "sweep"), name)


def _sweep_of_table(table: Floats, name: str) -> Sweep:
    """The sweep of a table (row, 1 to 3 columns)."""
    notes: list[str] = []
    if len(table) < MIN_ROWS:
        raise UserError("sweep", f"{len(table)} rows", expected=f"at least {MIN_ROWS} grey levels")
    if table.shape[1] == 1:
        notes.append("one column: taken as powers of the levels 0, 1, 2, …")
        table = np.column_stack([np.arange(float(len(table))), table])
    return _checked(table, name, notes)


_HEADINGS = {
    "level": ("level", "grey", "gray", "drive"),
    "power": ("power", "intensity", "counts", "reading", "readings"),
    "deviation": ("deviation", "error", "sigma", "std"),
    "period": ("period",),
    "wavelength": ("wavelength",),
    "order": ("order",),
}
_LABELS = ("period", "wavelength", "order")
_EXPECTED_TABLE = "the headings level and power beside period, wavelength_nm or order"


def read_sweeps(path: str | os.PathLike[str]) -> list[LabelledSweep]:
    """The sweeps of a file: of a table of several, or the one of `read_sweep`, whose errors it raises, too."""
    file = Path(path)
    if file.suffix.lower() == ".npy":
        return [LabelledSweep(read_sweep(file))]
    text = _read_text(file)
    try:
        return parse_sweeps(text, file.name)
    except UserError as error:
        raise error if str(error).startswith(str(file)) else error.inside(f"{file}: ") from error


def parse_sweeps(text: str, name: str = "sweep") -> list[LabelledSweep]:
    """`read_sweeps` of a text."""
    lines = [line for line in text.lstrip("\ufeff").splitlines() if line.strip() and not line.lstrip().startswith("#")]
    columns = _columns(lines[0]) if lines else {}
    if not any(label in columns for label in _LABELS):
        return [LabelledSweep(parse_sweep(text, name))]
    if not {"level", "power"} <= set(columns):
        raise UserError("table of sweeps", f'"{lines[0][:60]}"', expected=_EXPECTED_TABLE)
    if "wavelength" in columns and "nm" not in columns["wavelength"].lower():
        raise UserError("table of sweeps", f'"{columns["wavelength"]}"', expected="a heading that names nm")
    rows, has_decimal_commas = read_csv("\n".join(lines), "table of sweeps")
    groups: dict[tuple[str, ...], list[list[float]]] = {}
    for row in rows:
        cells = {key: (row[heading] or "").strip() for key, heading in columns.items()}
        if has_decimal_commas:
            cells = {key: cell.replace(",", ".") for key, cell in cells.items()}
        numbers = [_finite(cells[key], key) for key in ("level", "power", "deviation") if key in cells]
        groups.setdefault(tuple(cells.get(label, "") for label in _LABELS), []).append(numbers)
    return [_labelled(name, labels, np.array(table)) for labels, table in groups.items()]


def _columns(line: str) -> dict[str, str]:
    """The headings of a line by what they mean."""
    headings = [cell.strip() for cell in line.split(";" if ";" in line else ",")]
    words = {heading: re.split(r"[^a-z]+", heading.lower()) for heading in headings}
    return {
        key: found
        for key, names in _HEADINGS.items()
        if (found := next((heading for heading in headings if set(words[heading]) & set(names)), None)) is not None
    }


def _labelled(name: str, labels: tuple[str, ...], table: Floats) -> LabelledSweep:
    period_text, wavelength_text, order_text = labels
    period = _finite(period_text, "period") if period_text else None
    wavelength_m = _finite(wavelength_text, "wavelength") * 1e-9 if wavelength_text else None
    order = next((own for own in ORDERS if own == order_text.lstrip("+-")), None)
    if order_text and order is None:
        raise UserError("order", f'"{order_text[:40]}"', expected=f"1, -1, {', '.join(ORDERS[1:])}")
    label = ", ".join(text for text in labels if text)
    try:
        sweep = _checked(table, name, [])
    except UserError as error:
        raise error.inside(f"{label}: ") from error
    found = LabelledSweep(sweep, period, wavelength_m, order)
    return dataclasses.replace(found, sweep=dataclasses.replace(sweep, name=found.label))


def _finite(cell: str, key: str) -> float:
    if not _is_number(cell) or not math.isfinite(float(cell)):
        raise UserError(key, f'"{cell[:40]}" isn\'t a finite number')
    return float(cell)


def format_readings(rows: Sequence[tuple[float, float, str, float, float]]) -> str:
    """The table of several sweeps that `read_sweeps` reads. rows: wavelength (m), period (pixels), order, level, power.

    >>> print(format_readings([(532e-9, 8, "1", 0, 0.5)]), end="")
    wavelength_nm,period_px,order,level,power
    532,8,1,0,0.5
    """
    lines = [f"{λ * 1e9:.9g},{period:g},{order},{level:g},{power:.7g}" for λ, period, order, level, power in rows]
    return "\n".join(["wavelength_nm,period_px,order,level,power", *lines, ""])


def parse_columns(text: str, most: int, expected: str, where: str) -> Floats:
    """The numbers (row, column) of a text of 1 to `most` columns, separated by comma, semicolon, tab or space.

    Beside others a comma is a decimal point (`holoview.util.number_text`). The first line may hold headings, and lines
    that begin with # are comments. Raises UserError, which names the line, for anything else.
    """
    lines = [(number, line.strip()) for number, line in enumerate(text.lstrip("\ufeff").splitlines(), 1)]
    lines = [(number, line) for number, line in lines if line and line[0] != "#"]
    if lines and not any(_is_number(cell) for cell in re.split(r"[,;\t ]+", lines[0][1])):
        lines = lines[1:]
    layout = find_layout([line for _, line in lines], where)
    rows: list[list[float]] = []
    for number, line in lines:
        cells = [cell for cell in layout.words(line) if cell]
        if not 1 <= len(cells) <= most:
            raise UserError(f"line {number}", f'"{line[:40]}", {len(cells)} columns', expected=expected)
        for cell in cells:
            if not _is_number(cell) or not math.isfinite(float(cell)):
                raise UserError(f"line {number}", f'"{cell[:40]}" isn\'t a finite number', expected=expected)
        if rows and len(cells) != len(rows[0]):
            found = f'"{line[:40]}", {len(cells)} columns after rows of {len(rows[0])}'
            raise UserError(f"line {number}", found, expected=expected)
        rows.append([float(cell) for cell in cells])
    if not rows:
        raise UserError(where, "no numbers", expected=expected)
    return np.array(rows, dtype=np.float64)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def sweep_of_readings(levels: Floats, power: Floats, name: str) -> Sweep:
    """A sweep from arrays (n,), checked as those of files are."""
    return _checked(np.column_stack([levels, power]), name, [])


def _checked(table: Floats, name: str, notes: list[str]) -> Sweep:
    """The sweep of a table (n, 2 or 3) in the order of its file. Raises UserError if it can't be one."""
    starts_high = bool((np.diff(table[:, 0]) < 0).all())
    if starts_high:
        notes.append(f"levels count down: level {table[0, 0]:g} of the first row is taken as the reference")
    _check_saturation(table)
    cut = _cut_off(table[:, 1])
    if cut:
        first, last = sorted((table[-cut, 0], table[-1, 0]))
        notes.append(f"levels {first:g} to {last:g} all read {table[-1, 1]:g} after a jump: the sweep is cut off there")
        table = table[:-cut]
    if len(table) < MIN_ROWS:
        raise UserError("sweep", f"{len(table)} rows", expected=f"at least {MIN_ROWS} grey levels")
    table = table[np.argsort(table[:, 0], kind="stable")]
    levels, power = table[:, 0], table[:, 1]
    repeated = np.flatnonzero(np.diff(levels) == 0)
    if len(repeated):
        raise UserError("sweep", f"grey level {levels[repeated[0]]:g} occurs twice", expected="each grey level once")
    if levels[0] < 0:
        raise UserError("sweep", f"grey level {levels[0]:g}", expected="levels from 0")
    deviation = table[:, 2] if table.shape[1] == 3 else None
    if deviation is not None and not (deviation > 0).all():
        raise UserError("sweep", "a standard error of 0 or less in the third column", expected="positive numbers")
    sweep = Sweep(levels, power, starts_high, deviation, name, tuple(notes))
    if not _SMALLEST < np.abs(power).max() < 1 / _SMALLEST:
        raise UserError("sweep", f"powers up to {np.abs(power).max():g}", expected="powers in another unit")
    if sweep.range <= _MIN_SIGNAL * sweep.noise or sweep.range <= 1e-9 * np.abs(power).max():
        found = f"power from {power.min():g} to {power.max():g}, with noise of {sweep.noise:.2g} a reading"
        expected = (
            "power that rises from almost none (first order), falls from its greatest (zero order), or oscillates"
        )
        raise UserError("sweep", found, expected=expected, remedy="the columns are grey level, then power")
    return sweep


def _check_saturation(table: Floats) -> None:
    """Raises UserError where the greatest power is a plateau with steep ends, as of a detector that is saturated.

    A smooth maximum that is rounded to steps q has a plateau of 2·w readings, w ≥ 2, and is at most 4·q lower two
    readings beyond its ends.
    """
    power = table[np.argsort(table[:, 0], kind="stable"), 1]
    highest = power == power.max()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], highest.astype(int), [0]])))
    begin, end = max(edges.reshape(-1, 2), key=lambda run: int(run[1] - run[0]))
    if end - begin < _SHORTEST_PLATEAU:
        return
    quantum = float(np.diff(np.unique(power)).min(initial=np.inf))
    beyond = [power[k] for k in (begin - 3, end + 2) if 0 <= k < len(power)]
    drops = [float(power.max() - value) for value in beyond]
    if drops and min(drops) > _STEEP * quantum and len(np.unique(power)) > _SHORTEST_PLATEAU:
        found = f"{end - begin} readings in a row are all {power.max():g}, the greatest, with steep ends"
        raise UserError("sweep", found, expected="a detector that isn't saturated", remedy="measure with less light")


def _cut_off(power: Floats) -> int:
    """The number of equal readings at the end that follow a jump larger than any between the others; 0 without."""
    same = 1 + int(np.argmax(np.append(power[::-1] != power[-1], True)[1:]))
    if same < _SHORTEST_CUT or same >= len(power) - 1:
        return 0
    steps = np.abs(np.diff(power[: len(power) - same]))
    jump = abs(power[-same] - power[-same - 1])
    return same if jump > 2 * steps.max() else 0
