"""`holoview diagnose --rig RIG.toml`: captures taken one by one, each chosen by what is still open."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from holoview.captures.dataset import Captures, join_captures
from holoview.captures.predictor import check_user_effects
from holoview.commands.arguments import parse_duration
from holoview.commands.console import deferred_interrupt, print_stderr
from holoview.commands.number_options import number, whole
from holoview.commands.output_files import add_input, add_output
from holoview.experiment.next_capture.closed_loop import ClosedLoop, InformedPlanner, LoopResult, LoopSettings
from holoview.model.effects.effect import Effect
from holoview.model.effects.registry import listed_effects
from holoview.rig import open_rig, read_rig
from holoview.rig.measure.capture_folder import CaptureFolder, loop_captures
from holoview.util.errors import UserError
from holoview.util.input_file import read_text

_SETTINGS = LoopSettings()
_OPTIONS = ("save", "certainty", "most_captures", "bench_time")


def add_rig_options(parser: argparse.ArgumentParser) -> None:
    """Adds --rig and what belongs to it."""
    group = parser.add_argument_group("captures that are taken, in place of a file")
    add_input(group, "--rig", metavar="RIG.toml", help="take captures with this rig until the cause is certain")
    add_output(group, "-o", "--save", metavar="FILE.h5", suffix=".h5", help="keep the captures; a loop goes on there")
    group.add_argument(
        "--certainty", metavar="P", type=number(0, 1), help="probability at which to stop (default: 0.99)"
    )
    group.add_argument(
        "--captures",
        dest="most_captures",
        metavar="N",
        type=whole(-9),
        help=f"take at most so many (default: {_SETTINGS.max_captures})",
    )
    group.add_argument("--bench-time", metavar="TIME", type=parse_duration, help="take captures for at most so long")


def check_rig_options(args: argparse.Namespace) -> None:
    """Raises UserError unless either a file or a rig is given, with options that belong to it."""
    if (args.file is None) == (args.rig is None):
        found = "both are given" if args.rig is not None else "neither is given"
        raise UserError("CAPTURES.h5 or --rig", found, expected="one of them")
    for name in _OPTIONS:
        if args.rig is None and getattr(args, name) is not None:
            flag = {"most_captures": "--captures", "bench_time": "--bench-time"}.get(name, f"--{name}")
            raise UserError(flag, "is of captures that are taken", expected="--rig RIG.toml with it")
    if args.rig is not None and args.preset is not None:
        raise UserError("--preset", "together with --rig", remedy="state the geometry in rig.toml")
    if args.rig is not None and args.known:
        raise UserError("--known", "together with --rig", remedy="keep the captures (-o), then diagnose their file")
    if args.certainty is not None and not 0.5 <= args.certainty < 1:
        raise UserError("--certainty", f"{args.certainty:g}", expected="0.5 or more, below 1")
    if args.most_captures is not None and args.most_captures < 1:
        raise UserError("--captures", f"{args.most_captures}", expected="1 or more")


def diagnose_rig(
    args: argparse.Namespace, user_effects: Sequence[Effect], **options: Any
) -> tuple[Captures, LoopResult, int]:
    """The captures, what the loop found, and the exit code.

    user_effects: are evaluated once with the first capture. options: of the diagnosis.
    """
    rig = read_rig(args.rig)
    kept = None if args.save is None else loop_captures(args.save, read_text(args.rig, "a rig"))
    before = [] if kept is None else kept.resume()

    def keep(number: int, capture: Captures) -> None:
        if kept is not None:
            kept.write(number, capture)
        if number == 0:
            check_user_effects(capture, user_effects)

    with deferred_interrupt("capture") as interruption:
        try:
            with open_rig(rig) as devices:
                loop = ClosedLoop(
                    rig,
                    devices,
                    list(listed_effects().values()),
                    InformedPlanner(rig),
                    _settings(args),
                    keep=keep,
                    tell=print_stderr,
                    is_asked_to_end=interruption,
                    **options,
                )
                result = loop.run(before)
        except (UserError, KeyboardInterrupt):
            _tell_where(kept)
            raise
    captures = join_captures(result.parts) if kept is None else kept.join_into(args.save, result.parts)
    return captures, result, interruption.exit_code


def loop_as_json(result: LoopResult) -> dict[str, Any]:
    """What the loop did, for programs."""
    steps = [step.as_json() for step in result.steps]
    return {"ended": result.ended, "certain": result.is_certain, "captures": steps}


def print_loop(result: LoopResult) -> None:
    """How the loop ended, in a line."""
    seconds = math.fsum(step.seconds for step in result.steps)
    print(f"{len(result.parts)} captures, {seconds:.3g} s on the bench: {result.ended}")


def _settings(args: argparse.Namespace) -> LoopSettings:
    given = {
        "certainty": args.certainty,
        "max_captures": args.most_captures,
        "bench_time_s": args.bench_time,
    }
    return dataclasses.replace(_SETTINGS, **{name: value for name, value in given.items() if value is not None})


def _tell_where(kept: CaptureFolder | None) -> None:
    if kept is not None:
        print_stderr(f"the captures are in {kept.folder}; the same command goes on")
