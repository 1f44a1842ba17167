"""`holoview optimise PRESET TARGET`: finds patterns and laser amplitudes that show a target; writes a hologram file.

With `--rig RIG.toml` the pictures of a rig's camera take the place of predicted ones.
"""

from __future__ import annotations

import argparse
import io
import re
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from holoview.commands.arguments import (
    add_fields,
    add_framing,
    add_system,
    default_output,
    given_fields,
    parse_region,
    system_from_args,
    warn_of_camera_effects,
    warn_of_limits,
    whole,
)
from holoview.commands.console import deferred_interrupt, print_json, print_stderr, progress_bar
from holoview.commands.output_files import (
    ResultSaver,
    add_input,
    add_output,
    check_files,
    check_folder,
    check_suffix,
    hold_outputs,
)
from holoview.holograms.fields.field_target import FieldTarget
from holoview.holograms.files.request import ReadRequest
from holoview.holograms.hologram import Hologram, load_hologram
from holoview.holograms.load_field import is_field_file, open_hologram
from holoview.holograms.metrics.image_quality import PLACE_SCORES, render_for_score, score_hologram, score_places
from holoview.holograms.metrics.perceptual_scores import OPTIONAL_SCORES, PERCEPTUAL_SCORES, require_scores
from holoview.holograms.optimise.checkpoint import IterationState, load_checkpoint
from holoview.holograms.optimise.eyes import OptimisedEyes, PupilPlaces, StacksAt, target_at_places
from holoview.holograms.optimise.field_loss import ComplexTarget
from holoview.holograms.optimise.film import FilmJob, optimise_film
from holoview.holograms.optimise.hologram_job import (
    IntermediateFiles,
    OptimisationResult,
    RunOptions,
    optimise_hologram,
)
from holoview.holograms.optimise.learned_mask import ENOUGH_PICTURES, check_learnable, learn_mask
from holoview.holograms.optimise.memory import require_optimisation_memory
from holoview.holograms.optimise.named_methods import METHODS
from holoview.holograms.optimise.parallel import (
    SINGLE_PROCESS,
    ProcessGroup,
    device_for_rank,
    resolve_torch_device,
    torchrun_group,
)
from holoview.holograms.optimise.settings import (
    CAMERA_STEP_RAD,
    FIELD_LOSS,
    FIELD_LOSS_DOC,
    FIRST_ITERATIONS,
    NEXT_ITERATIONS,
    Settings,
)
from holoview.holograms.optimise.solve import load_beside
from holoview.holograms.targets.focal_stack import Film, is_video
from holoview.holograms.targets.framing import FILL
from holoview.holograms.targets.light_field import ViewGrid
from holoview.holograms.targets.target import Placement, target_for
from holoview.holograms.targets.target_source import TargetFile, TargetLight, TargetSource
from holoview.light.model.chain_numbers import flattered_by
from holoview.light.model.elements import ElementsField, Mask, PhaseModulator
from holoview.light.model.fields import fields_by_key
from holoview.light.model.focus import parse_plane, plane_label, required_eye
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import exceeded_limits
from holoview.light.numerics.sampling import Region
from holoview.light.numerics.structural_similarity import WEIGHTS
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.processes import Interruption

if TYPE_CHECKING:
    from holoview.bench.experiment.camera_loop import CameraLoopState, ModelUpdates, RigJob, RigOutcome

_DEFAULTS = Settings()
_VIEWS = re.compile(r"(?P<rows>\d{1,2})x(?P<columns>\d{1,2})(:(?P<spacing>.+))?")


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_system(parser)
    _add_target(parser.add_argument_group("target"))
    _add_objective(parser.add_argument_group("what is sought"))
    _add_running(parser.add_argument_group("running"))
    _add_result(parser.add_argument_group("result"))
    _add_rig(parser.add_argument_group("camera in the loop"))


def run(args: argparse.Namespace) -> int:
    """Optimises, saves and scores the hologram. After Ctrl-C it saves the best so far, without a score."""
    is_film = args.film or is_video(Path(args.target))
    if args.method != METHODS[0] and (args.rig is not None or is_film):
        where = "--rig" if args.rig is not None else "a film"
        raise UserError(f"--method {args.method}", f"with {where}", expected=f"--method {METHODS[0]}")
    if args.loss == FIELD_LOSS and (args.rig is not None or is_film or args.method != METHODS[0]):
        where = "--rig" if args.rig is not None else "a film" if is_film else f"--method {args.method}"
        raise UserError(f"--loss {FIELD_LOSS}", f"with {where}", expected="a field as the target, and --method adam")
    if args.rig is not None:
        return _run_on_rig(args)
    for flag, value in (("--model-updates", args.model_updates), ("--update-effects", args.update_effects)):
        if value:
            raise UserError(flag, "without --rig", expected="a rig whose camera takes pictures")
    if args.learn:
        return _run_learning(args)
    if is_film:
        return _run_on_film(args)
    system = system_from_args(args)
    warn_of_camera_effects(system)
    require_scores(args.score)
    output = args.output or default_output(system.name, Path(args.target).stem, ".safetensors")
    check_suffix(output, ".safetensors")
    check_files(args, {"-o": [output], "--resume": [args.resume] if args.resume and not args.checkpoint else []})
    require_optimisation_memory(system)
    eyes = OptimisedEyes(**given_fields(args, OptimisedEyes))
    pupils = eyes.places_in(system)
    settings, options = _settings(args, system, pupils), _run_options(args)
    options.check_method(settings)
    source = _target_source(args, system, 0.0 if system.eye is None else pupils.reach_m(system.eye))
    aimed = eyes.aimed(system)
    with progress_bar("building the target") as progress:
        progress(0, 1, "")
        if options.method == METHODS[0] and not aimed.is_chain:
            load_beside(options.device)
        stack: NDArray[np.float32] | StacksAt | ComplexTarget = target_at_places(source, aimed, pupils)
        if args.loss == FIELD_LOSS:
            stack = _complex_target(args, source, aimed)
    with torchrun_group(options.device) if options.sharded else nullcontext(SINGLE_PROCESS) as group:
        result, interruption = optimise_with_progress(aimed, stack, settings, options, group)
    if not group.is_main:
        return interruption.exit_code
    saver = ResultSaver()
    hologram = Hologram(result.hologram.drive, result.hologram.system.with_(eye=system.eye))
    output = saver.save(output, partial(hologram.save, as_uint8=args.drive_type == "uint8"))
    warn_of_limits(exceeded_limits(make_plan(system)))
    if interruption():
        print_stderr(f"interrupted after iteration {result.state.iteration}: the best so far is kept in {output}")
        return interruption.exit_code
    saved = load_hologram(output)
    images = render_for_score(saved, source)
    try:
        scores = score_hologram(saved, images, settings.region, args.score)
        scores |= score_places(saved, source, pupils, settings.region)
    except UserError as error:
        print_stderr(f"note: {output} is saved but can't be scored: {error}")
        scores = {}
    _print_result(args, output, hologram.system, result.state, scores)
    return saver.exit_code


def optimise_with_progress(
    system: System,
    stack: NDArray[np.float32] | StacksAt | ComplexTarget,
    settings: Settings,
    options: RunOptions,
    group: ProcessGroup = SINGLE_PROCESS,
) -> tuple[OptimisationResult, Interruption]:
    """`optimise_hologram` with a progress bar in the main process; Ctrl-C ends it after an iteration.

    Returns what it has found, and whether a signal came.
    """
    bar = progress_bar(f"optimising {system.name}") if group.is_main else nullcontext(lambda done, total, note: None)
    with deferred_interrupt() as interruption, bar as progress:
        result = optimise_hologram(
            system, stack, settings, options, group, progress=progress, interruption=interruption, tell=_note
        )
    return result, interruption


def _note(text: str) -> None:
    print_stderr(f"note: {text}")


# --- arguments ---


def _add_target(group: argparse._ArgumentGroup) -> None:
    add_input(
        group,
        "target",
        metavar="TARGET",
        help="a picture (PNG, JPEG, WebP, AVIF, TIFF, EXR), a focal stack (a folder, TIFF pages, EXR), a light field "
        "(a folder with views.toml), a complex field (its light in the planes), or a film (MP4 and others), of whose "
        "holograms each begins with the last one",
    )
    group.add_argument("--film", action="store_true", help="the folder TARGET holds the pictures of a film")
    group.add_argument(
        "--learn",
        metavar="NAME",
        help="train the pattern of element NAME, of kind phase with shared = true, for all pictures of the folder "
        "TARGET at once, and write it as a static mask: -o MASK.npy",
    )
    group.add_argument(
        "--next-iterations",
        metavar="N",
        type=whole(1),
        default=NEXT_ITERATIONS,
        help=f"of each picture of a film after the first ({NEXT_ITERATIONS})",
    )
    add_input(group, "--depth", metavar="FILE", help="depth map of the picture's size (PNG, NPY, EXR): 0 is nearest")
    add_framing(group)
    group.add_argument(
        "--at",
        metavar="DISTANCE",
        help="where a picture without depth stands, or views have no disparity; the middle plane if absent; of a field "
        "its plane, the last modulator if absent",
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
    add_fields(group, TargetLight, *fields_by_key(TargetLight))


def _add_objective(group: argparse._ArgumentGroup) -> None:
    notes = {"loss": f" {FIELD_LOSS}: {FIELD_LOSS_DOC}"}
    add_fields(group, Settings, "loss", more_words=(FIELD_LOSS,), notes=notes)
    add_fields(group, Settings, "free", "eyebox", "drawn_planes", "plane_weights", "region")
    add_fields(group, Settings, "wavelength_range", "wavelength_spacing", "observers", "agreement")
    add_fields(group, OptimisedEyes, "pupils", "chromatic")
    group.add_argument(
        "--margin", metavar="N", type=whole(0), default=0, help="samples at every border that don't count"
    )


def _add_running(group: argparse._ArgumentGroup) -> None:
    step = f"; {CAMERA_STEP_RAD} with the camera"
    notes = {"iterations": f"; {FIRST_ITERATIONS} of a film's first picture", "step": step}
    add_fields(group, Settings, "iterations", "step", "seed", "begin", notes=notes)
    defaults = {"method": METHODS[0], "device": "auto"}
    add_fields(group, RunOptions, *fields_by_key(RunOptions), defaults=defaults)


def _add_result(group: argparse._ArgumentGroup) -> None:
    add_output(
        group,
        "-o",
        "--output",
        metavar="FILE",
        suffix="",
        help="hologram file to write (.safetensors); of a film, a folder",
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


def _settings(
    args: argparse.Namespace, system: System, pupils: PupilPlaces, iterations: int = _DEFAULTS.iterations
) -> Settings:
    """The settings of the optimiser. Raises UserError for values outside their ranges.

    iterations: where the arguments don't say how many.
    """
    loss = None if args.loss == FIELD_LOSS else args.loss
    given = given_fields(args, Settings, {"region": _region_or_margin(args, system), "loss": loss})
    return pupils.in_settings(Settings(**{"iterations": iterations} | given))


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


def _run_options(args: argparse.Namespace) -> RunOptions:
    """How to run. Raises UserError for limits that aren't positive and files that can't be read or written."""
    if args.resume and args.start:
        raise UserError("--resume with --start", "contradict each other", expected="one of them")
    device = resolve_torch_device(args.device)
    given = given_fields(args, RunOptions) | {
        "device": device_for_rank(device) if args.sharded else device,
        "initial_hologram": None if args.start is None else load_hologram(args.start),
        "resume": None if args.resume is None or args.rig is not None else load_checkpoint(args.resume),
        "checkpoint": args.checkpoint or args.resume,
    }
    return RunOptions(**given)


def _target_source(args: argparse.Namespace, system: System, reach_m: float = 0.0) -> TargetSource:
    """The target that the arguments describe, seen from at most `reach_m` beside the pupil's place.

    Raises UserError for arguments that contradict each other and files that can't be read.
    """
    if args.depth is None and (args.near is not None or args.far is not None):
        raise UserError("--near/--far", "without --depth", expected="a depth map, or --at for one distance")
    file = TargetFile(args.target, grid=_parse_view_grid(args.views, system), **given_fields(args, TargetLight))
    if args.framing != FILL and (is_field_file(Path(args.target)) or file.has_views or file.is_stack):
        raise UserError("--framing", "with views, a focal stack or a field", expected="a picture, or no framing")
    if is_field_file(Path(args.target)):
        return TargetSource(system, file, _note, reach_m, _field_scene(args))
    if file.is_stack and (args.depth is not None or args.at is not None or file.grid is not None):
        raise UserError("--depth/--at/--views", "with a focal stack", expected="a picture, or none of them")
    if file.has_views:
        if args.depth is not None:
            raise UserError("--depth", "with a folder of views", expected="a picture, or no depth map")
        file = replace(file, zero_m=None if args.at is None else parse_plane(system, args.at, "--at"))
    else:
        at_m, near_m, far_m = (_parse_length(args, flag) for flag in ("at", "near", "far"))
        file = replace(file, placement=Placement(at_m, args.depth, near_m, far_m, args.framing))
    return TargetSource(system, file, _note, reach_m)


def _complex_target(args: argparse.Namespace, source: TargetSource, system: System) -> ComplexTarget:
    """The fields that --loss field compares. Raises UserError for a target that isn't a field."""
    if not isinstance(source.scene, FieldTarget):
        raise UserError(f"--loss {FIELD_LOSS}", f"with {args.target}", expected="a complex field as the target")
    target = ComplexTarget.of(source.scene, system)
    return replace(target, stack=target.stack * np.float32(_light(args).brightness))


def _light(args: argparse.Namespace) -> TargetLight:
    return TargetLight(**given_fields(args, TargetLight))


def _field_scene(args: argparse.Namespace) -> FieldTarget:
    """The light of the field in the target's file. Raises UserError for options that don't suit it."""
    for flag in ("depth", "views"):
        if getattr(args, flag) is not None:
            raise UserError(f"--{flag}", "with a field", expected="a picture, or --at for the field's plane")
    opened = open_hologram([args.target], ReadRequest(propagation="asm"))
    for note in opened.notes:
        _note(f"{args.target}: {note}")
    return opened.hologram.scene(_parse_length(args, "at") or 0.0)


def _parse_length(args: argparse.Namespace, flag: str) -> float | None:
    text = getattr(args, flag)
    return None if text is None else units.parse(text, f"--{flag}")


def _parse_view_grid(text: str | None, system: System) -> ViewGrid | None:
    """The grid of viewpoints about the pupil of a system's eye, from text such as "7x7:0.5mm" or "7x7"; None for None.

    Raises UserError for text of another form, and without an eye.
    """
    if text is None:
        return None
    match = _VIEWS.fullmatch(text)
    if match is None:
        raise UserError("--views", f'"{text}"', expected="rows x columns, and perhaps their spacing, e.g. 7x7:0.5mm")
    eye = required_eye(system, "--views")
    spacing = None if match["spacing"] is None else units.parse(match["spacing"], "--views")
    try:
        return ViewGrid(int(match["rows"]), int(match["columns"]), spacing, eye.pupil_y_m, eye.pupil_x_m)
    except UserError as error:
        raise error.inside("--views: ") from error


# --- a film ---


_NOT_OF_FILMS = ("depth", "near", "far", "views", "pupils", "start", "checkpoint", "resume", "preview", "score")


def _run_on_film(args: argparse.Namespace) -> int:
    """Writes a hologram for each picture. After Ctrl-C, those that are done are kept; the same command goes on."""
    job, film, placement = _film_job(args)
    stacks = _stacks_of(args, job.system, film, placement)
    started = time.monotonic()
    with deferred_interrupt() as interruption, progress_bar(f"optimising {job.system.name}") as progress:
        found_db = optimise_film(job, stacks, progress=progress, interruption=interruption, tell=_note)
    seconds = time.monotonic() - started
    table = {"folder": str(job.folder), "holograms": len(found_db), "seconds": seconds, "psnr_db": found_db}
    if args.json:
        print_json(table)
    else:
        mean = f", PSNR {np.mean(found_db):.2f} dB in the mean" if found_db else ""
        print(f"{job.folder}: {len(found_db)} holograms in {seconds:.1f} s{mean}")
    if interruption():
        print_stderr(f"interrupted: what is done is kept in {job.folder}; the same command goes on")
    return interruption.exit_code


def _stacks_of(
    args: argparse.Namespace, system: System, film: Film, placement: Placement
) -> Iterator[NDArray[np.float32]]:
    """The focal stack of each picture, one after the other."""
    light = _light(args)
    for picture in film.pictures():
        yield target_for(system, picture, placement, light.brightness, saturation=light.saturation).stack


def _film_job(args: argparse.Namespace) -> tuple[FilmJob, Film, Placement]:
    """The job, its film and where the pictures stand. Raises UserError for options that a film doesn't have."""
    given = [name for name in _NOT_OF_FILMS if getattr(args, name)]
    if given or args.sharded or args.chromatic == "ignore":
        flag = f"--{given[0]}" if given else "--sharded" if args.sharded else "--chromatic"
        raise UserError(flag, "with a film", expected="a picture as the target, or no such option")
    if args.output is None:
        raise UserError("-o", "is missing", expected="a folder for the holograms of the film")
    system = system_from_args(args)
    check_files(args)
    check_folder(args.output)
    hold_outputs(args, [args.output])
    require_optimisation_memory(system)
    film = Film(Path(args.target), _light(args).space)
    job = FilmJob(
        system=system,
        settings=_settings(args, system, PupilPlaces(), FIRST_ITERATIONS),
        next_iterations=args.next_iterations,
        options=_run_options(args),
        folder=args.output,
        count=film.count,
        as_uint8=args.drive_type == "uint8",
    )
    make_folder(args.output)
    return job, film, Placement(at_m=_parse_length(args, "at"), framing=args.framing)


# --- a static mask for many pictures ---


def _run_learning(args: argparse.Namespace) -> int:
    """Writes the mask, and prints the element that holds it. After Ctrl-C it writes the best so far."""
    where = f"--learn {args.learn}"
    given = [name for name in _NOT_OF_FILMS if getattr(args, name)]
    if given or args.film or args.sharded or args.method != METHODS[0]:
        flag = "film" if args.film else given[0] if given else "sharded" if args.sharded else "method"
        raise UserError(f"--{flag}", f"with {where}", expected="a folder of pictures as the target, no such option")
    if args.output is None:
        raise UserError("-o", "is missing", expected="the mask to write, e.g. -o mask.npy")
    check_suffix(args.output, ".npy")
    check_files(args)
    system = system_from_args(args)
    check_learnable(system, args.learn)
    if not Path(args.target).is_dir():
        raise UserError(args.target, "isn't a folder", expected=f"a folder of pictures, for {where}")
    placement = Placement(at_m=_parse_length(args, "at"), framing=args.framing)
    film = Film(Path(args.target), _light(args).space)
    stacks = list(_stacks_of(args, system, film, placement))
    settings, device = _settings(args, system, PupilPlaces()), resolve_torch_device(args.device)
    with deferred_interrupt() as interruption, progress_bar(f"learning {args.learn}") as progress:
        for state in learn_mask(system, stacks, settings, args.learn, device=device):
            progress(state.iteration, state.iterations, f"PSNR {state.psnr_db.mean():.2f} dB")
            if interruption():
                break
    saver = ResultSaver()
    content = io.BytesIO()
    np.save(content, state.mask)
    output = saver.save(args.output, lambda path: write_file(path, content.getvalue()))
    element = dict(zip(system.element_names, system.elements, strict=True))[args.learn]
    assert isinstance(element, PhaseModulator)
    kept = {key: getattr(element, key) for key in ("name", "pitch_m", "shape", "offset_m", "stroke_m")}
    mask = Mask(**kept, file=str(output))
    psnr_db = {"mean": state.psnr_db.mean(), "least": state.psnr_db.min(), "greatest": state.psnr_db.max()}
    if args.json:
        found = {key: float(value) for key, value in psnr_db.items()}
        print_json({"mask": str(output), "pictures": len(stacks), "iterations": state.iteration, "psnr_db": found})
    else:
        words = f"PSNR {psnr_db['mean']:.2f} dB in the mean ({psnr_db['least']:.2f} to {psnr_db['greatest']:.2f})"
        print(f"{output}: a mask of {len(stacks)} pictures after {state.iteration} iterations, {words}; in a preset:\n")
        print(tomli_w.dumps({"elements": ElementsField().to_toml((mask,))}).strip())
    if len(stacks) < ENOUGH_PICTURES:
        _note(f"{len(stacks)} pictures: a mask of fewer than {ENOUGH_PICTURES} suits these better than others")
    return saver.exit_code or interruption.exit_code


# --- on a rig ---


def _run_on_rig(args: argparse.Namespace) -> int:
    """Runs the loop, saves the best hologram and prints what was measured.

    Whatever ends it early, a signal or a device that fails, the best so far and a checkpoint are kept, and lasers are
    off.
    """
    from holoview.bench.experiment.camera_loop import RigOutcome, run_on_rig, started_in_model

    job, output = _rig_job(args)
    if job.start is None and job.resume is None:
        with deferred_interrupt() as interruption, progress_bar(f"optimising {job.system.name}") as progress:
            job = started_in_model(job, progress, interruption)
        assert job.start is not None
        if interruption():
            _keep_best(args, job, output, job.start)
            return interruption.exit_code
    saver, outcome = ResultSaver(), RigOutcome()
    with deferred_interrupt() as interruption:
        try:
            with progress_bar(f"camera in the loop on {job.rig.name}") as progress:
                run_on_rig(job, outcome, progress, interruption, _note)
        except (UserError, KeyboardInterrupt):
            if outcome.latest is not None:
                _keep_best(args, job, output, outcome.latest.best, outcome.latest)
            elif args.start is None and job.start is not None:
                _keep_best(args, job, output, job.start)
            raise
    assert outcome.latest is not None
    output = _save(args, saver, job, output, outcome.latest.best)
    if interruption():
        print_stderr(f"interrupted after iteration {outcome.latest.iteration}: the best so far is kept in {output}")
        return interruption.exit_code
    if args.checkpoint is None and job.options.checkpoint is not None and args.resume is None:
        job.options.checkpoint.unlink(missing_ok=True)
    _print_outcome(args, job, output, outcome)
    return saver.exit_code


def _rig_job(args: argparse.Namespace) -> tuple[RigJob, Path]:
    """The job and the file of its hologram, with all that is known before a device is opened.

    Raises UserError for arguments, files and a rig that don't fit together.
    """
    from holoview.bench.experiment.camera_loop import RigJob, load_loop_checkpoint
    from holoview.bench.experiment.camera_problem import require_camera_settings
    from holoview.bench.experiment.rig_bench import on_rig, system_of_rig
    from holoview.bench.rig import read_rig

    rig = read_rig(args.rig)
    system = on_rig(system_from_args(args, system_of_rig(rig) if _is_same_file(args.preset, args.rig) else None), rig)
    if args.sharded:
        raise UserError("--sharded", "with --rig", expected="one process: there is one bench")
    if args.chromatic == "ignore" or args.pupils is not None:
        raise UserError("--chromatic/--pupils", "with --rig", expected="no eye: the camera stands in the focal planes")
    warn_of_camera_effects(system)
    output = args.output or default_output(system.name, Path(args.target).stem, ".safetensors")
    check_suffix(output, ".safetensors")
    checkpoint = args.checkpoint or args.resume or output.with_name(f"{output.stem}.loop.safetensors")
    check_files(args, {"-o": [output], "--checkpoint": [checkpoint]})
    require_optimisation_memory(system)
    settings = _settings(args, system, PupilPlaces())
    require_camera_settings(settings)
    options = replace(_run_options(args), checkpoint=checkpoint)
    job = RigJob(
        rig=rig,
        system=system,
        resume=None if args.resume is None else load_loop_checkpoint(args.resume),
        stack=_target_source(args, system).build().stack,
        settings=settings,
        options=options,
        step_rad=CAMERA_STEP_RAD if args.step is None else args.step,
        updates=_updates(args),
        start=options.initial_hologram,
    )
    return job, output


def _updates(args: argparse.Namespace) -> ModelUpdates | None:
    if args.model_updates is None:
        if args.update_effects:
            raise UserError("--update-effects", "without --model-updates", expected="both")
        return None
    from holoview.bench.experiment.camera_loop import ModelUpdates

    return ModelUpdates(args.model_updates, tuple(args.update_effects))


def _save(args: argparse.Namespace, saver: ResultSaver, job: RigJob, output: Path, hologram: Hologram) -> Path:
    """Saves a hologram with the sampling of its bench; returns where it is."""
    return saver.save(output, partial(job.with_own_sampling(hologram).save, as_uint8=args.drive_type == "uint8"))


def _keep_best(
    args: argparse.Namespace, job: RigJob, output: Path, hologram: Hologram, state: CameraLoopState | None = None
) -> None:
    """Saves what there is before the program ends early."""
    print_stderr(f"the best so far is kept in {_save(args, ResultSaver(), job, output, hologram)}")
    if state is not None:
        IntermediateFiles(job.options, _note).write_checkpoint(state)
        print_stderr(f"to go on: the same command with --resume {job.options.checkpoint}")


def _is_same_file(first: str, second: str) -> bool:
    with suppress(OSError):
        return Path(first).samefile(second)
    return False


# --- results as text ---


def _print_outcome(args: argparse.Namespace, job: RigJob, output: Path, outcome: RigOutcome) -> None:
    first, latest, fresh_db = outcome.first, outcome.latest, outcome.fresh_psnr_db
    assert first is not None and latest is not None and fresh_db is not None
    if args.json:
        table = {"preset": job.system.name, "rig": job.rig.name, "file": str(output), "iterations": latest.iteration}
        table |= {"pictures": latest.pictures, "bench_seconds": round(latest.bench_s, 2)}
        table |= {"seconds": round(latest.seconds, 2), "first_psnr_db": first.psnr_db, "psnr_db": fresh_db}
        print_json(table)
        return
    print(
        f"{output}: {latest.iteration} iterations, {latest.pictures} pictures in {latest.bench_s:.0f} s of bench time"
    )
    began = "at the start" if first.iteration == 0 else f"after iteration {first.iteration}"
    print(f"measured on {job.rig.name}: PSNR {first.psnr_db:.2f} dB {began}, {fresh_db:.2f} dB now (fresh pictures)")


def _print_result(
    args: argparse.Namespace, output: Path, system: System, state: IterationState, scores: dict[str, Any]
) -> None:
    """Prints the file that was written and its scores, as JSON or as text."""
    wavelengths = [round(float(λ) * 1e9, 3) for λ in system.wavelengths_m]
    if args.json:
        table = {"preset": system.name, "file": str(output), "iterations": state.iteration}
        table |= {"seconds": round(state.seconds, 2), "loss": state.loss, "wavelengths_nm": wavelengths}
        if system.is_chain:
            table["light_that_passes"] = state.light
        print_json(table | scores)
        return
    print(f"{output}: {state.iteration} iterations in {state.seconds:.1f} s")
    if "wavelengths" in (args.free or ""):
        print(f"wavelengths {', '.join(f'{λ:.1f}' for λ in wavelengths)} nm")
    for line in [*_format_scores(scores, system), *_format_place_scores(scores)]:
        print(line)
    if system.is_chain:
        print(f"light of the lasers that is in the picture: {state.light:.1%}")
        for sentence in flattered_by(system):
            print_stderr(f"note: {sentence}")
    print(f"look at it: holoview render --hologram {output} -o seen.png")


def _format_scores(scores: dict[str, Any], system: System) -> list[str]:
    """The scores of `score_hologram` as lines of text; none for no scores."""
    if not scores:
        return []
    lines = [
        f"PSNR {scores['psnr_db']:.2f} dB (linear sRGB, mean over planes, scored on the "
        f"{system.sampling.propagation} grid)"
    ]
    if scores["held_out_psnr_db"] is not None:
        where = ", ".join(plane_label(system, z * 1e-3, 4) for z in scores["held_out_planes_mm"])
        lines.append(f"between the planes ({where}): {scores['held_out_psnr_db']:.2f} dB")
    return [
        *lines,
        f"luminance PSNR {scores['psnr_luminance_db']:.2f} dB, mean CIEDE2000 {scores['delta_e']:.2f}"
        f"{_format_ms_ssim(scores)}",
        *_format_further(scores),
        f"speckle contrast withheld: {scores['speckle_withheld']}"
        if scores["speckle_withheld"]
        else f"speckle contrast {scores['speckle_contrast']:.3f}",
        f"eyebox: uniformity {scores['eyebox_uniformity']:.2f}, variation {scores['eyebox_variation']:.2f}",
    ]


def _format_ms_ssim(scores: dict[str, Any]) -> str:
    """MS-SSIM after a comma, and the number of scales where the picture is too small for all; "" without one."""
    if scores["ms_ssim"] is None:
        return ""
    count = scores["ms_ssim_scales"]
    return f", MS-SSIM {scores['ms_ssim']:.3f}" + (
        f" ({count} of {len(WEIGHTS)} scales)" if count < len(WEIGHTS) else ""
    )


def _format_further(scores: dict[str, Any]) -> list[str]:
    """The optional scores in a line; none without any."""
    texts = [PERCEPTUAL_SCORES[name].format(scores[name]) for name in OPTIONAL_SCORES if name in scores]
    return [", ".join(texts)] if texts else []


_PLACE_HEADINGS = dict(
    zip(
        PLACE_SCORES,
        ("from the pupil's places", "from places that weren't used", "from these, focused between the planes"),
        strict=True,
    )
)


def _format_place_scores(scores: dict[str, Any]) -> list[str]:
    """The scores of `score_places` as lines of text."""
    return [
        f"{what}: {np.mean(scores[key]):.2f} dB, {min(scores[key]):.2f} to {max(scores[key]):.2f}"
        for key, what in _PLACE_HEADINGS.items()
        if key in scores
    ]
