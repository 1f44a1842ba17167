"""`holoview optimise PRESET TARGET`: finds patterns and laser amplitudes that show a target; writes a hologram file."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.commands.arguments import default_output, system_from_args, warn_of_camera_effects, warn_of_limits
from holoview.commands.console import deferred_interrupt, print_json, print_stderr, progress_bar
from holoview.commands.optimise_files import IntermediateFiles
from holoview.commands.optimise_options import (
    RunOptions,
    add_options,
    require_no_rig_options,
    run_options_from_args,
    settings_from_args,
)
from holoview.commands.optimise_rig import run_on_rig
from holoview.commands.optimise_score import format_scores, render_for_score, score_hologram
from holoview.commands.optimise_target import TargetSource
from holoview.commands.output_files import ResultSaver, check_files
from holoview.commands.place_scores import format_place_scores, score_places
from holoview.io.hologram import Hologram, load_hologram
from holoview.metrics.perceptual_scores import require_scores
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.model.validity import exceeded_limits
from holoview.optimise.checkpoint import IterationState
from holoview.optimise.eyes import OptimisedEyes, StacksAt, target_at_places
from holoview.optimise.memory import require_optimisation_memory, with_compact_grid
from holoview.optimise.parallel import SINGLE_PROCESS, ProcessGroup, torchrun_group
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.util.errors import UserError
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_options(parser)


def run(args: argparse.Namespace) -> int:
    """Optimises, saves and scores the hologram. After Ctrl-C it saves the best so far, without a score."""
    if args.rig is not None:
        return run_on_rig(args, _optimise_in_model)
    require_no_rig_options(args)
    system = system_from_args(args)
    warn_of_camera_effects(system)
    require_scores(args.score)
    output = args.output or default_output(system.name, Path(args.target).stem, ".safetensors")
    check_files(args, {"-o": [output], "--resume": [args.resume] if args.resume and not args.checkpoint else []})
    require_optimisation_memory(system)
    eyes = OptimisedEyes.from_text(args.pupils, args.chromatic)
    pupils = eyes.places_in(system)
    settings, options = settings_from_args(args, system, pupils), run_options_from_args(args)
    source = TargetSource(args, system, 0.0 if system.eye is None else pupils.reach_m(system.eye))
    aimed = eyes.aimed(system)
    stack = target_at_places(source, aimed, pupils)
    with torchrun_group(options.device) if options.sharded else nullcontext(SINGLE_PROCESS) as group:
        result = optimise_hologram(aimed, stack, settings, options, group)
    result = replace(result, hologram=_seen_by_eye_of(system, result.hologram))
    if not group.is_main:
        return result.interruption.exit_code
    saver = ResultSaver()
    output = saver.save(output, partial(result.hologram.save, as_uint8=args.drive_type == "uint8"))
    warn_of_limits(exceeded_limits(make_plan(system)))
    if result.interruption():
        print_stderr(f"interrupted after iteration {result.state.iteration}: the best so far is kept in {output}")
        return result.interruption.exit_code
    saved = load_hologram(output)
    images = render_for_score(saved, source)
    try:
        scores = score_hologram(saved, images, settings.region, args.score)
        scores |= score_places(saved, source, pupils, settings.region)
    except UserError as error:
        print_stderr(f"note: {output} is saved but can't be scored: {error}")
        scores = {}
    _print_result(args, output, result, scores)
    return saver.exit_code


def _seen_by_eye_of(system: System, hologram: Hologram) -> Hologram:
    """The hologram on its own bench, with the eye of the system."""
    return Hologram(hologram.drive, hologram.system.with_(eye=system.eye))


@dataclass(frozen=True)
class OptimisationResult:
    """The best hologram, the last state, and what Ctrl-C or another signal did to the optimisation."""

    hologram: Hologram
    state: IterationState
    interruption: Interruption


_DEFAULT_RUN_OPTIONS = RunOptions()


def optimise_hologram(
    system: System,
    stack: NDArray[np.float32] | StacksAt,
    settings: Settings,
    options: RunOptions = _DEFAULT_RUN_OPTIONS,
    process_group: ProcessGroup = SINGLE_PROCESS,
) -> OptimisationResult:
    """Runs the optimisation for a focal stack (plane, y, x, 3), or for drawn places, with a progress bar.

    process_group: of the processes that share the lasers. Ctrl-C or a limit in one of them ends the loop in all, after
    the same iteration.

    With `options.grid` "compact" the grid is padded by the walk-off only while optimising; the hologram has the
    system's own sampling. Raises UserError if the checkpoint to resume has no iteration left.
    """
    optimised_system = with_compact_grid(system) if options.grid == "compact" else system
    start = None if options.initial_hologram is None else options.initial_hologram.drive
    files = IntermediateFiles(options)
    state: IterationState | None = None
    with deferred_interrupt() as interruption, _main_process_progress(system, process_group) as progress:
        for state in iterate(
            optimised_system, stack, settings, start, options.resume, device=options.device, team=process_group
        ):
            progress(state.iteration, state.iterations, _progress_note(state))
            is_interrupted = process_group.any_rank(interruption())  # the same in all, whatever comes in the meantime
            stops = (
                is_interrupted
                or state.best_psnr_db >= options.stop_psnr_db
                or process_group.any_rank(state.seconds >= options.time_limit_s)
            )
            if process_group.is_main:
                files.write_due(state, is_last=stops or state.iteration == state.iterations)
            if is_interrupted:
                interruption.ask()
            if stops:
                break
    if state is None:
        raise UserError("--resume", "the checkpoint is of a finished optimisation", expected="one with iterations left")
    best = state.best.system.edit({"propagation": system.sampling.propagation})
    return OptimisationResult(Hologram(state.best.drive, best), state, interruption)


def _optimise_in_model(
    system: System, stack: NDArray[np.float32], settings: Settings, options: RunOptions
) -> tuple[Hologram, Interruption]:
    """The hologram that the model alone finds, and what Ctrl-C did meanwhile."""
    result = optimise_hologram(system, stack, settings, options)
    return result.hologram, result.interruption


def _main_process_progress(system: System, group: ProcessGroup) -> AbstractContextManager[ProgressCallback]:
    """A progress bar in the main process, nothing in the others."""
    return progress_bar(f"optimising {system.name}") if group.is_main else nullcontext(lambda done, total, note: None)


def _progress_note(state: IterationState) -> str:
    return f"loss {state.loss:.4g} PSNR {state.best_psnr_db:.2f} dB eyebox variation {state.eyebox:.2f}"


def _print_result(args: argparse.Namespace, output: Path, result: OptimisationResult, scores: dict[str, Any]) -> None:
    """Prints the file that was written and its scores, as JSON or as text."""
    state, system = result.state, result.hologram.system
    wavelengths = [round(float(λ) * 1e9, 3) for λ in system.wavelengths_m]
    if args.json:
        table = {"preset": system.name, "file": str(output), "iterations": state.iteration}
        table |= {"seconds": round(state.seconds, 2), "loss": state.loss, "wavelengths_nm": wavelengths}
        print_json(table | scores)
        return
    print(f"{output}: {state.iteration} iterations in {state.seconds:.1f} s")
    if "wavelengths" in args.free:
        print(f"wavelengths {', '.join(f'{λ:.1f}' for λ in wavelengths)} nm")
    for line in [*format_scores(scores, system), *format_place_scores(scores)]:
        print(line)
    print(f"look at it: holoview render --hologram {output} -o seen.png")
