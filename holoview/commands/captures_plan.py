"""`holoview captures plan FIRST.h5`: exposures and laser powers for a session, from a few first captures."""

from __future__ import annotations

import argparse
import csv
import io
from dataclasses import asdict
from pathlib import Path

from holoview.calibrate.exposure import HEADROOM, ExposureLimits, ExposureSetting, plan_exposures
from holoview.captures import read_captures
from holoview.captures.folder_import import read_greyscale
from holoview.commands.console import print_json
from holoview.commands.number_options import number
from holoview.commands.output_files import add_input, add_output
from holoview.util.file_writer import write_file

_CSV_COLUMNS = ("wavelength_nm", "power", "exposure_s", "reached_counts", "note")


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "captures", help="a capture file with at least one capture of each wavelength")
    add_input(parser, "--dark", metavar="PICTURE", type=Path, help="PNG or TIFF with the lasers off")
    parser.add_argument("--power", type=number(), nargs=2, metavar=("LOW", "HIGH"), default=ExposureLimits().powers)
    parser.add_argument(
        "--exposure", type=number(), nargs=2, metavar=("LOW", "HIGH"), default=ExposureLimits().exposures_s
    )
    parser.add_argument("--headroom", type=number(), default=HEADROOM, help="share of the range to use (default 0.9)")
    add_output(parser, "-o", "--output", metavar="CSV", suffix=".csv", help="write the plan as a table")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints power and exposure for each wavelength that keep all but the brightest 0.1 % of the pixels unsaturated."""
    captures = read_captures(args.captures)
    dark = None if args.dark is None else read_greyscale(args.dark)
    plan = plan_exposures(captures, dark, ExposureLimits(tuple(args.power), tuple(args.exposure)), args.headroom)
    if args.output is not None:
        _write(args.output, plan)
    if args.json:
        print_json([asdict(setting) for setting in plan])
        return 0
    for setting in plan:
        note = f"  {setting.note}" if setting.note else ""
        print(
            f"{setting.wavelength_m * 1e9:.6g} nm: power {setting.power:g}, "
            f"exposure {setting.exposure_s * 1e3:.4g} ms, reaches {setting.reached:.0f} counts above black{note}"
        )
    return 0


def _write(path: Path, plan: list[ExposureSetting]) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(_CSV_COLUMNS)
    for setting in plan:
        nm = f"{setting.wavelength_m * 1e9:.6g}"
        writer.writerow([nm, setting.power, setting.exposure_s, f"{setting.reached:.1f}", setting.note])
    write_file(path, text.getvalue())
