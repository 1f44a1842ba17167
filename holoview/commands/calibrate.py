"""`holoview calibrate CAPTURES.h5 -o CALIBRATED.toml` learns corrections to a bench's model from camera captures;
`holoview calibrate lut FILE.csv` fits a modulator's look-up table to a diffraction-efficiency sweep.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from holoview.commands import calibrate_captures, calibrate_lut
from holoview.commands.output_files import add_input, add_output
from holoview.util.errors import UserError


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser, "source", nargs="+", metavar="CAPTURES.h5 | lut FILE.csv", help="a capture file, or lut and a sweep"
    )
    add_output(parser, "-o", "--output", metavar="TOML", suffix=".toml", help="the preset, or the table, to write")
    add_input(parser, "--preset", help="the bench to start from: a preset's name or a TOML file")
    parser.add_argument("--json", action="store_true", help="machine-readable figures on stdout")
    calibrate_captures.add_options(parser.add_argument_group("captures"))
    calibrate_lut.add_options(parser.add_argument_group("lut"))


def run(args: argparse.Namespace) -> int:
    """Dispatches to `calibrate_captures` or `calibrate_lut`."""
    source: list[str] = args.source
    if source[0] == "lut" and len(source) == 2:
        _reject_foreign_options(args, calibrate_captures.OPTIONS, "holoview calibrate CAPTURES.h5")
        return calibrate_lut.run_lut(args, Path(source[1]))
    if len(source) != 1 or source[0] == "lut":
        expected = "CAPTURES.h5, or: lut FILE.csv"
        raise UserError("holoview calibrate", f'"{" ".join(source)}"', expected=expected)
    _reject_foreign_options(args, calibrate_lut.OPTIONS, "holoview calibrate lut")
    return calibrate_captures.run_captures(args, Path(source[0]))


def _reject_foreign_options(args: argparse.Namespace, options: tuple[str, ...], belongs_to: str) -> None:
    """Raises UserError for an option that only the other form of the command has."""
    for option in options:
        if getattr(args, option) is not None:
            raise UserError(f"--{option.replace('_', '-')}", "doesn't apply here", expected=f"it with `{belongs_to}`")
