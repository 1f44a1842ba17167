"""Arguments of `holoview optimise`, and the settings and run options that they describe."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

from holoview.commands.arguments import add_system, number, parse_duration, parse_region, parse_seed, whole
from holoview.commands.output_files import add_input, add_output
from holoview.io.hologram import Hologram, load_hologram
from holoview.metrics.perceptual_scores import OPTIONAL_SCORES
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.numerics.tensors import Region
from holoview.optimise.checkpoint import Checkpoint, load_checkpoint
from holoview.optimise.eyes import CHROMATIC, PupilPlaces
from holoview.optimise.parallel import device_for_rank, resolve_torch_device
from holoview.optimise.settings import INITIAL_PATTERNS, LOSS_SPACES, VARIABLES, Settings
from holoview.targets.picture import COLOUR_SPACES
from holoview.util.errors import UserError

_DEFAULTS = Settings()


@dataclass(frozen=True)
class RunOptions:
    """How to run an optimisation: device, start, stopping criteria, and files that are written meanwhile.

    grid: "compact" pads the simulation only by the walk-off of the light, "preset" as the bench says.
    device: of torch. sharded: whether the processes that torchrun started share the lasers.
    initial_hologram: its patterns are the initial ones. resume: a checkpoint to continue from.
    checkpoint, preview: files to write; checkpoint_interval_s: least time between two checkpoints.
    stop_psnr_db: PSNR at which to stop. time_limit_s: time after which to stop.
    """

    grid: str = "compact"
    device: str = "cpu"
    sharded: bool = False
    initial_hologram: Hologram | None = None
    resume: Checkpoint | None = None
    checkpoint: Path | None = None
    checkpoint_interval_s: float = 30.0
    preview: Path | None = None
    stop_psnr_db: float = math.inf
    time_limit_s: float = math.inf


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds all arguments of the command."""
    add_system(parser)
    _add_target(parser.add_argument_group("target"))
    _add_objective(parser.add_argument_group("what is sought"))
    _add_running(parser.add_argument_group("running"))
    _add_rig(parser.add_argument_group("camera in the loop"))


def _add_target(group: argparse._ArgumentGroup) -> None:
    add_input(
        group,
        "target",
        metavar="TARGET",
        help="a picture (PNG, JPEG, TIFF, EXR), a focal stack (a folder, TIFF pages, EXR), or a light field (a folder "
        "with views.toml)",
    )
    add_input(group, "--depth", metavar="FILE", help="depth map of the picture's size (PNG, NPY, EXR): 0 is nearest")
    group.add_argument(
        "--at",
        metavar="DISTANCE",
        help="where a picture without depth stands, or views have no disparity; the middle plane if absent",
    )
    group.add_argument(
        "--near",
        metavar="DISTANCE",
        help="where the depth map's 0 is, the larger distance; the largest plane if absent",
    )
    group.add_argument(
        "--far",
        metavar="DISTANCE",
        help="where the depth map's 1 is, the smaller distance; the smallest plane if absent",
    )
    group.add_argument(
        "--views",
        metavar="ROWSxCOLUMNS[:SPACING]",
        help="viewpoints in the eyebox: of a folder without views.toml, e.g. 5x5:0.5mm; with a picture, render it from "
        "them, with occlusion, e.g. 9x9",
    )
    group.add_argument("--brightness", type=number(), default=1.0, help="factor on the target's linear light (1)")
    group.add_argument("--saturation", type=number(), default=1.0, help="factor on its chroma in CIE LCHuv (1)")
    group.add_argument("--space", choices=COLOUR_SPACES, default="srgb", help="of a float file; xyz: Y = 1 is white")


def _add_objective(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--loss",
        choices=tuple(LOSS_SPACES),
        help="; ".join(f"{name}: {loss.description}" for name, loss in LOSS_SPACES.items()),
    )
    group.add_argument(
        "--free",
        metavar="A,B",
        default=",".join(_DEFAULTS.free),
        help=f"of {', '.join(VARIABLES)} (patterns,amplitudes)",
    )
    group.add_argument(
        "--eyebox", metavar="WEIGHT", type=number(), default=0.0, help="even out the eyebox, e.g. 0.01 (0)"
    )
    group.add_argument(
        "--pupils",
        metavar="ROWSxCOLUMNS:SPACING",
        help="places of the eye's pupil from each of which the target counts, e.g. 3x3:0.8mm; random:4:0.8mm: four "
        "places within this radius, drawn anew in each iteration",
    )
    group.add_argument(
        "--chromatic",
        choices=CHROMATIC,
        default=CHROMATIC[0],
        help="ignore: optimise as if the eye had no chromatic aberration; the score is always what the eye sees",
    )
    group.add_argument("--region", metavar="X,Y,W,H", help="samples of the simulated picture that count; all if absent")
    group.add_argument(
        "--margin", metavar="N", type=whole(0), default=0, help="samples at every border that don't count"
    )
    group.add_argument("--plane-weights", metavar="A,B,…", help="how much each plane counts; equal if absent")
    group.add_argument("--wavelength-range", metavar="NM", nargs=2, type=number(), default=(440.0, 660.0))
    group.add_argument(
        "--wavelength-spacing", metavar="NM", type=number(), default=4.0, help="least, of free wavelengths"
    )


def _add_running(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--iterations", type=whole(1), default=_DEFAULTS.iterations)
    group.add_argument(
        "--step", metavar="RAD", type=number(), help="first step of the patterns' phase (0.5; with the camera 0.05)"
    )
    group.add_argument("--seed", type=parse_seed, default=0, help="of the random phase to begin with")
    group.add_argument(
        "--begin", choices=INITIAL_PATTERNS, default="random", help="smooth: less speckle, an emptier eyebox"
    )
    add_input(group, "--start", metavar="FILE", help="a hologram file whose patterns to begin with")
    group.add_argument(
        "--grid",
        choices=("compact", "preset"),
        default="compact",
        help="compact (default): padded just enough, about twice as fast; the score uses the preset's own grid",
    )
    group.add_argument("--device", default="auto", help="cpu, cuda, cuda:1, mps, or auto: the fastest there is")
    group.add_argument(
        "--sharded",
        action="store_true",
        help="share the lasers among the processes that torchrun started: torchrun --nproc-per-node 2 -m holoview "
        "optimise … --sharded; each takes a GPU of its own where there are",
    )
    group.add_argument(
        "--until-psnr", metavar="DB", type=number(0, 1000), default=math.inf, help="stop when it is this good"
    )
    group.add_argument(
        "--time", metavar="TIME", type=parse_duration, default=math.inf, help="stop after this long, e.g. 90s, 10min"
    )
    add_output(
        group,
        "--checkpoint",
        metavar="FILE",
        suffix=".safetensors",
        help="write all that goes on from here, now and then",
    )
    group.add_argument("--checkpoint-every", metavar="TIME", type=parse_duration, default=30.0, help="default 30s")
    add_input(group, "--resume", metavar="FILE", type=Path, help="go on from a checkpoint, and keep writing to it")
    add_output(
        group, "--preview", metavar="FILE", suffix=".png", help="PNG of the middle plane, rewritten while it runs"
    )
    add_output(
        group, "-o", "--output", metavar="FILE", suffix=".safetensors", help="hologram file to write (.safetensors)"
    )
    group.add_argument(
        "--drive-type",
        choices=("float32", "uint8"),
        default="float32",
        help="in the file; uint8: a quarter of the size, patterns rounded to 255ths of the stroke",
    )
    group.add_argument(
        "--score",
        nargs="+",
        choices=OPTIONAL_SCORES,
        default=[],
        help="further scores: FLIP, and ColorVideoVDP in JOD (take seconds a plane; need the extra perceptual)",
    )
    group.add_argument("--json", action="store_true", help="print the result as JSON")


def _add_rig(group: argparse._ArgumentGroup) -> None:
    add_input(
        group,
        "--rig",
        metavar="RIG.toml",
        help="optimise on this bench: pictures of its camera take the place of predicted ones; without --start the "
        "model alone optimises first. PRESET may be the rig's file",
    )
    group.add_argument(
        "--model-updates",
        metavar="N",
        type=whole(1),
        help="every N iterations, diagnose the pictures taken so far and add what they show to the model",
    )
    group.add_argument(
        "--update-effects",
        metavar="NAME",
        nargs="+",
        default=[],
        help="effects that these updates may add (default: all)",
    )


def require_no_rig_options(args: argparse.Namespace) -> None:
    """Raises UserError for options that need --rig."""
    for flag, value in (("--model-updates", args.model_updates), ("--update-effects", args.update_effects)):
        if value:
            raise UserError(flag, "without --rig", expected="a rig whose camera takes pictures")


def settings_from_args(args: argparse.Namespace, system: System, pupils: PupilPlaces) -> Settings:
    """The settings of the optimiser. Raises UserError for values outside their ranges."""
    low, high = args.wavelength_range
    weights = None if args.plane_weights is None else tuple(_parse_numbers(args.plane_weights, "--plane-weights"))
    settings = Settings(
        iterations=args.iterations,
        step_rad=_DEFAULTS.step_rad if args.step is None else args.step,
        seed=args.seed,
        free=tuple(name.strip() for name in args.free.split(",") if name.strip()),
        loss=args.loss,
        region=_region_or_margin(args, system),
        plane_weights=weights,
        eyebox=args.eyebox,
        begin=args.begin,
        wavelength_range_m=(low * 1e-9, high * 1e-9),
        wavelength_spacing_m=args.wavelength_spacing * 1e-9,
    )
    return pupils.in_settings(settings)


def _region_or_margin(args: argparse.Namespace, system: System) -> Region | None:
    """The region that --region or --margin describes; None for the whole image."""
    rows, columns = make_plan(system).grid.shape
    if args.region is not None:
        if args.margin:
            raise UserError("--margin with --region", "contradict each other", expected="one of them")
        return parse_region(args.region)
    if not 0 <= 2 * args.margin < min(rows, columns):
        raise UserError("--margin", str(args.margin), expected=f"0 to {(min(rows, columns) - 1) // 2} samples")
    margin = args.margin
    return (margin, margin, columns - 2 * margin, rows - 2 * margin) if margin else None


def _parse_numbers(text: str, flag: str) -> list[float]:
    """Numbers that are separated by commas. flag: for the error message."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UserError(flag, f'"{text}"', expected="numbers with commas between them") from error


def run_options_from_args(args: argparse.Namespace) -> RunOptions:
    """How to run. Raises UserError for limits that aren't positive and files that can't be read or written."""
    if not args.until_psnr > 0:
        raise UserError("--until-psnr", f"{args.until_psnr:g}", expected="a positive number")
    if args.resume and args.start:
        raise UserError("--resume with --start", "contradict each other", expected="one of them")
    checkpoint = args.checkpoint or args.resume
    device = resolve_torch_device(args.device)
    return RunOptions(
        grid=args.grid,
        device=device_for_rank(device) if args.sharded else device,
        sharded=args.sharded,
        initial_hologram=None if args.start is None else load_hologram(args.start),
        resume=None if args.resume is None or args.rig is not None else load_checkpoint(args.resume),
        checkpoint=checkpoint,
        checkpoint_interval_s=args.checkpoint_every,
        preview=args.preview,
        stop_psnr_db=args.until_psnr,
        time_limit_s=args.time,
    )
