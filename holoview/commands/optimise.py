"""`holoview optimise PRESET PICTURE`: patterns and laser amplitudes that show a picture, as a hologram file."""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview import units
from holoview.commands.common import (
    add_system,
    check_output,
    progress_bar,
    say,
    seed,
    stopping_on_interrupt,
    system_of,
)
from holoview.errors import UserError
from holoview.hologram import Hologram, load_hologram
from holoview.optimise.checkpoint import Checkpoint, load_checkpoint
from holoview.optimise.memory import on_compact_grid
from holoview.optimise.settings import Settings
from holoview.optimise.solve import State, iterate
from holoview.score import Region, central_region, eyebox_of, score
from holoview.system import System
from holoview.targets.build import Placement, target_for
from holoview.targets.focal_stack import Target
from holoview.targets.picture import read_picture
from holoview.view import simulate

_LEAST_BRIGHTNESS = 1e-6


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_system(parser)
    parser.add_argument("target", metavar="PICTURE", help="PNG, JPEG, TIFF or EXR")
    parser.add_argument(
        "--depth", metavar="FILE", help="depth map of the picture's size (PNG, NPY or EXR; 0 is nearest)"
    )
    parser.add_argument(
        "--at", metavar="DISTANCE", help="where a picture without depth stands; the middle plane if absent"
    )
    parser.add_argument("--near", metavar="DISTANCE", help="where the depth map's 0 is; the first plane if absent")
    parser.add_argument("--far", metavar="DISTANCE", help="where the depth map's 1 is; the last plane if absent")
    parser.add_argument("--brightness", type=float, default=1.0, help="factor on the picture's linear light")
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--step", metavar="RAD", type=float, default=1.0, help="first step of the patterns' phase")
    parser.add_argument("--seed", type=seed, default=0, help="of the random phase to begin with")
    parser.add_argument("--start", metavar="FILE", help="a hologram file whose patterns to begin with")
    parser.add_argument(
        "--grid",
        choices=("compact", "preset"),
        default="compact",
        help="compact (default): padded just enough, about twice as fast; the score uses the preset's own grid",
    )
    parser.add_argument("--until-psnr", metavar="DB", type=float, default=math.inf, help="stop when it is this good")
    parser.add_argument("--time", metavar="SECONDS", type=float, default=math.inf, help="stop after this long")
    parser.add_argument(
        "--checkpoint", metavar="FILE", type=Path, help="write all that goes on from here, now and then"
    )
    parser.add_argument("--checkpoint-every", metavar="SECONDS", type=float, default=30.0)
    parser.add_argument("--resume", metavar="FILE", type=Path, help="go on from a checkpoint, and keep writing to it")
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="hologram file to write (.safetensors)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Optimises, saves (also after Ctrl-C: the best so far), and scores on the preset's own grid."""
    system = system_of(args)
    output = args.output or Path(f"{system.name or 'hologram'}-{Path(args.target).stem}.safetensors")
    check_output(output, ".safetensors")
    settings = Settings(iterations=args.iterations, step_rad=args.step, seed=args.seed)
    target = _target(args, system)
    found = solve(system, target, settings, _run(args))
    found.hologram.save(output)
    if found.interrupted:
        say(f"interrupted after iteration {found.state.iteration}: the best so far is kept in {output}")
        return 130
    _report(args, system, output, found, _scored(found.hologram, target))
    return 0


@dataclass(frozen=True)
class Found:
    """What an optimisation ended with; `interrupted` by Ctrl-C."""

    hologram: Hologram
    state: State
    interrupted: bool


@dataclass(frozen=True)
class Run:
    """How to run an optimisation: where it begins, when it ends, and what it writes on the way."""

    grid: str = "compact"
    start: Hologram | None = None
    resume: Checkpoint | None = None
    checkpoint: Path | None = None
    every_s: float = 30.0
    until_psnr_db: float = math.inf
    until_s: float = math.inf


_PLAIN = Run()


def solve(system: System, target: Target, settings: Settings, run: Run = _PLAIN) -> Found:
    """Runs the optimisation under a progress bar; Ctrl-C ends it with the best so far.

    On the grid "compact" it pads by the walk-off only; the hologram keeps the system's own sampling.
    """
    on = on_compact_grid(system) if run.grid == "compact" else system
    state: State | None = None
    start = None if run.start is None else run.start.drive
    with stopping_on_interrupt() as asked, progress_bar(f"optimising {system.name}") as report:
        saved = time.monotonic()
        for state in iterate(on, target.stack, settings, start, run.resume):
            report(state.iteration, state.iterations, f"PSNR {state.best_psnr_db:.2f} dB")
            enough = state.best_psnr_db >= run.until_psnr_db or state.seconds >= run.until_s or asked()
            due = enough or state.iteration == state.iterations or time.monotonic() - saved >= run.every_s
            if run.checkpoint is not None and due:
                _save_checkpoint(state, run.checkpoint)
                saved = time.monotonic()
            if enough:
                break
        interrupted = asked()
    if state is None:
        raise UserError("--resume", "the checkpoint is of a finished optimisation", expected="one with iterations left")
    best = state.best.system.edit({"propagation": system.sampling.propagation})
    return Found(Hologram(state.best.drive, best), state, interrupted)


def _save_checkpoint(state: State, path: Path) -> None:
    """A checkpoint that can't be written is no reason to lose the optimisation: the one before stays."""
    try:
        state.checkpoint().save(path)
    except UserError as error:
        say(f"note: no checkpoint after iteration {state.iteration}: {error}")


def _target(args: argparse.Namespace, system: System) -> Target:
    def length(flag: str) -> float | None:
        text = getattr(args, flag)
        return None if text is None else units.parse(text, f"--{flag}")

    if not _LEAST_BRIGHTNESS <= args.brightness <= 1 / _LEAST_BRIGHTNESS:
        expected = f"a factor from {_LEAST_BRIGHTNESS:g} to {1 / _LEAST_BRIGHTNESS:g}"
        raise UserError("--brightness", f"{args.brightness:g}", expected=expected)
    if args.depth is None and (args.near is not None or args.far is not None):
        raise UserError("--near/--far", "without --depth", expected="a depth map, or --at for one distance")
    picture = read_picture(args.target)
    for note in picture.notes:
        say(f"note: {args.target}: {note}")
    placement = Placement(length("at"), args.depth, length("near"), length("far"))
    return target_for(system, picture, placement, args.brightness)


def _run(args: argparse.Namespace) -> Run:
    """The run that the arguments describe; UserError for limits that make no sense and files that can't serve."""
    for flag in ("checkpoint_every", "time", "until_psnr"):
        if not getattr(args, flag) > 0:
            raise UserError(f"--{flag.replace('_', '-')}", f"{getattr(args, flag):g}", expected="a positive number")
    if args.resume and args.start:
        raise UserError("--resume with --start", "contradict each other", expected="one of them")
    checkpoint = args.checkpoint or args.resume
    if checkpoint is not None:
        check_output(checkpoint, ".safetensors")
    return Run(
        grid=args.grid,
        start=None if args.start is None else load_hologram(args.start),
        resume=None if args.resume is None else load_checkpoint(args.resume),
        checkpoint=checkpoint,
        every_s=args.checkpoint_every,
        until_psnr_db=args.until_psnr,
        until_s=args.time,
    )


def _scored(hologram: Hologram, target: Target) -> dict[str, Any] | str:
    """How good the hologram is, on the preset's own grid; in words why that can't be said, e.g. of 4 x 4 pixels."""
    view = simulate(hologram.system, hologram.drive, backend="torch")
    try:
        quality, eyebox = score(view, target.stack, _region(target.stack)), eyebox_of(hologram)
    except UserError as error:
        return str(error)
    return {
        "psnr_db": quality.psnr.mean_db,
        "psnr_planes_db": list(quality.psnr.planes_db),
        "psnr_luminance_db": quality.psnr_luminance.mean_db,
        "delta_e": quality.delta_e,
        "speckle_contrast": quality.contrast,
        "eyebox_uniformity": eyebox.uniformity,
        "eyebox_variation": eyebox.coefficient_of_variation,
    }


def _region(stack: NDArray[np.floating]) -> Region | None:
    """Where to judge speckle: the central half, or everything when that is black in some plane."""
    x, y, w, h = central_region(stack.shape[1:3])
    lit = stack[:, y : y + h, x : x + w].any(axis=(1, 2, 3)).all()
    return None if lit else (0, 0, stack.shape[2], stack.shape[1])


def _report(args: argparse.Namespace, system: System, output: Path, found: Found, scores: dict[str, Any] | str) -> None:
    """What was written and how good it is."""
    state, grid = found.state, found.hologram.system.sampling.propagation
    if isinstance(scores, str):
        say(f"note: {output} is saved but can't be scored: {scores}")
        scores = {}
    if args.json:
        table = {"preset": system.name, "file": str(output), "iterations": state.iteration}
        print(json.dumps(table | {"seconds": round(state.seconds, 2)} | scores, indent=2))
        return
    print(f"{output}: {state.iteration} iterations in {state.seconds:.1f} s")
    if scores:
        print(f"PSNR {scores['psnr_db']:.2f} dB (linear sRGB, mean over planes, scored on the {grid} grid)")
        print(f"luminance PSNR {scores['psnr_luminance_db']:.2f} dB, mean CIEDE2000 {scores['delta_e']:.2f}")
        print(f"speckle contrast {scores['speckle_contrast']:.3f}")
        print(f"eyebox: uniformity {scores['eyebox_uniformity']:.2f}, variation {scores['eyebox_variation']:.2f}")
    print(f"look at it: holoview render --hologram {output} -o seen.png")
