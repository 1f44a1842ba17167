"""`holoview focus FILE…`: finds the distance at which a hologram is sharpest, on both sides of its plane."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from holoview.commands.arguments import parse_range
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import add_field_options, open_files, reading_as_json, request_from_args
from holoview.commands.output_files import add_input
from holoview.holograms.fields.focus import MEASURES, FocusCurve, FoundFocus, default_range_m, find_focus
from holoview.holograms.fields.focused_objects import FocusedObject, Unclear
from holoview.holograms.load_field import field_of_files
from holoview.util import units
from holoview.util.errors import UserError

_UNDERSAMPLED = 0.25  # of the distance from which on all fringes are sampled: nearer, many aren't
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
    if any(known.key == "radius of the reference" for known in opened.provenance):
        field = field_of_files(args.names, request_from_args(args)).field  # not yet lit by the reference
    low_m, high_m = limits or default_range_m(field)
    with progress_bar("distances") as progress:
        found = find_focus(field, low_m, high_m, progress)
    if args.json:
        print_json(_as_json(found) | {"read": reading_as_json(opened, args.names)})
        return 0
    print("\n".join(_format(found)))
    if found.clear:
        plane = units.format_rounded(found.distance_m, "mm").replace(" ", "")
        print_stderr(f"note: view or render it with --plane {plane}")
    for sentence in _sampling(found):
        print_stderr(f"note: {sentence}")
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
            "distance_m": found.distances_m[name] if found.clear else None,
            "other_side_m": found.other_side_m[name] if found.clear else None,
            "other_side_share": found.other_side_share[name],
        }
        for name in MEASURES
    }
    objects = [
        {
            "distance_m": thing.distance_m,
            "depth_of_focus_m": thing.depth_of_focus_m,
            "share": thing.share,
            "centre_m": thing.centre_m,
        }
        for thing in found.objects
    ]
    unclear = [{"centre_m": thing.centre_m} for thing in found.unclear]
    focus = {"clear": found.clear, "range_m": found.range_m, "objects": objects, "unclear": unclear}
    focus |= {} if found.unexplained is None else {"unexplained": found.unexplained}
    return {
        "distance_m": found.distance_m if found.clear else None,
        "focus": focus,
        "measures": measures,
        "curves": curves,
    }


def _format(found: FoundFocus) -> list[str]:
    bars = ["", *_bars(found.curves[: found.whole])]
    if not found.clear:
        low, high = (units.format_rounded(z, "mm") for z in found.range_m)
        sides = " on either side" if found.range_m[0] > 0 else ""
        return [f"no clear focus between {low} and {high}{sides}", *bars]
    lines = []
    if found.whole > 1:
        twin = "; its twin image on the other side is as sharp"
        lines = [_of_object(thing) for thing in found.objects]
        lines[0] = f"sharpest at {lines[0]}{twin}"
        unclear = [f"something around x {x}, y {y} has no clear focus" for x, y in map(_place_of, found.unclear)]
        return ["\n    also at ".join(lines), *unclear, *_of_the_rest(found), *bars]
    for name in MEASURES:
        distance_m, other_m = found.distances_m[name], found.other_side_m[name]
        text = f"sharpest at {units.format_rounded(distance_m, 'mm')} by {name}"
        if other_m is not None:
            share = f"{found.other_side_share[name]:.0%} as sharp"
            text += f"; on the other side at {units.format_rounded(other_m, 'mm')}, {share}"
        lines.append(text)
    if abs(found.distances_m[MEASURES[0]] - found.distances_m[MEASURES[1]]) > 0.1 * abs(found.distance_m):
        lines.append("the measures differ: look at both")
    lines.append(f"depth of focus {units.format_rounded(found.objects[0].depth_of_focus_m, 'mm')}")
    return [*lines, *bars]


def _of_object(thing: FocusedObject) -> str:
    """The distance, place and share of an object in words."""
    words = f"{units.format_rounded(thing.distance_m, 'mm')} ± {units.format_rounded(thing.depth_of_focus_m / 2, 'mm')}"
    if thing.centre_m is not None:
        y, x = (units.format_rounded(part, "mm") for part in thing.centre_m)
        words += f", around x {x}, y {y}"
    return f"{words} ({thing.share:.0%} of what is sharp)"


def _of_the_rest(found: FoundFocus) -> list[str]:
    """What the list doesn't explain of an in-line recording, where that is much."""
    if not found.is_incomplete:
        return []
    where = "none of these distances" if len(found.objects) > 1 else "another distance, or none"
    least = units.format_rounded(found.least_apart_m, "mm")
    return [
        f"{found.unexplained:.0%} of the structure is in focus at {where}",
        f"two objects nearer to each other than {least} along z aren't told apart",
    ]


def _place_of(thing: Unclear) -> tuple[str, str]:
    """x and y of it."""
    y, x = (units.format_rounded(part, "mm") for part in thing.centre_m)
    return x, y


def _sampling(found: FoundFocus) -> list[str]:
    """What the samples don't hold of an in-line recording's fringes."""
    nearest = units.format_rounded(found.nearest_sampled_m, "mm")
    if not found.clear:
        least = units.format_rounded(found.nearest_searchable_m, "mm")
        return [f"an object nearer than {least} has fringes finer than the pixels: nearer ones aren't searched"] * (
            found.nearest_searchable_m > 0
        )
    near_m = abs(found.distance_m)
    if not near_m < _UNDERSAMPLED * found.nearest_sampled_m:
        return []
    share = near_m / found.nearest_sampled_m
    return [
        f"of an object so near, fringes farther from it than {share / 2:.0%} of the picture's side are finer than the "
        f"pixels (undersampled); from {nearest} on all are sampled"
    ]


def _bars(curves: tuple[FocusCurve, ...]) -> list[str]:
    """The curves that cover the range as text: the best of each of some equal shares of their distances.

    Each curve is scaled by its own least and largest value: the measures depend on the samples that were used.
    """
    lines = [f"{'distance':>12}  {MEASURES[0]:<{_BAR}}  {MEASURES[1]}"]
    order = np.argsort(np.concatenate([curve.distances_m for curve in curves]))
    distances_m = np.concatenate([curve.distances_m for curve in curves])[order]
    scaled = {}
    for name in MEASURES:
        parts = []
        for curve in curves:
            values = curve.measures[name]
            span = float(np.ptp(values))
            parts.append((values - values.min()) / span if span > 0 else np.zeros(len(values)))
        scaled[name] = np.concatenate(parts)[order]
    for part in np.array_split(np.arange(len(distances_m)), min(_ROWS, len(distances_m))):
        best = part[np.argmax(scaled[MEASURES[0]][part])]
        bars = ["#" * round(_BAR * float(values[part].max())) for values in scaled.values()]
        distance = units.format_rounded(float(distances_m[best]), "mm")
        lines.append(f"{distance:>12}  {bars[0]:<{_BAR}}  {bars[1]}".rstrip())
    return lines
