"""Who looks at the light: eyes by age and field, other people, cones or a camera from a table.

An observer is one line of text, which presets and hologram files keep:

    eye                              the 2° cone fundamentals of CIE 170-1:2006, of a person of 32 years
    age 60, field 4                  those of another age (20 to 80 years) and size of the field (1 to 10°)
    age 40, lens 10, shift-L -1.5    and another person: percent of density, nanometres of a shift
    person 17, field 10              one of 100 people who were drawn once
    cie1931, cie1964                 colour-matching functions of 2° and 10°
    mono                             a camera to which all wavelengths are equally bright
    cones NAME: 390 0.01 0.01 0.1; … cones from a table;  camera NAME: 390 0.2; …  a camera's quantum efficiency

The cones' light passes the lens and the macula, and bleaches nothing (CIE 170-1:2006, 5):

    q(λ) = [1 − 10^(−D·A(λ))]·10^(−d_lens(λ) − d_macula(λ)),   energy-based: λ·q, scaled to a peak of 1
    D = 0.38 + 0.54·exp(−f/1.333) for L and M, 0.30 + 0.45·exp(−f/1.333) for S, at a field of f degrees
    d_macula = 0.485·exp(−f/6.132)·macula(λ)
    d_lens = grows(λ)·[1 + 0.02·(age − 32)] + stays(λ) up to 60 years, grows(λ)·[1.56 + 0.0667·(age − 60)] + stays(λ)

The absorbance A follows from the 2° fundamentals, so that "age 32, field 2" is "eye". The eight further parameters are
those of Asano, Fairchild, Blondé: "Individual Colorimetric Observer Model", PLoS ONE 11(2), 2016.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import data_dir, read_text

Floats = NDArray[np.float64]

WORDS = ("eye", "cie1931", "cie1964", "mono")
"""Observers that are a single word."""
PEOPLE = 100
"""Number of people who were drawn once; `assets/observers/people.csv` has them."""

TABLES = {
    "cones": ("Stockman & Sharpe 2 Degree Cone Fundamentals", "L,M,S"),
    "cie1931": ("CIE 1931 2 Degree Standard Observer", "x,y,z"),
    "cie1964": ("CIE 1964 10 Degree Standard Observer", "x,y,z"),
}
"""The tables in `assets/observers`: the name of each in colour-science, and its columns."""

PARAMETERS: Mapping[str, tuple[float, float]] = {
    "lens": (-90.0, 200.0),
    "macula": (-100.0, 300.0),
    "L": (-90.0, 200.0),
    "M": (-90.0, 200.0),
    "S": (-90.0, 200.0),
    "shift-L": (-15.0, 15.0),
    "shift-M": (-15.0, 15.0),
    "shift-S": (-15.0, 15.0),
}
"""The eight parameters of a person and their ranges: percent of the densities of lens, macula and of the three cones,
and nanometres by which the cones' absorbances lie at longer wavelengths."""

AGE_YEARS, FIELD_DEG = (20.0, 80.0), (1.0, 10.0)
"""Ages, and sizes of the field (°), of which eyes are known."""
_STANDARD_AGE, _STANDARD_FIELD = 32.0, 2.0
_MOST_ROWS, _LEAST_ROWS, _WIDEST_STEP_NM = 1000, 5, 20.0
_NM = (200.0, 2000.0)
_TABLE_BYTES = 1 << 20
_EXPECTED = '"eye", "cie1931", "cie1964", "mono", "age 60, field 4", "person 17" or a table of cones or a camera'


def constant(values: ArrayLike) -> Floats:
    """A read-only float64 array: module constants and cached tables are shared by all callers."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


@cache
def observer_rows(name: str) -> tuple[Floats, Floats]:
    """Wavelengths (n,) in nm and values (n, columns) of a table of `assets/observers`, in steps of 1 nm."""
    rows = np.loadtxt(data_dir("assets") / "observers" / f"{name}.csv", delimiter=",")
    return constant(rows[:, 0]), constant(rows[:, 1:])


@dataclass(frozen=True)
class Observer:
    """An observer as `parse_observer` reads it.

    kind: one of `WORDS`, "person", "cones" or "camera". parameters: those of `PARAMETERS`
    that aren't 0. person: the number of one of the drawn people, 0 for others. name, rows: of a table, which has its
    wavelengths in nm in the first column.
    """

    kind: str
    age_years: float = _STANDARD_AGE
    field_deg: float = _STANDARD_FIELD
    parameters: tuple[tuple[str, float], ...] = ()
    person: int = 0
    name: str = ""
    rows: tuple[tuple[float, ...], ...] = field(default=(), repr=False)

    @property
    def text(self) -> str:
        """The line that `parse_observer` reads, the same for equal observers."""
        if self.kind in WORDS:
            return self.kind
        if self.rows:
            rows = "; ".join(" ".join(f"{number:.12g}" for number in row) for row in self.rows)
            return f"{self.kind} {self.name}: {rows}"
        if self.person:
            terms = [("person", float(self.person)), ("field", self.field_deg)]
            return ", ".join(f"{name} {value:g}" for name, value in terms if (name, value) != ("field", 2.0))
        terms = [("age", self.age_years), ("field", self.field_deg), *self.parameters]
        return ", ".join(f"{name} {value:.12g}" for name, value in terms)

    @property
    def title(self) -> str:
        """The observer in a few words."""
        return f"{self.kind} {self.name}" if self.rows else self.text


@cache
def parse_observer(text: str) -> Observer:
    """The observer of a line of text. Raises UserError for an unknown one, and for numbers out of range."""
    words = text.strip()
    if words in WORDS:
        return Observer(words)
    head, colon, rows = words.partition(":")
    kind, _, name = head.partition(" ")
    if colon and kind in ("cones", "camera"):
        return _of_rows(kind, name.strip(), [row.split() for row in rows.split(";")], "observer")
    if words.lower().endswith(".csv"):
        remedy = "name it by --observer or read it by hv.load_observer: its numbers then become part of the bench"
        raise UserError("observer", f'"{words[:60]}"', expected="a table itself here, not its file", remedy=remedy)
    known = ("age", "field", "person", *PARAMETERS)
    found: dict[str, float] = {}
    for term in words.split(","):
        name, _, number = term.strip().partition(" ")
        if name not in known or name in found:
            remedy = suggest_matches(words, WORDS) if len(words.split()) == 1 else f"known: {', '.join(known)}"
            raise UserError("observer", f'"{text[:60]}"', expected=_EXPECTED, remedy=remedy)
        found[name] = _number(name, number)
    if "person" in found:
        return _drawn_person(found)
    parameters = tuple((name, found[name]) for name in PARAMETERS if found.get(name))
    return Observer("person", found.get("age", _STANDARD_AGE), found.get("field", _STANDARD_FIELD), parameters)


_RANGES = {"age": (*AGE_YEARS, "years"), "field": (*FIELD_DEG, "degrees"), "person": (1.0, float(PEOPLE), "")}


def _number(name: str, text: str) -> float:
    unit = "nm" if name.startswith("shift") else "%"
    low, high, unit = _RANGES.get(name) or (*PARAMETERS[name], unit)
    try:
        value = float(text.strip()) if len(text) < 40 else math.nan
    except ValueError:
        value = math.nan
    if not low <= value <= high or (name == "person" and value != int(value)):
        raise UserError(f"observer, {name}", f"{text.strip()[:40]!r}", expected=f"{low:g} to {high:g} {unit}".strip())
    return value


def _drawn_person(found: Mapping[str, float]) -> Observer:
    if others := sorted(set(found) - {"person", "field"}):
        raise UserError("observer", f"person with {others[0]}", expected="person and field alone")
    number = int(found["person"])
    age, *values = observer_rows("people")[1][number - 1].tolist()
    parameters = tuple(zip(PARAMETERS, values, strict=True))
    return Observer("person", age, found.get("field", _STANDARD_FIELD), parameters, person=number)


def drawn_people(count: int = PEOPLE, field_deg: float = _STANDARD_FIELD) -> list[str]:
    """The first `count` of the people who were drawn once, as texts.

    Ages are uniform from 20 to 70 years, the eight parameters normal with the standard deviations that Asano and others
    found for 75 people: 18.7 % lens, 36.5 % macula, 9, 9 and 7.4 % cones; 2, 1.5 and 1.3 nm. Raises UserError for more
    than `PEOPLE`.
    """
    if not 1 <= count <= PEOPLE:
        raise UserError("observers", str(count), expected=f"1 to {PEOPLE}")
    return [parse_observer(f"person {number}, field {field_deg:g}").text for number in range(1, count + 1)]


# --- cones by age, field and person -----------------------------------------------------------------------------------


def cones_of(observer: Observer) -> tuple[Floats, Floats]:
    """Wavelengths (n,) in nm and responses (n, 3) to unit energy of a person's L, M and S cones; each peaks at 1."""
    nm, standard = observer_rows("cones")
    grows, stays, macula = observer_rows("filters")[1].T
    grows, stays, macula = (np.pad(column, (0, len(nm) - len(column))) for column in (grows, stays, macula))
    changes = dict(observer.parameters)
    usual = (grows + stays) + _macular_peak(_STANDARD_FIELD) * macula
    quanta = standard / nm[:, None] * 10 ** usual[:, None]
    density = _cone_densities(_STANDARD_FIELD)
    with np.errstate(divide="ignore"):  # the S cone has no published value above 615 nm
        log_absorbance = np.log10(-np.log10(1 - (1 - 10**-density) * quanta / quanta.max(axis=0)) / density)
    shifts = [changes.get(f"shift-{cone}", 0.0) for cone in "LMS"]
    columns = [_shifted(nm, column, shift) for column, shift in zip(log_absorbance.T, shifts, strict=True)]
    density = _cone_densities(observer.field_deg) * [1 + changes.get(cone, 0.0) / 100 for cone in "LMS"]
    lens = (_lens_growth(observer.age_years) * grows + stays) * (1 + changes.get("lens", 0.0) / 100)
    filters = lens + _macular_peak(observer.field_deg) * (1 + changes.get("macula", 0.0) / 100) * macula
    absorptance = 1 - 10 ** (-density * 10 ** np.stack(columns, axis=1))
    response = nm[:, None] * absorptance * 10 ** -filters[:, None]
    return nm, np.asarray(response * (standard.max(axis=0) / response.max(axis=0)))


def _shifted(nm: Floats, column: Floats, shift_nm: float) -> Floats:
    """A logarithm (n,) moved to longer wavelengths, continued by the slope of its ends; −inf stays where it begins."""
    known = np.isfinite(column)
    last = nm[known][-1]
    at, x, y = nm - shift_nm, nm[known], column[known]
    ends = [np.polyfit(x[part], y[part], 1) for part in (slice(0, 8), slice(-8, None))]
    moved = np.interp(at, x, y)
    moved = np.where(at < x[0], y[0] + ends[0][0] * (at - x[0]), moved)
    moved = np.where(at > last, y[-1] + ends[1][0] * (at - last), moved)
    return np.where(nm <= last, moved, -np.inf) if not known.all() else moved


def _cone_densities(field_deg: float) -> Floats:
    """Peak densities (3,) of the L, M and S cones' pigments."""
    narrow = math.exp(-field_deg / 1.333)
    return np.array([0.38 + 0.54 * narrow, 0.38 + 0.54 * narrow, 0.30 + 0.45 * narrow])


def _macular_peak(field_deg: float) -> float:
    return 0.485 * math.exp(-field_deg / 6.132)


def _lens_growth(age: float) -> float:
    return 1 + 0.02 * (age - 32) if age <= 60 else 1.56 + 0.0667 * (age - 60)


# --- tables of one's own ----------------------------------------------------------------------------------------------


def load_observer(path: str | os.PathLike[str]) -> str:
    """The observer of a CSV file, as text with all its numbers.

    The first column has wavelengths in nm, at most 20 nm apart. Three further columns are the responses of the L, M and
    S cones to unit energy, or, under the heading r, g, b, the quantum efficiencies of a colour camera; one further
    column is that of a monochrome camera.

    Raises UserError for other tables, gaps and units.

    >>> import holoview as hv, pathlib, tempfile
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "cmos.csv"
    >>> _ = file.write_text("nm,qe\\n" + "\\n".join(f"{nm},{0.5 - (nm - 550)**2 / 1e5}" for nm in range(400, 701, 10)))
    >>> hv.load("holochrome-8").with_(observer=hv.load_observer(file)).observer[:20]
    'camera cmos: 400 0.2'
    """
    where = str(path)
    lines = [line.strip() for line in read_text(path, "a table of an observer", _TABLE_BYTES).splitlines()]
    cells = [_cells(line) for line in lines if line and not line.startswith("#")]
    heading = cells.pop(0) if cells and not _is_number(cells[0][0]) else []
    if len(cells) > _MOST_ROWS:
        raise UserError(where, f"{len(cells)} rows", expected=f"at most {_MOST_ROWS}")
    counts = {len(row) for row in cells}
    if len(counts) != 1 or counts.pop() not in (2, 4):
        found = f"rows of {' and '.join(map(str, sorted({len(row) for row in cells}))) or 'no'} columns"
        raise UserError(where, found, expected="wavelength, L, M, S of cones; r, g, b or one response of a camera")
    is_camera = len(cells[0]) == 2 or [cell.lower()[:1] for cell in heading[1:]] == ["r", "g", "b"]
    name = "".join(c if c.isalnum() or c in "-_." else "-" for c in Path(path).stem)[:40] or "table"
    return _of_rows("camera" if is_camera else "cones", name, cells, where).text


def _cells(line: str) -> list[str]:
    """The cells of a line; where semicolons or tabs separate them, commas are decimal signs."""
    for separator in (";", "\t", ","):
        if separator in line:
            return [cell.strip().strip('"').replace(",", ".") for cell in line.split(separator)]
    return line.split()


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell == ""
    return True


def _of_rows(kind: str, name: str, cells: Sequence[Sequence[str]], where: str) -> Observer:
    """The observer of a table. Raises UserError for gaps, units and numbers that can't be responses."""
    columns = (4,) if kind == "cones" else (2, 4)
    rows = []
    for number, row in enumerate(cells, 1):
        values = [_value(cell, f"{where}, row {number}") for cell in row]
        if len(values) not in columns or len(values) != len(cells[0]):
            expected = " or ".join(map(str, columns))
            raise UserError(f"{where}, row {number}", f"{len(values)} numbers", expected=expected)
        rows.append(tuple(values))
    if not _LEAST_ROWS <= len(rows) <= _MOST_ROWS:
        raise UserError(where, f"{len(rows)} rows", expected=f"{_LEAST_ROWS} to {_MOST_ROWS}")
    rows.sort()
    table = np.array(rows)
    _check_wavelengths(table[:, 0], where)
    _check_responses(table[:, 1:], where)
    return Observer(kind, name=name, rows=tuple(rows))


def _value(cell: str, where: str) -> float:
    try:
        value = float(cell) if len(cell) < 40 else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        remedy = "fill the gap, or leave out the row where the neighbours are near enough"
        raise UserError(where, f"{cell[:40]!r}" if cell else "an empty cell", expected="a number", remedy=remedy)
    return value


def _check_wavelengths(nm: Floats, where: str) -> None:
    if nm[0] < _NM[0] or nm[-1] > _NM[1]:
        found = f"wavelengths from {nm[0]:g} to {nm[-1]:g}"
        raise UserError(where, found, expected="nanometres, such as 390 to 830", remedy="convert the first column")
    steps = np.diff(nm)
    if steps.min() <= 0:
        raise UserError(where, f"{nm[int(steps.argmin())]:g} nm twice", expected="each wavelength once")
    if steps.max() > _WIDEST_STEP_NM:
        at = int(steps.argmax())
        expected = f"rows at most {_WIDEST_STEP_NM:g} nm apart"
        raise UserError(where, f"a gap from {nm[at]:g} to {nm[at + 1]:g} nm", expected=expected, remedy="fill it")
    if math.floor(nm[-1]) - math.ceil(nm[0]) < 1:
        raise UserError(where, f"{nm[0]:g} to {nm[-1]:g} nm", expected="a range of some nanometres")


def _check_responses(values: Floats, where: str) -> None:
    if values.min() < 0:
        remedy = "of logarithms give the powers of ten; set responses below the noise to 0"
        raise UserError(where, f"a response of {values.min():g}", expected="0 or more", remedy=remedy)
    if values.max() > 1.5:
        remedy = "divide per cent by 100, and scale cones to a peak of 1"
        raise UserError(where, f"a response of {values.max():g}", expected="shares, at most 1", remedy=remedy)
    if (values.max(axis=0) <= 0).any():
        raise UserError(where, "a column of zeros", expected="a response that isn't 0 in each column")


def table_of(observer: Observer) -> tuple[Floats, Floats]:
    """Wavelengths (n,) at whole nanometres and responses (n, 1 or 3) of a table, linear between its rows.

    A camera's quantum efficiency becomes a response to unit energy: it is multiplied by the wavelength.
    """
    rows = np.array(observer.rows)
    nm = np.arange(math.ceil(rows[0, 0]), math.floor(rows[-1, 0]) + 1, dtype=np.float64)
    values = np.stack([np.interp(nm, rows[:, 0], column) for column in rows[:, 1:].T], axis=1)
    return nm, values * nm[:, None] if observer.kind == "camera" else values
