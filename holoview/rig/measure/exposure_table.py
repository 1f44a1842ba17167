"""Reads laser powers and exposure times from the table that `holoview captures plan` writes."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from holoview.util.errors import UserError
from holoview.util.file_schema import NumberSchema
from holoview.util.files import read_text

_EXPECTED = "a table of `holoview captures plan` in CSV"
_SAME_WAVELENGTH = 1e-4  # relative: the table rounds wavelengths to six digits
_COLUMNS = (NumberSchema("wavelength_nm", 100, 10_000), NumberSchema("power", 0), NumberSchema("exposure_s", 0))


@dataclass(frozen=True)
class LaserSetting:
    """Power, relative, and exposure time (s) of the captures of one laser."""

    power: float
    exposure_s: float


def read_exposure_table(path: Path, wavelengths_m: Sequence[float]) -> Mapping[float, LaserSetting]:
    """The settings by wavelength, which is one of `wavelengths_m`.

    Raises UserError, with line and column, for what is missing or isn't a number, and for a laser that isn't there.
    """
    lines = list(csv.DictReader(io.StringIO(read_text(path, _EXPECTED), newline=""), skipinitialspace=True))
    if not lines:
        raise UserError(str(path), "is empty", expected=_EXPECTED)
    settings: dict[float, LaserSetting] = {}
    for number, line in enumerate(lines, start=2):
        where = f"{path}, line {number}"
        nm, power, exposure_s = (_cell(line, schema, where) for schema in _COLUMNS)
        near = [λ for λ in wavelengths_m if abs(λ * 1e9 / nm - 1) < _SAME_WAVELENGTH]
        if not near:
            known = ", ".join(f"{λ * 1e9:g} nm" for λ in wavelengths_m)
            raise UserError(f"{where}: wavelength_nm", f"{nm:g}", expected=f"one of {known}")
        if near[0] in settings:
            raise UserError(f"{where}: wavelength_nm", f"{nm:g} again", expected="each wavelength once")
        settings[near[0]] = LaserSetting(power, exposure_s)
    return settings


def _cell(line: Mapping[str, str | None], schema: NumberSchema, where: str) -> float:
    text = line.get(schema.name)
    if not text:
        raise UserError(f"{where}: {schema.name}", "is missing", expected=_EXPECTED)
    try:
        return schema.read(float(text), f"{where}: {schema.name}")
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {schema.name}", f'"{text}"', expected="a number") from error
