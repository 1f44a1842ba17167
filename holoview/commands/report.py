"""`holoview report HOLOGRAM… -o report.html`: a report for a reviewer that prints to two sheets, with its JSON.

Speckle contrast with its standard error, of each laser and of colour; what the author claims, with a verdict; the
light, the eyebox, the instrument and the bench; and the command that makes it again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shlex
from functools import partial
from pathlib import Path

from holoview.commands.arguments import add_changes, parse_region, system_from_args, whole, with_changes
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import add_field_options, check_no_field_options, is_preset, open_files
from holoview.commands.output_files import add_input, add_output, check_files
from holoview.commands.speckle_options import (
    add_edge,
    add_meter,
    add_place,
    add_target,
    edge_rows,
    meter_from_args,
    target_from_args,
)
from holoview.evidence.study.claims import parse_claim
from holoview.evidence.study.display_contrast import DisplayContrast, display_contrast
from holoview.evidence.study.hologram_report import report_html, report_json, review_hologram
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.colour_speckle import DRAW_SEED
from holoview.holograms.metrics.speckle_measurement import STRUCTURE_COUNTS
from holoview.holograms.view import random_drive
from holoview.light.model.focus import parse_plane
from holoview.light.model.system import System
from holoview.light.numerics.sampling import central_region
from holoview.util.errors import UserError
from holoview.util.figures import require_matplotlib
from holoview.util.file_writer import write_file
from holoview.util.files import read_bytes
from holoview.util.progress import TextCallback
from holoview.viewer.page.page import page_html

_MOST = 4  # holograms of a report
_LARGEST_BYTES = 1 << 34


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(
        parser,
        "names",
        metavar="HOLOGRAM",
        nargs="+",
        help="files of holograms, up to four, or presets, which show random patterns; with --parts those of one field",
    )
    add_changes(parser)
    add_place(parser)
    parser.add_argument(
        "--claim",
        metavar="TEXT",
        action="append",
        default=[],
        help='what is claimed, e.g. "C < 0.4"; several may be given',
    )
    parser.add_argument("--title", default="", help="heading of the page")
    parser.add_argument("--live", action="store_true", help="embed the holograms, which any browser computes again")
    add_target(parser)
    add_edge(parser)
    parser.add_argument(
        "--contrast-ratio",
        metavar="N",
        type=whole(1, 1000),
        help="also the sequential and the checkerboard contrast of each bench, of pictures optimised by N iterations",
    )
    add_meter(parser)
    add_output(
        parser,
        "-o",
        "--output",
        metavar="HTML",
        suffix=".html",
        required=True,
        help="page to write; JSON goes beside it",
    )
    parser.add_argument("--json", action="store_true", help="print the numbers, too")
    add_field_options(parser)


def run(args: argparse.Namespace) -> int:
    """Measures the holograms, and writes the page and the JSON file."""
    require_matplotlib("report")
    claims, meter = [parse_claim(text) for text in args.claim], meter_from_args(args)
    beside = args.output.with_suffix(".json")
    check_files(args, {"-o": [args.output, beside]})
    holograms = _holograms(args)
    reviewed, planes_m, notes = [], list[float](), dict[str, None]()
    with progress_bar("measuring") as progress:
        for number, (name, digest, hologram) in enumerate(holograms):
            progress(number, len(holograms), name)
            system = hologram.system
            own_m = system.planes_m
            plane_m = (
                float(own_m[len(own_m) // 2]) if args.plane is None else parse_plane(system, args.plane, "--plane")
            )
            region = central_region(system.way.shape) if args.region is None else parse_region(args.region)
            target = target_from_args(args, system, lambda text: notes.update({text: None}))
            planes_m.append(plane_m)
            edge = () if args.edge is None else edge_rows(hologram, meter, parse_region(args.edge))
            display = _display_contrast(system, args, partial(progress, number, len(holograms)))
            reviewed.append(review_hologram(name, digest, hologram, plane_m, region, target, meter, edge, display))
    for note in notes:
        print_stderr(f"note: {note}")
    title = args.title or f"Speckle report: {', '.join(name for name, _, _ in holograms)}"
    seeds = {"colours drawn": DRAW_SEED}
    if any(not digest for _, digest, _ in holograms):
        seeds["random patterns"] = args.random
    if meter.camera is not None:
        seeds["noise of the camera"] = meter.camera.seed
    command = shlex.join(["holoview", *args.words])
    live = ""
    if args.live:
        first = holograms[0][2]
        source = target_from_args(args, first.system, lambda text: None)  # it was told above
        named = {name: hologram for name, _, hologram in holograms}
        built = None if source is None else source.with_plane(planes_m[0])
        measured = None if meter.name else reviewed[0].region  # a page measures without an instrument
        live = page_html(named, target=built, plane_m=planes_m[0], region=measured)
    table = report_json(reviewed, claims, title=title, command=command, seeds=seeds)
    write_file(args.output, report_html(reviewed, claims, title=title, command=command, seeds=seeds, live=live))
    write_file(beside, json.dumps(table, indent=2, allow_nan=False, ensure_ascii=False) + "\n")
    if args.json:
        print_json(table)
        return 0
    for one in table["holograms"]:
        stated = f"withheld: {one['withheld']}"
        if one["contrast"] is not None:
            stated = f"{one['contrast']:.4f} +- {one['standard_error']:.2g}"
        is_raw = bool(one["sha256"]) and one["contrast"] is not None and not one["structure_removed"]
        print(f"{one['name']}: {'raw ' if is_raw else ''}speckle contrast {stated}")
        if is_raw:
            print(f"  {STRUCTURE_COUNTS}")
        for claim in one["claims"]:
            print(f"  claim {claim['claim']}: {claim['verdict']}")
    print(f"{args.output}, {beside}")
    return 0


def _display_contrast(system: System, args: argparse.Namespace, status: TextCallback) -> DisplayContrast | None:
    """The contrast ratios that --contrast-ratio asks for. Raises UserError for a field, which has no modulators."""
    if args.contrast_ratio is None:
        return None
    if system.is_field:
        raise UserError("--contrast-ratio", "with a field", expected="a bench with modulators, to optimise pictures")
    return display_contrast(system, {"iterations": args.contrast_ratio, "seed": 0}, status)


def _holograms(args: argparse.Namespace) -> list[tuple[str, str, Hologram]]:
    """The name, the digest of the file, "" of a preset, and the hologram of each."""
    if args.parts:
        hologram = _seen(open_files(args.names, args).hologram, args)
        return [(Path(args.names[0]).name, _digest(args.names), hologram)]
    if len(args.names) > _MOST:
        raise UserError("HOLOGRAM", f"{len(args.names)} of them", expected=f"at most {_MOST} in a report")
    found = [_hologram(name, args) for name in args.names]
    shapes = {hologram.system.way.shape for _, _, hologram in found}
    if len(shapes) > 1 and args.target is not None:
        raise UserError("--target", "holograms of several sizes", expected="one size", remedy="report them one by one")
    return found


def _hologram(name: str, args: argparse.Namespace) -> tuple[str, str, Hologram]:
    if not is_preset(name):
        if args.scheme is not None or not all(change.startswith("observer=") for change in args.changes):
            raise UserError("--set or --scheme", "with a hologram file", expected="the bench that it was made for")
        return Path(name).name, _digest([name]), _seen(open_files([name], args).hologram, args)
    check_no_field_options(args, f"the preset {name}")
    system = system_from_args(argparse.Namespace(**vars(args) | {"preset": name}))
    return f"{system.name}, random patterns", "", Hologram(random_drive(system, args.random), system)


def _seen(hologram: Hologram, args: argparse.Namespace) -> Hologram:
    """The hologram seen by the observer of --observer."""
    return Hologram(hologram.drive, with_changes(hologram.system, args.changes))


def _digest(names: list[str]) -> str:
    """SHA-256 of files, one after the other."""
    digest = hashlib.sha256()
    for name in names:
        digest.update(read_bytes(Path(name), "a hologram", most=_LARGEST_BYTES))
    return digest.hexdigest()
