"""`holoview focus FILE…`: finds the distance at which a hologram is sharpest, on both sides of its plane."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from holoview.commands.arguments import parse_range
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import add_field_options, open_files, reading_as_json
from holoview.commands.output_files import add_input
from holoview.util import units
from holoview.util.errors import UserError
from holoview.wavefield.focus import MEASURES, FocusCurve, FoundFocus, default_range_m, find_focus

_ROWS, _BAR = 21, 28  # of the curve as text; width of its longest bar


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "names", metavar="FILE", nargs="+", help="a hologram's file, or files that are its parts")
    add_field_options(parser, has_plane=False)
    parser.add_argument(
        "--range",
        metavar="A,B",
        help="distances to search, e.g. 5,40cm or -3mm,3mm; without a sign both sides (default: half to one and a half "
        "times the expected distance, or as far as the samples allow)",
    )
    parser.add_argument("--json", action="store_true", help="machine-readable output, with all curves")


def run(args: argparse.Namespace) -> int:
    """Finds and prints the distance by two measures, the other side's, and the curve."""
    limits = None if args.range is None else parse_range(args.range, "--range")
    args.propagation = "asm"  # the field stays in its plane, from which the search counts
    opened = open_files(args.names, args)
    if not opened.hologram.system.is_field:
        raise UserError(args.names[0], "patterns of modulators", expected="a field: their planes stand in the file")
    field = opened.hologram.field()
    low_m, high_m = limits or default_range_m(field)
    with progress_bar("distances") as progress:
        found = find_focus(field, low_m, high_m, progress)
    if args.json:
        print_json(_as_json(found) | {"read": reading_as_json(opened, args.names)})
        return 0
    print("\n".join(_format(found)))
    print_stderr(
        f"note: view or render it with --plane {units.format_rounded(found.distance_m, 'mm').replace(' ', '')}"
    )
    return 0


def _as_json(found: FoundFocus) -> dict[str, Any]:
    curves = [
        {
            "samples": curve.samples,
            "distance_m": curve.distances_m.tolist(),
            **{name.replace(" ", "_"): values.tolist() for name, values in curve.measures.items()},
        }
        for curve in found.curves
    ]
    measures = {
        name.replace(" ", "_"): {
            "distance_m": found.distances_m[name],
            "other_side_m": found.other_side_m[name],
            "other_side_share": found.other_side_share[name],
        }
        for name in MEASURES
    }
    return {"distance_m": found.distance_m, "measures": measures, "curves": curves}


def _format(found: FoundFocus) -> list[str]:
    lines = []
    for name in MEASURES:
        distance_m, other_m = found.distances_m[name], found.other_side_m[name]
        text = f"sharpest at {units.format_rounded(distance_m, 'mm')} by {name}"
        if other_m is not None:
            share = f"{found.other_side_share[name]:.0%} as sharp"
            text += f"; on the other side at {units.format_rounded(other_m, 'mm')}, {share}"
        lines.append(text)
    if abs(found.distances_m[MEASURES[0]] - found.distances_m[MEASURES[1]]) > 0.1 * abs(found.distance_m):
        lines.append("the measures differ: look at both")
    return [*lines, "", *_bars(found.curves[0])]


def _bars(curve: FocusCurve) -> list[str]:
    """The coarse curve as text: the best of each of some equal shares of its distances."""
    lines = [f"{'distance':>12}  {MEASURES[0]:<{_BAR}}  {MEASURES[1]}"]
    scaled = {}
    for name, values in curve.measures.items():
        span = float(np.ptp(values))
        scaled[name] = (values - values.min()) / span if span > 0 else np.zeros(len(values))
    for part in np.array_split(np.arange(len(curve.distances_m)), min(_ROWS, len(curve.distances_m))):
        best = part[np.argmax(scaled[MEASURES[0]][part])]
        bars = ["#" * round(_BAR * float(values[part].max())) for values in scaled.values()]
        distance = units.format_rounded(float(curve.distances_m[best]), "mm")
        lines.append(f"{distance:>12}  {bars[0]:<{_BAR}}  {bars[1]}".rstrip())
    return lines
