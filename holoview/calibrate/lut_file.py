"""Writes a fitted look-up table as TOML, puts it into a bench, and formats it for people."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
import tomli_w

from holoview.calibrate.lut import Lut
from holoview.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file

FORMAT, VERSION = "holoview-lut", 1


def lut_table(lut: Lut, source: str, wavelength_m: float | None = None) -> dict[str, Any]:
    """The look-up table as keys and values for TOML or JSON.

    source: name of the file with the sweep.
    wavelength_m: of the sweep; with it the table states strokes as lengths.

    `levels` and `stroke` have the form of a preset's `[[modulators]]`.
    """
    low, high = lut.stroke_interval
    table: dict[str, Any] = {"format": FORMAT, "version": VERSION, "source": source}
    table["model"] = "power = b + a (1 + c x) sin(phase(x) / 2)^2, phase monotone; binary grating with equal bars"
    table["stroke_pi"] = lut.fit.stroke / math.pi
    table["stroke_pi_interval"] = [low / math.pi, high / math.pi]
    if wavelength_m is not None:
        per_radian = wavelength_m / (2 * math.pi)
        table["wavelength"] = units.format_exact(wavelength_m, "nm")
        table["stroke"] = units.format_rounded(lut.stroke_m(wavelength_m), "nm", 6)
        table["stroke_interval"] = [units.format_rounded(bound * per_radian, "nm", 6) for bound in (low, high)]
    table["contrast_slope"] = lut.fit.contrast_slope
    table["residual"] = {
        "monotone": lut.fit.relative_rms,
        "linear_free_stroke": lut.rms_linear_free,
        "linear_2pi": lut.rms_linear_2pi,
    }
    table["sent"] = lut.sweep.levels.tolist()
    table["levels"] = lut.stroke_fractions.tolist()
    return table


def save_lut(path: str | os.PathLike[str], lut: Lut, source: str, wavelength_m: float | None = None) -> None:
    """Writes `lut_table` as TOML. An existing file is replaced only by a complete one. Raises UserError."""
    write_file(path, tomli_w.dumps(lut_table(lut, source, wavelength_m)))


def with_lut(system: System, lut: Lut, wavelength_m: float | None) -> System:
    """A bench whose modulators have this look-up table and stroke. Raises UserError if `wavelength_m` is None."""
    if wavelength_m is None:
        expected = "the wavelength of the sweep, e.g. --wavelength 820nm"
        raise UserError("--wavelength", "is missing", expected=expected, remedy="a stroke is a length")
    levels = lut.stroke_fractions.copy()
    levels[0], levels[-1] = 0.0, 1.0
    return system.edit({"stroke": lut.stroke_m(wavelength_m), "levels": levels})


def format_lut(lut: Lut, wavelength_m: float | None) -> list[str]:
    """Stroke, linearity and residuals as lines of text."""
    low, high = (bound / math.pi for bound in lut.stroke_interval)
    stroke = f"stroke {lut.fit.stroke / math.pi:.3g} π (95 %: {low:.3g} to {high:.3g} π)"
    if wavelength_m is not None:
        stroke += (
            f" = {units.format_rounded(lut.stroke_m(wavelength_m), 'nm')} at {units.format_rounded(wavelength_m, 'nm')}"
        )
    half = float(np.interp(0.5, lut.sweep.relative_levels, lut.stroke_fractions))
    lines = [stroke, f"half drive gives {half:.2f} of it, a linear response would give 0.5"]
    lines.append(
        f"residual {lut.fit.relative_rms:.3g} of the highest power; "
        f"a straight line leaves {lut.rms_linear_free:.3g} with a free stroke and {lut.rms_linear_2pi:.3g} with 2 π"
    )
    if lut.fit.contrast_slope:
        lines.append(
            f"the order's full power changes by {100 * lut.fit.contrast_slope:+.0f} % along the sweep (fitted)"
        )
    return lines
