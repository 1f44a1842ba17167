"""A fitted look-up table in files, in a bench and for people; tables of modulators' vendors.

lut_table, save_lut, with_lut      the table as keys and values, as TOML, and in a bench
format_lut, plot_lut               the table for people
read_vendor_table, compare_vendor  the table that a vendor supplies, and how far it is from the fitted one
vendor_table                       the fitted table in a vendor's layout
levels_of_phases, verify_turn      the levels of a sweep through the table, and what it says

A vendor's table says which drive the electronics of a modulator give to a pixel for each grey level, so that the phase
rises in proportion to the level by one turn. Layouts that are read: two columns, grey level and drive, separated by
spaces (Meadowlark's `.lut` and `.txt`: 256 or more lines, drives of 12 bits for 0 to 5 V, as the public programs
marijnleonardus/MScProject, calibration/look_up_table.py, and FanchLeroux/phd_bioedge, manip/LUT_calibration, read), by
comma or semicolon; or drives alone, one a line. The bits of the drive follow from the largest: 8, 10, 12 or 16. Of
HOLOEYE's, Santec's and Hamamatsu's tables we know no public description; a Hamamatsu LCOS has none, but one level that
is 2π. Texas Instruments states 16 displacements, no drives.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from holoview.bench.calibrate.lut_fit import ORDER_NAMES, UNSEEN_SLOPE, FittedLut, SweepFit
from holoview.bench.calibrate.sweep import Floats, parse_columns
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import label, png_figure
from holoview.util.file_writer import write_file
from holoview.util.files import read_text

FORMAT, VERSION = "holoview-lut", 1

_TABLE_SIZE = 256  # numbers of `phase_pi`
_WIDEST_GAP = 2.0  # levels before the first and behind the last that take their phases
_DRIVE_BITS = (8, 10, 12, 16)
_FAR_BETTER = 0.4  # of the deviation with other bits, with which a table's bits are doubted


def lut_table(
    lut: FittedLut,
    source: str,
    wavelengths_m: Sequence[float] = (),
    periods: Sequence[float] = (),
) -> dict[str, Any]:
    """The look-up table as keys and values for TOML or JSON.

    source: name of the file with the first sweep. wavelengths_m: of each sweep, one for all, or none; with it the table
    states strokes as lengths. periods: of the gratings, pixels; for each sweep, one for all, or none.

    `levels` and `stroke` have the form of a preset's `[[modulators]]`. A number that isn't known is None.
    """
    low, high = lut.stroke_interval
    first = lut.fits[0]
    table: dict[str, Any] = {"format": FORMAT, "version": VERSION, "source": source}
    table["model"] = "power = b + a (1 + c phase) sin((phase - start) / 2)^2, phase monotone in the level"
    table["order"], table["order_reason"] = lut.order, lut.reason
    table["fits"] = lut.explains
    table["stroke_pi"] = lut.stroke / math.pi
    table["stroke_interval_pi"] = table["stroke_pi_interval"] = [low / math.pi, high / math.pi]
    if wavelengths_m:
        per_radian = wavelengths_m[0] / (2 * math.pi)
        table["wavelength"] = units.format_exact(wavelengths_m[0], "nm")
        table["stroke"] = units.format_rounded(lut.stroke_m(wavelengths_m[0]), "nm", 6)
        table["stroke_interval"] = [units.format_rounded(bound * per_radian, "nm", 6) for bound in (low, high)]
    table["contrast_slope"] = first.slope * lut.stroke
    table["residual"] = {
        "monotone": lut.residual,
        "linear_free_stroke": lut.linear_free,
        "linear_2pi": lut.linear_2pi,
    }
    if lut.unseen_shift is not None:
        table["unseen_shift_pi"] = lut.unseen_shift / math.pi
    table["turn_level"] = turn_level(lut)
    turn = turn_deviation(lut)
    if turn is not None:
        table["deviation_from_turn_pi"] = {"rms": turn[0] / math.pi, "greatest": turn[1] / math.pi, "level": turn[2]}
    table["sweeps"] = [_sweep_keys(fit, k, wavelengths_m, periods) for k, fit in enumerate(lut.fits)]
    table["sent"] = lut.levels.tolist()
    table["levels"] = lut.stroke_fractions.tolist()
    levels = _table_levels(lut)
    phases = _clamped(lut, levels) / math.pi
    table["phase_levels"] = levels.tolist()
    table["phase_pi"] = [float(phase) if math.isfinite(phase) else None for phase in phases]
    return table


def _sweep_keys(fit: SweepFit, index: int, wavelengths_m: Sequence[float], periods: Sequence[float]) -> dict[str, Any]:
    """What a table says of the sweep of this number."""
    return {
        "file": fit.sweep.name,
        **({"wavelength": units.format_exact(_of(wavelengths_m, index), "nm")} if wavelengths_m else {}),
        **({"period": _of(periods, index)} if periods else {}),
        "residual": fit.residual,
        "full_power": fit.full_power,
        "stray": fit.stray,
        "slope_per_radian": fit.slope,
        "drift": fit.drift,
        "start_pi": fit.start / math.pi,
        "phase_factor": fit.factor,
        "notes": list(fit.sweep.notes),
    }


def _of(values: Sequence[float], index: int) -> float:
    return values[index] if len(values) > 1 else values[0]


def _table_levels(lut: FittedLut) -> Floats:
    """256 levels: 0 … 255 if the sweep's are levels of 8 bits, else equidistant over the sweep."""
    levels = lut.levels
    if (levels == np.round(levels)).all() and 64 < levels[-1] <= 255:
        return np.arange(float(_TABLE_SIZE))
    return np.linspace(levels[0], levels[-1], _TABLE_SIZE)


def _clamped(lut: FittedLut, levels: Floats) -> Floats:
    """Phases of levels, rad; NaN where a sweep that was cut off doesn't reach."""
    near = np.clip(levels, lut.levels[0], lut.levels[-1])
    return np.where(np.abs(near - levels) <= _WIDEST_GAP, lut.phase_at(near), math.nan)


def turn_level(lut: FittedLut) -> float | None:
    """The level of a phase of 2π, which makers of linear modulators state for each wavelength; None below a turn."""
    if lut.stroke < 2 * math.pi:
        return None
    return float(np.interp(2 * math.pi, lut.stroke_fractions * lut.stroke, lut.levels))


def levels_of_phases(lut: FittedLut, phases: Floats) -> NDArray[np.int64]:
    """The levels (n,) whose phases are nearest to these, rad above that of the first level."""
    rising = lut.stroke_fractions * lut.stroke
    levels = np.arange(round(lut.levels[0]), round(lut.levels[-1]) + 1)
    found = np.interp(levels, lut.levels, rising)
    return levels[np.abs(found[:, None] - phases).argmin(axis=0)]


@dataclass(frozen=True)
class Verification:
    """How far the phase through a table is from the straight line that was asked for.

    target, rms, greatest: rad. step: of the greatest deviation.
    """

    target: float
    rms: float
    greatest: float
    step: int

    def __str__(self) -> str:
        return (
            f"through the table, in equal steps to {self.target / math.pi:.3g} π: {self.rms / math.pi:.3f} π r.m.s. "
            f"from a straight line, {self.greatest / math.pi:+.3f} π at step {self.step}"
        )


def verify_turn(through: FittedLut, target: float) -> Verification:
    """Compares the phase of a sweep through a table, in equal steps from 0 to `target` (rad), with these steps."""
    error = through.phase - target * through.fits[0].sweep.distance
    worst = int(np.abs(error).argmax())
    return Verification(target, float(np.sqrt(np.mean(error**2))), float(error[worst]), worst)


def turn_deviation(lut: FittedLut) -> tuple[float, float, float] | None:
    """How far a table is from a phase that rises by one turn in proportion to the level, as behind a vendor's table.

    Returns r.m.s. and greatest deviation, rad, and the level where it is; None where the stroke is nowhere near a turn.
    """
    if not 0.75 < lut.stroke / (2 * math.pi) < 1.25:
        return None
    error = lut.phase - 2 * math.pi * lut.fits[0].sweep.distance
    worst = int(np.abs(error).argmax())
    return float(np.sqrt(np.mean(error**2))), float(error[worst]), float(lut.levels[worst])


def save_lut(
    path: str | os.PathLike[str],
    lut: FittedLut,
    source: str,
    wavelengths_m: Sequence[float] = (),
    periods: Sequence[float] = (),
) -> None:
    """Writes `lut_table` as TOML, without phases that aren't known. An existing file is replaced by a complete one."""
    table = lut_table(lut, source, wavelengths_m, periods)
    known = [phase is not None for phase in table["phase_pi"]]
    for key in ("phase_pi", "phase_levels"):
        table[key] = [value for value, is_known in zip(table[key], known, strict=True) if is_known]
    table = {key: value for key, value in table.items() if value is not None}
    write_file(path, tomli_w.dumps(table))


def with_lut(system: System, lut: FittedLut, wavelength_m: float | None) -> System:
    """A bench whose modulators have this look-up table and stroke. Raises UserError if `wavelength_m` is None."""
    if wavelength_m is None:
        expected = "the wavelength of the sweep, e.g. --wavelength 820nm"
        raise UserError("--wavelength", "is missing", expected=expected, remedy="a stroke is a length")
    levels = lut.stroke_fractions.copy()
    levels[0], levels[-1] = 0.0, 1.0
    return system.edit({"stroke": lut.stroke_m(wavelength_m), "levels": levels})


def format_lut(lut: FittedLut, wavelengths_m: Sequence[float] = (), periods: Sequence[float] = ()) -> list[str]:
    """Order, stroke, linearity, residuals and what was assumed as lines of text."""
    low, high = (bound / math.pi for bound in lut.stroke_interval)
    lines = [f"{ORDER_NAMES[lut.order]}: {lut.reason}"]
    lines += [f"{fit.sweep.name}: {note}" for fit in lut.fits for note in fit.sweep.notes]
    stroke = f"stroke {lut.stroke / math.pi:.3g} π (95 %: {low:.3g} to {high:.3g} π)"
    if wavelengths_m:
        length = units.format_rounded(lut.stroke_m(wavelengths_m[0]), "nm")
        stroke += f" = {length} at {units.format_rounded(wavelengths_m[0], 'nm')}"
    lines.append(stroke)
    distance = lut.fits[0].sweep.distance
    order = np.argsort(distance)
    half = float(np.interp(0.5, distance[order], lut.phase[order] / lut.stroke))
    lines.append(f"half drive gives {half:.2f} of it, a linear response would give 0.5")
    lines.append(
        f"residual {lut.residual:.3g} of the power's range; "
        f"a straight line leaves {lut.linear_free:.3g} with a free stroke and {lut.linear_2pi:.3g} with 2 π"
    )
    level = turn_level(lut)
    if level is not None:
        lines.append(f"2 π at level {level:.0f}" if level >= 10 else f"2 π at level {level:.3g}")
    turn = turn_deviation(lut)
    if turn is not None:
        lines.append(
            f"from a turn in proportion to the level: {turn[0] / math.pi:.3f} π r.m.s., "
            f"{turn[1] / math.pi:+.3f} π at level {turn[2]:g}"
        )
    periods_tell = len(periods) == 1 == len(lut.fits) or len(set(periods)) == len(lut.fits)
    for k, fit in enumerate(lut.fits):
        named = f"{fit.sweep.name}: " if len(lut.fits) > 1 else ""
        grating = f"period {_of(periods, k):g} pixels: " if periods_tell else named
        if len(lut.fits) > 1:
            lines.append(f"{grating}residual {fit.residual:.3g}")
        if fit.slope:
            change = (
                f"{100 * fit.slope:+.1f} % a radian, {100 * fit.slope * fit.factor * lut.stroke:+.0f} % along the sweep"
            )
            lines.append(f"{grating}the spot's full power changes with the phase by {change} (fitted)")
        if fit.drift:
            change = f"{100 * fit.drift:+.1f} % along the sweep, in proportion to the level"
            lines.append(f"{grating}the spot's full power changes by {change} (fitted): did the laser drift?")
    if lut.unseen_shift is not None and abs(lut.unseen_shift) > 0.5 * (high - low) * math.pi:
        lines.append(
            f"the full power shows once: if it changed by {100 * UNSEEN_SLOPE:.0f} % a radian (fringing between bars), "
            f"the stroke would be {lut.unseen_shift / math.pi:+.2g} π more; wide bars show less of that"
        )
    return lines + _dispersion_lines(lut, wavelengths_m)


def _dispersion_lines(lut: FittedLut, wavelengths_m: Sequence[float]) -> list[str]:
    """The optical path at further wavelengths relative to the first; whether it falls as a liquid crystal's does."""
    lines: list[str] = []
    seen: set[float] = set()
    for fit, wavelength_m in zip(lut.fits, wavelengths_m, strict=False):
        if wavelength_m == wavelengths_m[0] or wavelength_m in seen:
            continue
        seen.add(wavelength_m)
        path = fit.factor * wavelength_m / wavelengths_m[0]
        names = [units.format_rounded(value, "nm") for value in (wavelength_m, wavelengths_m[0])]
        line = f"the optical path at {names[0]} is {path:.3f} of that at {names[1]}"
        if (path - 1) * (wavelength_m - wavelengths_m[0]) > 0.01 * abs(wavelength_m - wavelengths_m[0]):
            line += ": liquid crystals have less at the longer wavelength; check which file is of which wavelength"
        lines.append(line)
    return lines


def plot_lut(path: str | os.PathLike[str], lut: FittedLut, title: str) -> None:
    """Writes a PNG with two plots against grey level: measured and fitted power of each sweep, and the fitted phase."""
    with png_figure(path, (10.0, 4.2)) as figure:
        power, phase = figure.subplots(1, 2)
        for fit in lut.fits:
            lowest, scale = fit.sweep.power.min(), fit.sweep.range
            measured = power.plot(fit.sweep.levels, (fit.sweep.power - lowest) / scale, ".", markersize=4)
            name = label(fit.sweep.name) if len(lut.fits) > 1 else "monotone LUT"
            power.plot(fit.sweep.levels, (fit.power - lowest) / scale, color=measured[0].get_color(), label=name)
        power.set(xlabel="grey level", ylabel="power, share of its range", title=label(title))
        power.legend()
        phase.plot(lut.levels, lut.phase / math.pi, label="fitted")
        phase.plot(lut.levels, lut.fits[0].sweep.distance * lut.stroke / math.pi, "--", label="linear")
        phase.axhspan(*(bound / math.pi for bound in lut.stroke_interval), alpha=0.2, label="stroke, 95 %")
        phase.set(xlabel="grey level", ylabel="phase / π", title="phase of each level")
        phase.legend()


# --- tables of vendors ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class VendorTable:
    """The drive that a vendor's table gives to each grey level: drives (level,); bits: of the drive.

    is_stated: whether somebody stated the bits; else they are those of the largest drive.
    """

    drives: Floats
    bits: int
    is_stated: bool = False


@dataclass(frozen=True)
class VendorComparison:
    """How far the fitted phase is from a turn in proportion to the grey level behind a vendor's table.

    rms, greatest: rad. level: grey level of the greatest deviation. share: of the table's levels whose drives were
    measured. is_reversed: whether the sweep's levels count down in the drive.
    """

    rms: float
    greatest: float
    level: int
    share: float
    is_reversed: bool


def read_vendor_table(path: str | os.PathLike[str], bits: int | None = None) -> VendorTable:
    """Reads a vendor's table; see the module for layouts. bits: of the drive; as the largest says when None.

    Raises UserError for a file that is missing or isn't such a table: fewer than 16 levels, levels that don't count
    from 0, drives below 0 or above 16 bits.
    """
    file = Path(path)
    expected = "a table of one or two columns, grey level and drive: no other layout of a vendor is known"
    rows = parse_columns(read_text(file, expected), 2, expected, str(file))
    drives = rows[:, -1]
    if len(rows) < 16:
        raise UserError(str(file), f"{len(rows)} rows", expected="a table of at least 16 grey levels, e.g. 256")
    if rows.shape[1] == 2 and not (rows[:, 0] == np.arange(len(rows))).all():
        wrong = int(np.flatnonzero(rows[:, 0] != np.arange(len(rows)))[0])
        raise UserError(
            str(file), f"grey level {rows[wrong, 0]:g} in row {wrong + 1}", expected=f"{wrong}: levels from 0"
        )
    if drives.min() < 0 or drives.max() >= 2 ** _DRIVE_BITS[-1] or (drives != np.round(drives)).any():
        found = f"drives from {drives.min():g} to {drives.max():g}"
        raise UserError(str(file), found, expected="whole numbers from 0 to 65535")
    if bits is not None and drives.max() >= 2**bits:
        raise UserError(str(file), f"a drive of {drives.max():g}", expected=f"0 to {2**bits - 1} at {bits} bits")
    of_largest = next(n for n in _DRIVE_BITS if drives.max() < 2**n)
    return VendorTable(drives, of_largest if bits is None else bits, bits is not None)


def compare_vendor(lut: FittedLut, table: VendorTable) -> VendorComparison:
    """The deviation of the fitted phase from what a vendor's table promises, up to a constant phase.

    The sweep's levels are those without the table (a linear one): from 0 to the highest drive, or reversed. The
    direction that is nearer is taken. Raises UserError if less than half of the table's drives were measured, and where
    the table fits far better as one of more bits than its largest drive needs and nobody stated them.
    """
    found = _compared(lut, table.drives, table.bits)
    for bits in [] if table.is_stated else [bits for bits in _DRIVE_BITS if bits > table.bits]:
        other = _compared(lut, table.drives, bits)
        if other is not None and (found is None or other.rms < _FAR_BETTER * found.rms):
            said = "nothing that was measured" if found is None else f"{found.rms / math.pi:.2f} π r.m.s. off"
            words = f"drives up to {table.drives.max():g}: as of {table.bits} bits {said}, as of {bits} bits "
            words += f"{other.rms / math.pi:.2f} π"
            raise UserError("vendor's table", words, expected="its bits stated", remedy=f"--drive-bits {bits}")
    if found is None:
        expected = f"drives that the sweep holds, levels {lut.levels[0]:g} to {lut.levels[-1]:g}"
        raise UserError("vendor's table", f"drives of {table.bits} bits", expected=expected)
    return found


def _compared(lut: FittedLut, drives: Floats, bits: int) -> VendorComparison | None:
    """The comparison with drives of so many bits; None if less than half of them were measured."""
    highest = (
        lut.levels[-1] if lut.levels[0] > 0 else float(2 ** math.ceil(math.log2(max(lut.levels[-1], 1.0) + 1)) - 1)
    )
    levels = drives * (highest + 1) / 2**bits
    promised = 2 * math.pi * np.arange(len(drives)) / (len(drives) - 1)
    best: VendorComparison | None = None
    for is_reversed in (False, True):
        phase = _clamped(lut, highest - levels if is_reversed else levels)
        inside = np.isfinite(phase)
        if inside.mean() < 0.5:
            continue
        for sign in (1, -1):
            error = phase - sign * promised
            error -= np.median(error[inside])
            error[~inside] = 0.0
            rms, worst = float(np.sqrt(np.mean(error[inside] ** 2))), int(np.abs(error).argmax())
            if best is None or rms < best.rms:
                best = VendorComparison(rms, float(error[worst]), worst, float(inside.mean()), is_reversed)
    return best


def vendor_table(lut: FittedLut, bits: int = 12, levels: int = 256) -> str:
    """The fitted table as a vendor's: lines "grey level, drive", for a phase that rises by one turn.

    The drive has `bits` bits; the sweep's levels are taken as its upper bits. Raises UserError if the stroke is below
    a turn.
    """
    if lut.stroke < 2 * math.pi * (levels - 1) / levels:
        found = f"a stroke of {lut.stroke / math.pi:.3g} π"
        raise UserError("vendor's table", found, expected="2 π or more", remedy="such a table holds a whole turn")
    rising = lut.stroke_fractions * lut.stroke
    wanted = 2 * math.pi * np.arange(levels) / (levels - 1)
    at = np.interp(wanted, rising, lut.levels)
    size = 2 ** max(8, math.ceil(math.log2(lut.levels[-1] + 1))) if lut.levels[-1] > 1 else 1
    drives = np.minimum(np.round(at * 2**bits / size), 2**bits - 1).astype(int)
    return "".join(f"{level} {drive}\n" for level, drive in enumerate(drives))
