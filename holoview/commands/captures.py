"""`holoview captures make | check | show | import | plan`: measured data and simulated measurements."""

from __future__ import annotations

import argparse
import csv
import io
import re
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.calibrate.exposure import ExposureLimits, ExposureSetting, plan_exposures
from holoview.bench.captures import read_captures, write_captures
from holoview.bench.captures.capture_file import BENCH_FILE, TABLE_FILE, import_folder, region_mask
from holoview.bench.captures.count_bits import counts_as_stated
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.picture_files import (
    Pair,
    read_camera_picture,
    read_greyscale,
    read_pairs,
    read_pattern,
)
from holoview.bench.captures.picture_import import KnownBench, PictureAndPattern, import_pictures, overlay_sheet
from holoview.bench.captures.records import find_record_errors
from holoview.bench.captures.slmsuite_calibration import FourierCalibration, read_slmsuite
from holoview.bench.captures.validation import capture_sheet, summarise
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, Nuisances, make_captures
from holoview.commands.arguments import (
    add_effects,
    add_fields,
    add_system,
    dest_of,
    given_fields,
    parse_effects,
    system_from_args,
    whole,
)
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.output_files import ResultSaver, add_input, add_output
from holoview.holograms.files.pictures import write_png
from holoview.light.model.fields import fields_by_key, flag_of
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.tables import is_required


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the subcommands."""
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _configure_make(commands.add_parser("make", help="measure a virtual bench", description=_make.__doc__))
    check = commands.add_parser("check", help="validate a capture file", description=_check.__doc__)
    add_input(check, "captures", help="a capture file")
    check.add_argument(
        "--quick", action="store_true", help="don't check whether patterns, pictures and settings belong together"
    )
    check.add_argument("--json", action="store_true", help="machine-readable output")
    check.set_defaults(run=_check)
    show = commands.add_parser("show", help="a contact sheet of a capture file", description=_show.__doc__)
    add_input(show, "captures", help="a capture file")
    add_output(show, "-o", "--output", metavar="PNG", suffix=".png", required=True)
    show.add_argument("--most", type=whole(1, 1000), default=12, help="captures on the sheet (default 12)")
    show.set_defaults(run=_show)
    convert = commands.add_parser(
        "import",
        help=f"a folder of PNG or TIFF with {TABLE_FILE} and {BENCH_FILE}, or pictures and their patterns",
        description=f"Converts a folder of greyscale PNG or TIFF; {TABLE_FILE} has a line a capture, "
        f"{BENCH_FILE} the geometry. Or pictures of a Fourier bench with the patterns that were shown, by --pattern "
        "once for each or by a CSV with columns image and slm1: orientation, focal length and axis are found.",
    )
    _configure_import(convert)
    plan = commands.add_parser("plan", help="exposures and laser powers", description=_plan.__doc__)
    _configure_plan(plan)


def _configure_import(convert: argparse.ArgumentParser) -> None:
    add_input(convert, "source", type=Path, nargs="+", metavar="FOLDER | PAIRS.csv | PICTURE …")
    add_output(convert, "-o", "--output", metavar="FILE.h5", suffix=".h5", required=True)
    add_input(
        convert, "--mask", type=Path, metavar="PICTURE", help="black pixels are left out of every fit and measure"
    )
    convert.add_argument("--roi", metavar="Y0:Y1,X0:X1", help="rows and columns beyond which pixels are left out")
    one = convert.add_argument_group("pictures of a Fourier bench")
    add_input(
        one,
        "--pattern",
        type=Path,
        action="append",
        metavar="PICTURE",
        help="the pattern that was shown, once for each picture, behind all of these",
    )
    add_input(
        one,
        "--slmsuite",
        type=Path,
        metavar="H5",
        help="a Fourier calibration, which states the lengths that aren't given",
    )
    add_fields(one, KnownBench, *fields_by_key(KnownBench), states_units=True)
    add_output(one, "--overlay", metavar="PNG", suffix=".png", help="draw the predicted over the measured picture")
    convert.set_defaults(run=_import)


def run(args: argparse.Namespace) -> int:
    """Never called: each subcommand sets its own `run`."""
    raise AssertionError


def _configure_make(parser: argparse.ArgumentParser) -> None:
    add_system(parser, effects=False)
    add_effects(parser)
    add_output(parser, "-o", "--output", metavar="FILE.h5", suffix=".h5", required=True)
    add_fields(
        parser,
        AcquisitionSettings,
        *("captures_per_condition", "seed", "focal_length", "camera_pitch", "camera_shape", "finer"),
        states_units=True,
    )
    jitter = parser.add_argument_group("what varies by itself (standard deviations)")
    add_fields(jitter, Nuisances, *fields_by_key(Nuisances), states_units=True)
    parser.set_defaults(run=_make)


def _make(args: argparse.Namespace) -> int:
    """Simulates captures of a preset with its effects and those of `--effects`; the file states the nominal bench."""
    nuisances = Nuisances(**given_fields(args, Nuisances))
    settings = AcquisitionSettings(**given_fields(args, AcquisitionSettings), nuisances=nuisances)
    effects = parse_effects(args.effects)
    system = system_from_args(args)
    with progress_bar("measuring") as report:
        captures = make_captures(
            system, effects, settings, progress=lambda done, total: report(done, total, "captures")
        )
    saver = ResultSaver()
    output = saver.save(args.output, partial(write_captures, captures=captures))
    print(f"{output}: {len(captures)} captures of {len(captures.wavelengths_m)} wavelengths")
    return saver.exit_code


def _check(args: argparse.Namespace) -> int:
    """Validates a capture file and its records, and lists what it contains and what it can't show."""
    captures = read_captures(args.captures)
    summary = summarise(captures)
    found = None
    if not args.quick:
        with progress_bar("checking") as report:
            report(0, 1, "records")
            found = find_record_errors(captures)
        summary["records"] = found.as_json()
    if args.json:
        print_json(summary)
        return 0
    (rows, columns), (image_rows, image_columns) = summary["pixels"], summary["image"]
    wavelengths = ", ".join(units.format_rounded(λ, "nm") for λ in summary["wavelengths_m"])
    distances = ", ".join(units.format_rounded(z, "mm") for z in summary["distances_m"])
    saturated = summary["saturated"]
    print(f"{args.captures}: {summary['captures']} captures, {summary['geometry']}")
    if captures.chain is None:
        print(f"  modulators   {summary['modulators']} of {columns} x {rows} pixels, {summary['levels'][0]} levels")
    else:
        shapes = captures.chain.drive_shapes.items()
        for (name, (_, own_rows, own_columns)), levels in zip(shapes, summary["levels"], strict=True):
            print(f"  {name:<11}  {own_columns} x {own_rows} pixels, {levels} levels")
    print(f"  camera       {image_columns} x {image_rows} pixels, {summary['mean_electrons']:.0f} electrons")
    print(f"  stops        {'; then '.join(summary['stops'])}")
    print(f"  wavelengths  {wavelengths}")
    print(f"  distances    {distances}")
    print(f"  saturated    {saturated['mean']:.2%} of the pixels, {saturated['worst']:.2%} in the worst picture")
    if "left_out" in summary:
        (y0, y1), (x0, x1) = summary["left_out"]["rows"], summary["left_out"]["columns"]
        share = f"{summary['left_out']['share']:.2%} of the pixels"
        print(f"  left out     {share}; the others are in rows {y0} to {y1 - 1}, columns {x0} to {x1 - 1}")
    for sentence in summary.get("estimated", []):
        print(f"  estimated    {sentence}")
    if "clipped" in summary:
        clipped = summary["clipped"]
        print(f"  clipped      {clipped['share']:.2%} of the counts, at {clipped['level']:g}: below the full scale")
    if summary["dark"]:
        print(f"  dark         captures {', '.join(map(str, summary['dark']))}")
    for name, why in summary["cant_tell"].items():
        print(f"  can't tell   {name}: {why}")
    for line in [] if found is None else found.lines:
        print(f"  records      {line}")
    return 0


def _show(args: argparse.Namespace) -> int:
    """Draws patterns and camera images of captures spread over the file; saturated pixels are red, masked ones blue."""
    captures = read_captures(args.captures)
    write_png(args.output, capture_sheet(captures, max(args.most, 1)), {"holoview.bench.captures": str(args.captures)})
    print(args.output)
    return 0


def _import(args: argparse.Namespace) -> int:
    notes: list[str] = []
    pairs = _pairs(args)
    if pairs is not None:
        captures = _import_pictures(args, pairs, notes)
    else:
        stated = (*map(dest_of, fields(KnownBench)), "slmsuite", "overlay")
        given = [name for name in stated if getattr(args, name) is not None]
        if given:
            flag = f"--{given[0].replace('_', '-')}"
            raise UserError(flag, "without --pattern", expected="a picture and its pattern")
        with progress_bar("reading") as report:
            captures = import_folder(args.source[0], lambda done, total: report(done, total, "captures"), notes.append)
        usable = _usable(args, captures.shape)
        if usable is not None:
            captures = replace(captures, usable=np.broadcast_to(usable, captures.images.shape))
            notes.append(f"{100 * (1 - usable.mean()):.2g} % of each picture are left out")
        notes += [f"estimated: {sentence}" for sentence in captures.estimated]
    for note in notes:
        print_stderr(f"note: {note}")
    saver = ResultSaver()
    output = saver.save(args.output, partial(write_captures, captures=captures))
    print(f"{output}: {len(captures)} captures")
    return saver.exit_code


def _pairs(args: argparse.Namespace) -> list[Pair] | None:
    """The pictures with their patterns; None for a folder with a description of the bench."""
    sources: list[Path] = args.source
    first, table = sources[0], sources[0] / TABLE_FILE
    is_table = first.suffix.lower() == ".csv" or (table.is_file() and not (first / BENCH_FILE).is_file())
    is_stated = args.wavelength is not None or args.slmsuite is not None
    if len(sources) == 1 and args.pattern is None and is_table and is_stated:
        return read_pairs(first if first.suffix.lower() == ".csv" else table)
    if args.pattern is None:
        if len(sources) > 1 or first.suffix.lower() == ".csv":
            missing = "--pattern" if len(sources) > 1 else "--wavelength"
            raise UserError(missing, "is missing", expected="pictures, their patterns, the wavelength and the pitches")
        return None
    if len(args.pattern) != len(sources):
        found = f"{len(args.pattern)} patterns for {len(sources)} pictures"
        raise UserError("--pattern", found, expected="one for each picture, in their order")
    return [Pair(*one) for one in zip(sources, args.pattern, strict=True)]


def _import_pictures(args: argparse.Namespace, pairs: list[Pair], notes: list[str]) -> Captures:
    """The captures of pictures and their patterns; what was found and assumed is added to the notes."""
    given = given_fields(args, KnownBench)
    if args.slmsuite is not None:
        given |= _lengths_of_slmsuite(args.slmsuite, given, notes)
    for field in fields(KnownBench):
        if is_required(field) and field.name not in given:
            expected = "the wavelength and the pitches of modulator and camera"
            raise UserError(flag_of(field), "is missing", expected=expected)
    known = KnownBench(**given)
    shown, losses = [], [0.0]
    for pair in pairs:
        picture, loss = read_camera_picture(pair.picture)
        if loss is not None:
            notes.append(loss.sentence(pair.picture.name))
            losses.append(loss.error_counts)
        pattern = read_pattern(pair.pattern)
        names = pair.picture.name, pair.pattern.name
        shown.append(PictureAndPattern(picture, pattern, *names, pair.power, pair.exposure_s))
    usable = _usable(args, shown[0].picture.shape[:2])
    with progress_bar("placing the pictures") as report:
        found = import_pictures(shown, known, usable=usable, compression_counts=max(losses), progress=report)
    if args.overlay is not None:
        write_png(args.overlay, overlay_sheet(found), {"holoview.bench.captures": str(args.output)})
    notes += found.notes
    return found.captures


def _lengths_of_slmsuite(path: Path, given: dict[str, Any], notes: list[str]) -> dict[str, float]:
    """The lengths (m) of a Fourier calibration that aren't given, by the names of their fields."""
    found = read_slmsuite(path)
    if not isinstance(found, FourierCalibration):
        remedy = f"holoview calibrate lut {path}"
        raise UserError(str(path), "is a pixel calibration", expected="a Fourier calibration", remedy=remedy)
    known = {"wavelength_m": found.wavelength_m, "pitch_m": found.pitch_m, "camera_pitch_m": found.camera_pitch_m}
    taken = {name: length for name, length in known.items() if length is not None and name not in given}
    camera_pitch_m = (taken | given).get("camera_pitch_m")
    if "focal_length_m" not in given and camera_pitch_m is not None:
        taken["focal_length_m"] = found.focal_px * camera_pitch_m
    unit = {"wavelength_m": "nm", "focal_length_m": "mm"}
    words = [f"{n[:-2].replace('_', ' ')} {units.format_rounded(m, unit.get(n, 'um'))}" for n, m in taken.items()]
    y, x = found.axis_px
    notes.append(f"{path.name}: {', '.join(words) or 'nothing was needed'}; its axis is at row {y:.0f}, column {x:.0f}")
    return taken


def _usable(args: argparse.Namespace, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """The pixels (y, x) that --mask and --roi leave, None without these."""
    rows, columns = shape
    usable = np.ones((rows, columns), bool)
    if args.mask is not None:
        mask = read_greyscale(args.mask, "a mask")
        if mask.shape != usable.shape:
            found = f"{mask.shape[1]} × {mask.shape[0]} pixels"
            raise UserError(str(args.mask), found, expected=f"{columns} × {rows}, as the pictures")
        usable &= mask > 0
    if args.roi is not None:
        numbers = re.fullmatch(r"(\d{1,9}):(\d{1,9}),(\d{1,9}):(\d{1,9})", args.roi.replace(" ", ""))
        if numbers is None:
            raise UserError("--roi", f'"{args.roi}"', expected="rows and columns, such as 100:500,200:900")
        y0, y1, x0, x1 = (int(text) for text in numbers.groups())
        usable &= region_mask((y0, y1, x0, x1), (rows, columns), "--roi")
    if not usable.any():
        raise UserError("--mask", "leaves no pixel", expected="some that aren't black")
    return None if args.mask is None and args.roi is None else usable


# --- `plan`: exposures and laser powers for captures, from a few first captures ---


_CSV_COLUMNS = ("wavelength_nm", "power", "exposure_s", "reached_counts", "note")


def _configure_plan(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "captures", help="a capture file with at least one capture of each wavelength")
    add_input(parser, "--dark", metavar="PICTURE", type=Path, help="PNG or TIFF with the lasers off")
    add_fields(parser, ExposureLimits, *fields_by_key(ExposureLimits))
    add_output(parser, "-o", "--output", metavar="CSV", suffix=".csv", help="write the plan as a table")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    parser.set_defaults(run=_plan)


def _plan(args: argparse.Namespace) -> int:
    """Prints power and exposure for each wavelength that keep all but the brightest 0.1 % of the pixels unsaturated."""
    limits = ExposureLimits(**given_fields(args, ExposureLimits))
    captures = read_captures(args.captures)
    dark = None if args.dark is None else _dark_counts(args.dark, captures.camera.bit_depth)
    plan = plan_exposures(captures, dark, limits)
    if args.output is not None:
        _write_plan(args.output, plan)
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


def _dark_counts(path: Path, bit_depth: int) -> NDArray[np.uint16]:
    """The picture (y, x) in counts of so many bits, of which notes say what was changed."""
    pictures = read_greyscale(path).astype(np.uint16)[None]
    counts: NDArray[np.uint16] = counts_as_stated(pictures, bit_depth, lambda note: print_stderr(f"note: {note}"))[0]
    return counts


def _write_plan(path: Path, plan: list[ExposureSetting]) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(_CSV_COLUMNS)
    for setting in plan:
        nm = f"{setting.wavelength_m * 1e9:.6g}"
        writer.writerow([nm, setting.power, setting.exposure_s, f"{setting.reached:.1f}", setting.note])
    write_file(path, text.getvalue())
