"""`holoview measure RIG.toml -o FILE.h5`: takes a session of captures with real or virtual devices."""

from __future__ import annotations

import argparse

from holoview.commands.console import print_stderr, progress_bar
from holoview.commands.output_files import add_input, add_output
from holoview.rig import open_rig, read_rig
from holoview.rig.measure.capture_plan import default_plan, read_plan
from holoview.rig.measure.capture_store import CaptureStore
from holoview.rig.measure.session import MeasurementSession
from holoview.util.errors import UserError
from holoview.util.input_file import read_text


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_input(parser, "rig", metavar="RIG.toml", help="description of the rig")
    add_input(parser, "--plan", metavar="PLAN.toml", help="which captures (default: 8 of every laser and three planes)")
    add_output(parser, "-o", "--output", metavar="FILE.h5", suffix=".h5", required=True)


def run(args: argparse.Namespace) -> int:
    """Takes the captures that are missing; the same command goes on after any interruption."""
    rig = read_rig(args.rig)
    plan = default_plan(rig) if args.plan is None else read_plan(args.plan, rig)
    store = CaptureStore(args.output, plan, read_text(args.rig, "a rig"))
    store.open()
    try:
        with open_rig(rig) as devices, progress_bar("measuring") as report:
            MeasurementSession(rig, devices).run(plan, store, report)
    except (UserError, KeyboardInterrupt):
        count = len(plan.requests) - len(store.missing)
        print_stderr(f"{count} of {len(plan.requests)} captures are in {store.folder}; the same command goes on")
        raise
    captures = store.finish()
    print(f"{args.output}: {len(captures)} captures of {len(captures.wavelengths_m)} wavelengths")
    return 0
