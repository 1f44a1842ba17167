"""`holoview sweep BENCH --set gap=1mm:3mm:9 --measure psnr,light`: measures against any parameter of bench, effects,
optimiser.

`--set KEY=FIRST:LAST:COUNT` and `--set KEY=A,B,…` say what is swept, every combination of them; `--set KEY=VALUE`
changes the bench at every point. Keys are those of presets, `effects.NAME.KEY=…`, and `optimiser.KEY=…`. A hologram, or
the random patterns of a preset, is shown as it is, or with `--optimise N` found anew at every point. `--tolerance
psnr=0.5dB` finds how far each parameter may be off, and the worst pairs.
"""

from __future__ import annotations

import argparse
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from holoview.commands.arguments import add_changes, add_effects, add_fields, given_fields, parse_region, whole
from holoview.commands.console import print_json, print_stderr, progress_bar
from holoview.commands.hologram_files import NAMES_HELP, add_field_options, shown_by_args
from holoview.commands.output_files import add_input, add_output, hold_outputs
from holoview.commands.speckle_options import add_place, add_target, check_needs_target
from holoview.commands.study import add_workers, execution_target
from holoview.evidence.study.hologram_study import target_picture
from holoview.evidence.study.runner import ResultStore
from holoview.evidence.sweep.axes import Axis, check_key, grid_points, is_of_optimiser, split_changes
from holoview.evidence.sweep.measures import MEASURES, parse_measures
from holoview.evidence.sweep.points import ParameterSweep, PointRunner, SweptTarget
from holoview.evidence.sweep.results import (
    as_csv,
    as_json,
    sweep_figure,
    tolerance_figure,
    tolerance_json,
    tolerance_lines,
    withheld_text,
)
from holoview.evidence.sweep.tolerance import Tolerance, ToleranceTable, centred_axes, find_limits, parse_tolerance
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.targets.target_source import TargetLight
from holoview.util.errors import UserError
from holoview.util.figures import png_figure, require_matplotlib
from holoview.util.file_writer import write_file
from holoview.util.processes import exit_code_of

_DEFAULT_MEASURES = "contrast,eyebox,light"
_PANEL_IN = (4.6, 3.4)  # width and height of a measure's panel


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "names", nargs="+", metavar="BENCH|FILE", help=NAMES_HELP)
    add_changes(parser)
    add_effects(parser, dest="switched_on")
    parser.add_argument(
        "--measure", metavar="A,B,…", help=f"what is measured: {', '.join(MEASURES)} ({_DEFAULT_MEASURES})"
    )
    add_place(parser)
    group = parser.add_argument_group("target and optimiser")
    add_target(group)
    add_fields(group, TargetLight, "brightness")
    group.add_argument(
        "--optimise",
        metavar="N",
        type=whole(1),
        help="find patterns at each point by N iterations that begin with its neighbour's; three times as many for the "
        "first",
    )
    group.add_argument("--cold", action="store_true", help="begin each optimisation with random patterns instead")
    parser.add_argument(
        "--tolerance",
        metavar="MEASURE=AMOUNT",
        action="append",
        default=[],
        help="vary each parameter alone and find the values at which the measure is worse by this, e.g. psnr=0.5dB; "
        "several may be given",
    )
    add_output(
        parser, "-o", "--output", metavar="CSV", suffix=".csv", required=True, help="table to write; finished points "
        "are kept beside it, in NAME.points, where the same command goes on"
    )  # fmt: skip
    add_output(parser, "--plot", metavar="PNG", suffix=".png", help="figure to write")
    add_workers(parser)
    parser.add_argument("--json", action="store_true", help="print the points as JSON")
    add_field_options(parser)


def run(args: argparse.Namespace) -> int:
    """Measures the points that aren't done yet, and writes the table and the figure. Ctrl-C keeps finished points."""
    axes, args.changes = split_changes(args.changes)
    for axis in axes:
        check_key(axis.key)
    if not axes:
        remedy = "e.g. --set gap=1mm:3mm:9 or --set frames=1,3"
        raise UserError("--set", "no parameter has several values", expected="what is swept", remedy=remedy)
    if args.plot is not None:
        require_matplotlib("--plot")
    target = execution_target(args)
    tolerances = [parse_tolerance(text) for text in args.tolerance]
    sweep = _sweep(args, axes, tolerances)
    if tolerances:
        axes = centred_axes(axes, sweep.system)
    points = grid_points(axes) if not tolerances else [
        {other.key: other.values[0] for other in axes} | {axis.key: value} for axis in axes for value in axis.values
    ]  # fmt: skip
    sweep.check(axes, points)
    folder = args.output.with_suffix(".points")
    hold_outputs(args, [folder])
    store, started = ResultStore(folder, keeps_holograms=sweep.settings is not None), time.monotonic()
    found: ToleranceTable | None = None
    with progress_bar("sweep") as progress:
        runner = PointRunner(sweep, axes, store, target, progress)
        try:
            if tolerances:
                found = find_limits(axes, sweep.system, tolerances, runner.run_about)
            else:
                runner.run_grid(points)
        except KeyboardInterrupt as error:
            rows = runner.rows()
            write_file(args.output, as_csv(axes, rows))
            print_stderr(f"interrupted: {len(rows)} points are in {args.output}; the same command goes on")
            return exit_code_of(error)
        finally:
            with suppress(OSError):
                folder.rmdir()  # if nothing was measured
    _write(args, axes, runner, sweep, found, time.monotonic() - started)
    return 0


def _sweep(args: argparse.Namespace, axes: list[Axis], tolerances: list[Tolerance]) -> ParameterSweep:
    """What the arguments say. Raises UserError for what contradicts each other; says what it takes for granted."""
    shown = shown_by_args(args)
    for note in shown.guess_notes:
        print_stderr(f"note: {note}")
    named = args.measure or ",".join([_DEFAULT_MEASURES] * (not tolerances))
    asked = [named, *(tolerance.measure for tolerance in tolerances)]
    names = parse_measures(",".join(filter(None, asked)), shown.system)
    has_settings = any(is_of_optimiser(axis.key) for axis in axes)
    settings = None
    if args.optimise is not None or has_settings:
        if shown.system.is_field:
            raise UserError("--optimise", "with a field", expected="a bench with modulators")
        iterations = Settings().iterations if args.optimise is None else args.optimise
        settings = Settings(iterations=iterations, seed=args.random)
    if args.cold and settings is None:
        raise UserError("--cold", "without --optimise", expected="both, or neither")
    check_needs_target(args)
    target, brightness = None, TargetLight(**given_fields(args, TargetLight)).brightness
    if args.target is not None:
        path = str(Path(args.target).absolute())
        target = SweptTarget(path, _absolute(args.depth), brightness, args.framing)
    elif settings is not None or any(MEASURES[name].needs_target for name in names):
        picture = target_picture("still-life")
        print_stderr("note: without --target the still life that is part of holoview is the target")
        target = SweptTarget(str(picture), str(picture.with_name("still-life-depth.png")), brightness)
        if shown.drive is None and settings is None:
            print_stderr("note: random patterns are shown beside it; --optimise N finds patterns")
    elif args.brightness is not None:
        raise UserError("--brightness", "without a target", expected="both, or neither")
    sweep = ParameterSweep(shown.system, names, shown.drive, args.random, args.plane, None, target, settings, args.cold)
    files = tuple(str(Path(text).absolute()) for text in args.switched_on if text.endswith(".py") and "=" not in text)
    region = None if args.region is None else parse_region(args.region)
    return replace(sweep, region=region, light=shown.light, effect_files=files)


def _absolute(path: str | None) -> str | None:
    return None if path is None else str(Path(path).absolute())


def _write(
    args: argparse.Namespace,
    axes: list[Axis],
    runner: PointRunner,
    sweep: ParameterSweep,
    found: ToleranceTable | None,
    seconds: float,
) -> None:
    """Writes the table and the figure, and prints what was found."""
    rows = runner.rows()
    write_file(args.output, as_csv(axes, rows))
    if sweep.target is not None and (withheld := withheld_text(rows)):
        print_stderr(f"note: {withheld}")
    if args.plot is not None:
        panels = len(sweep.measures) if found is None else len(found.limits)
        size = _PANEL_IN[0] * min(panels, 2), _PANEL_IN[1] * -(-panels // 2)
        with png_figure(args.plot, size) as figure:
            (sweep_figure(axes, rows, sweep.measures) if found is None else tolerance_figure(found, rows))(figure)
    if args.json:
        table: dict[str, Any] = {"preset": sweep.system.name, "file": str(args.output)}
        table |= {"optimised": sweep.settings is not None, "points": as_json(axes, rows)}
        print_json(table | ({} if found is None else {"tolerance": tolerance_json(found)}))
        return
    how = "shown as they are" if sweep.settings is None else "optimised anew at each point"
    print(f"{sweep.system.name}: {len(rows)} points, patterns {how}, in {seconds:.1f} s")
    for line in [] if found is None else tolerance_lines(found):
        print(line)
    print("\n".join(str(path) for path in (args.output, args.plot) if path is not None))
