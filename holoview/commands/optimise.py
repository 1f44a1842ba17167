"""`holoview optimise PRESET PICTURE`: patterns and laser amplitudes that show a picture, as a hologram file."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

from holoview import units
from holoview.commands.common import add_system, progress_bar, say, system_of
from holoview.errors import UserError
from holoview.hologram import Hologram, load_hologram
from holoview.optimise.solve import Settings, State, iterate
from holoview.score import Score, eyebox_of, score
from holoview.system import System
from holoview.targets.build import Placement, target_for
from holoview.targets.focal_stack import Target
from holoview.targets.picture import read_picture
from holoview.view import simulate


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
    parser.add_argument("--seed", type=int, default=0, help="of the random phase to begin with")
    parser.add_argument("--start", metavar="FILE", help="a hologram file whose patterns to begin with")
    parser.add_argument(
        "--grid",
        choices=("compact", "preset"),
        default="compact",
        help="compact (default): padded just enough, about twice as fast; the score uses the preset's own grid",
    )
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, help="hologram file to write (.safetensors)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Optimises, saves (also after Ctrl-C: the best so far), and scores on the preset's own grid."""
    system = system_of(args)
    output = args.output or Path(f"{system.name or 'hologram'}-{Path(args.target).stem}.safetensors")
    if not output.parent.is_dir():
        raise UserError(str(output), f"the folder {output.parent} doesn't exist", remedy="create it or choose another")
    settings = Settings(iterations=args.iterations, step_rad=args.step, seed=args.seed)
    target = _target(args, system)
    start = _start(args.start)
    found = solve(system, target, settings, grid=args.grid, start=start)
    found.hologram.save(output)
    if found.interrupted:
        say(f"interrupted after iteration {found.state.iteration}: the best so far is kept in {output}")
        return 130
    view = simulate(found.hologram.system, found.hologram.drive, backend="torch")
    _report(args, system, output, found, score(view, target.stack))
    return 0


@dataclass(frozen=True)
class Found:
    """What an optimisation ended with; `interrupted` by Ctrl-C."""

    hologram: Hologram
    state: State
    interrupted: bool


def solve(
    system: System, target: Target, settings: Settings, *, grid: str = "compact", start: Hologram | None = None
) -> Found:
    """Runs the optimisation under a progress bar; Ctrl-C ends it with the best so far.

    grid "compact" pads by the walk-off only; the hologram keeps the system's own sampling.
    """
    on = system.with_(propagation="compact") if grid == "compact" and _is_linear(system) else system
    state: State | None = None
    interrupted = False
    with progress_bar(f"optimising {system.name}") as report:
        try:
            for state in iterate(on, target.stack, settings, None if start is None else start.drive):
                report(state.iteration, state.iterations, f"PSNR {state.best_psnr_db:.2f} dB")
        except KeyboardInterrupt:
            if state is None:
                raise
            interrupted = True
    assert state is not None
    best = state.best.system.edit({"propagation": system.sampling.propagation})
    return Found(Hologram(state.best.drive, best), state, interrupted)


def _is_linear(system: System) -> bool:
    return system.sampling.propagation == "linear"


def _target(args: argparse.Namespace, system: System) -> Target:
    def length(flag: str) -> float | None:
        text = getattr(args, flag)
        return None if text is None else units.parse(text, f"--{flag}")

    if not args.brightness > 0:
        raise UserError("--brightness", str(args.brightness), expected="a positive factor")
    if args.depth is None and (args.near or args.far):
        raise UserError("--near/--far", "without --depth", expected="a depth map, or --at for one distance")
    picture = read_picture(args.target)
    for note in picture.notes:
        say(f"note: {args.target}: {note}")
    placement = Placement(length("at"), args.depth, length("near"), length("far"))
    return target_for(system, picture, placement, args.brightness)


def _start(path: str | None) -> Hologram | None:
    return None if path is None else load_hologram(path)


def _report(args: argparse.Namespace, system: System, output: Path, found: Found, quality: Score) -> None:
    eyebox = eyebox_of(found.hologram)
    if args.json:
        table = {
            "preset": system.name,
            "file": str(output),
            "iterations": found.state.iteration,
            "seconds": round(found.state.seconds, 2),
            "psnr_db": quality.psnr.mean_db,
            "psnr_planes_db": list(quality.psnr.planes_db),
            "psnr_luminance_db": quality.psnr_luminance.mean_db,
            "delta_e": quality.delta_e,
            "speckle_contrast": quality.contrast,
            "eyebox_uniformity": eyebox.uniformity,
            "eyebox_variation": eyebox.coefficient_of_variation,
        }
        print(json.dumps(table, indent=2))
        return
    grid = found.hologram.system.sampling.propagation
    print(f"{output}: {found.state.iteration} iterations in {found.state.seconds:.1f} s")
    print(f"PSNR {quality.psnr.mean_db:.2f} dB (linear sRGB, mean over planes, scored on the {grid} grid)")
    print(f"luminance PSNR {quality.psnr_luminance.mean_db:.2f} dB, mean CIEDE2000 {quality.delta_e:.2f}")
    print(f"speckle contrast {quality.contrast:.3f}")
    print(f"eyebox: uniformity {eyebox.uniformity:.2f}, variation {eyebox.coefficient_of_variation:.2f}")
    print(f"look at it: holoview render --hologram {output} -o seen.png")
