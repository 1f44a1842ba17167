"""`holoview measure RIG.toml -o FILE.h5`: takes captures with real or virtual devices."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from holoview.bench.rig import open_rig, read_rig
from holoview.bench.rig.capture_folder import CaptureStore
from holoview.bench.rig.capture_plan import (
    CapturePlan,
    Forecast,
    default_plan,
    forecast_lines,
    make_forecast,
    read_plan,
)
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.measurement import Measurement, is_complete
from holoview.commands.console import print_stderr, progress_bar
from holoview.commands.output_files import add_input, add_output
from holoview.util.errors import UserError
from holoview.util.files import read_text
from holoview.util.memory_limit import format_size


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "rig", metavar="RIG.toml", help="description of the rig")
    add_input(
        parser,
        "--plan",
        metavar="PLAN",
        help="which captures, in TOML, or a CSV of `captures plan` (default: 8 of every laser and three planes)",
    )
    add_output(parser, "-o", "--output", metavar="FILE.h5", suffix=".h5", required=True)
    parser.add_argument("--dry-run", action="store_true", help="print all that would happen; nothing is opened")
    parser.add_argument("--finish", action="store_true", help="write the file of the captures that are there")


def run(args: argparse.Namespace) -> int:
    """Takes the captures that are missing; the same command goes on after any interruption."""
    rig = read_rig(args.rig)
    plan = default_plan(rig) if args.plan is None else read_plan(args.plan, rig)
    store = CaptureStore(args.output, plan, f"{read_text(args.rig, 'a rig')}{rig.registration or ''}")
    damaged = store.inspect()
    forecast = make_forecast(rig, plan, store.missing)
    if args.dry_run:
        print("\n".join(forecast_lines(rig, forecast)))
        return 0
    forecast.require_memory()
    for number in damaged:
        print_stderr(f"capture {number} is damaged; it is taken again")
    if not args.finish:
        _note_disk(args.output, forecast)
        store.open()
        if not is_complete(store):
            _measure(rig, plan, store)
    captures = store.finish()
    left = f" of {len(plan.requests)}" if store.missing else ""
    print(f"{args.output}: {len(captures)}{left} captures of {len(captures.wavelengths_m)} wavelengths")
    return 0


def _measure(rig: RigDescription, plan: CapturePlan, store: CaptureStore) -> None:
    """Takes what is missing; says what is there if anything interrupts it."""
    try:
        with open_rig(rig) as devices, progress_bar("measuring") as report:
            Measurement(rig, devices, print_stderr).run(plan, store, report)
    except (UserError, KeyboardInterrupt):
        where = f"captures are in {store.folder}; the same command goes on"
        print_stderr(f"{store.written} of {len(plan.requests)} {where}")
        raise


def _note_disk(output: Path, forecast: Forecast) -> None:
    """Says so if the disk may not hold the captures one by one and the file of all of them."""
    free = shutil.disk_usage(output.parent).free
    if free < 2 * forecast.data_bytes:
        print_stderr(
            f"{output.parent}: {format_size(free)} are free; "
            f"captures one by one and in one file may take up to {format_size(2 * forecast.data_bytes)}"
        )
