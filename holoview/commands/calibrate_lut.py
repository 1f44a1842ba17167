"""Runs `holoview calibrate lut FILE.csv`: fits a modulator's look-up table to a diffraction-efficiency sweep."""

from __future__ import annotations

import argparse
from pathlib import Path

from holoview.calibrate import lut_file
from holoview.calibrate.efficiency_sweep import read_sweep
from holoview.calibrate.lut import fit_lut
from holoview.calibrate.lut_plot import plot_lut
from holoview.commands.console import print_json
from holoview.commands.output_files import add_output
from holoview.model import preset
from holoview.report.images import require_matplotlib
from holoview.util import units
from holoview.util.errors import UserError

# destinations in argparse's namespace of the options that only this form of the command has
OPTIONS = ("wavelength", "plot", "save_preset")
_WAVELENGTH_RANGE_M = (100e-9, 10e-6)


def add_options(group: argparse._ArgumentGroup) -> None:
    """Adds the options for a look-up table."""
    group.add_argument("--wavelength", metavar="LENGTH", help='of the sweep, e.g. "820 nm": turns phases into lengths')
    add_output(group, "--plot", metavar="PNG", suffix=".png", help="draw the sweep, its fit and the table")
    add_output(
        group,
        "--save-preset",
        metavar="TOML",
        suffix=".toml",
        help="write --preset with this stroke and table (wants --wavelength)",
    )


def run_lut(args: argparse.Namespace, file: Path) -> int:
    """Fits the table, writes the files that were asked for, and prints stroke and residuals."""
    wavelength = _parse_wavelength(args.wavelength)
    if args.plot is not None:
        require_matplotlib("--plot")
    if (args.save_preset is None) != (args.preset is None):
        missing = "--preset" if args.preset is None else "--save-preset"
        raise UserError(missing, "is missing", expected="--preset and --save-preset together")
    preset_system = None if args.preset is None else preset.load(args.preset)
    lut = fit_lut(read_sweep(file))
    system = None if preset_system is None else lut_file.with_lut(preset_system, lut, wavelength)
    if args.output is not None:
        lut_file.save_lut(args.output, lut, file.name, wavelength)
    if system is not None:
        preset.save(system, args.save_preset)
    if args.plot is not None:
        plot_lut(args.plot, lut, file.name)
    if args.json:
        print_json(lut_file.lut_table(lut, file.name, wavelength))
    else:
        print("\n".join(lut_file.format_lut(lut, wavelength)))
    return 0


def _parse_wavelength(text: str | None) -> float | None:
    if text is None:
        return None
    value = units.parse(text, "--wavelength")
    if not _WAVELENGTH_RANGE_M[0] <= value <= _WAVELENGTH_RANGE_M[1]:
        raise UserError("--wavelength", text, expected="between 100 nm and 10 um")
    return value
