"""Pupil paths as tables of comma-separated values (CSV), one point a line, which spreadsheets read as well.

    time (s),y (mm),x (mm),pupil (mm),accommodation (D)
    0,0,-0.4,3,0.625
    0.5,0.1,0.4,3,0.625

The last two columns may be missing, and columns may have any order. Times rise from any value, from which they are
counted. UTF-8, with or without a byte order mark.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from pathlib import Path

from holoview.light.model.focus import COLUMNS, MAX_POINTS, PupilPath
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import write_file
from holoview.util.files import read_text

SUFFIX = ".csv"
_UNITS = {"times_s": "s", "y_m": "mm", "x_m": "mm", "pupil_m": "mm", "accommodation_dpt": "D"}
_HEADINGS = {field: f"{name} ({_UNITS[field]})" for field, name in {"times_s": "time", **COLUMNS}.items()}
_REQUIRED = ("times_s", "y_m", "x_m")
_EXPECTED = f"a table with the columns {', '.join(_HEADINGS.values())}, the last two of which may be missing"


def save_pupil_path(path: str | os.PathLike[str], pupil_path: PupilPath) -> None:
    """Writes a pupil path; reading it back gives equal numbers. Raises UserError when the file can't be written."""
    fields = [field for field in _HEADINGS if getattr(pupil_path, field) is not None]
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow([_HEADINGS[field] for field in fields])
    columns = [[_format(value, _UNITS[field]) for value in getattr(pupil_path, field)] for field in fields]
    writer.writerows(zip(*columns, strict=True))
    write_file(path, table.getvalue())


def load_pupil_path(path: str | os.PathLike[str]) -> PupilPath:
    """Reads a pupil path.

    Raises UserError, with the line, for a file that can't be read or isn't such a table, for numbers that are missing
    or out of range, and for times that don't rise.
    """
    file = Path(path)
    text = read_text(file, _EXPECTED)
    rows = [(number, row) for number, row in _rows(text, file) if any(cell.strip() for cell in row)]
    if len(rows) < 2:
        raise UserError(str(path), "holds no points", expected=_EXPECTED)
    if len(rows) - 1 > MAX_POINTS:
        raise UserError(str(path), f"{len(rows) - 1} points", expected=f"at most {MAX_POINTS}", remedy="take every nth")
    fields = _fields(rows[0][1], f"{file}:{rows[0][0]}")
    columns: dict[str, list[float]] = {field: [] for field in fields}
    for number, row in rows[1:]:
        if len(row) != len(fields):
            raise UserError(f"{file}:{number}", f"{len(row)} values", expected=f"{len(fields)}, as many as headings")
        for field, cell in zip(fields, row, strict=True):
            columns[field].append(_number(cell, _UNITS[field], f"{file}:{number}: {_HEADINGS[field]}"))
    start_s = columns["times_s"][0]
    columns["times_s"] = [time_s - start_s for time_s in columns["times_s"]]
    try:
        return PupilPath(**{field: tuple(column) for field, column in columns.items()})
    except UserError as error:
        raise error.inside(f"{file}: ") from error


def is_pupil_path(path: Path) -> bool:
    """Whether a file is called as a pupil path is."""
    return path.suffix.lower() == SUFFIX


def _rows(text: str, path: Path) -> Iterable[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(text), strict=True)
    try:
        for row in reader:
            yield reader.line_num, row
    except csv.Error as error:
        raise UserError(f"{path}:{reader.line_num}", str(error), expected=_EXPECTED) from error


def _fields(headings: list[str], where: str) -> list[str]:
    """The fields of a heading line. Raises UserError for unknown, missing and repeated ones."""
    known = {heading: field for field, heading in _HEADINGS.items()}
    fields = []
    for heading in headings:
        if heading.strip() not in known:
            raise UserError(where, f'"{heading}"', expected=_EXPECTED, remedy=suggest_matches(heading, known))
        fields.append(known[heading.strip()])
    wrong = [field for field in _REQUIRED if field not in fields]
    if wrong or len(set(fields)) != len(fields):
        found = f'no column "{_HEADINGS[wrong[0]]}"' if wrong else "a column twice"
        raise UserError(where, found, expected=_EXPECTED)
    return fields


def _number(cell: str, unit: str, where: str) -> float:
    """The SI value of a number in a unit; times are in s."""
    if unit != "s":
        try:
            return units.parse(f"{cell.strip()} {unit}", where, units.quantity_of(unit))
        except UserError as error:
            raise UserError(where, f'"{cell}"', expected=f"a number of {unit}") from error
    try:
        return float(cell)
    except ValueError as error:
        raise UserError(where, f'"{cell}"', expected="a number of seconds") from error


def _format(value: float, unit: str) -> str:
    return repr(value) if unit == "s" else units.format_exact(value, unit).rpartition(" ")[0]
