"""`holoview optimise PRESET TARGET`: patterns and laser amplitudes that show a target, as a hologram file."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from holoview.colour import to_srgb8
from holoview.commands.arguments import system_from_args, warn_of_camera_effects
from holoview.commands.console import deferred_interrupt, print_stderr, progress_bar
from holoview.commands.exit_codes import EXIT_INTERRUPTED
from holoview.commands.optimise_options import (
    RunOptions,
    TargetSource,
    add_options,
    run_options_from_args,
    settings_from_args,
)
from holoview.commands.optimise_score import format_scores, score_hologram
from holoview.commands.output_files import check_output_file
from holoview.io.hologram import Hologram
from holoview.io.png import write_png
from holoview.model.system import System
from holoview.optimise.iteration_state import IterationState
from holoview.optimise.memory import with_compact_grid
from holoview.optimise.process_group import SINGLE_PROCESS, ProcessGroup, torchrun_group
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.targets.focal_stack import Target
from holoview.util.errors import UserError
from holoview.util.progress import ProgressCallback

_PREVIEW_EVERY_S = 2.0


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_options(parser)


def run(args: argparse.Namespace) -> int:
    """Optimises, saves (also after Ctrl-C: the best so far), and scores on the preset's own grid."""
    system = system_from_args(args)
    warn_of_camera_effects(system)
    output = args.output or Path(f"{system.name or 'hologram'}-{Path(args.target).stem}.safetensors")
    check_output_file(output, ".safetensors")
    settings, how = settings_from_args(args, system), run_options_from_args(args)
    source = TargetSource(args, system)
    target = source.build()
    with torchrun_group(how.device) if how.sharded else nullcontext(SINGLE_PROCESS) as team:
        found = optimise_hologram(system, target, settings, how, team)
    if not team.is_main:
        return EXIT_INTERRUPTED if found.interrupted else 0
    found.hologram.save(output)
    if found.interrupted:
        print_stderr(f"interrupted after iteration {found.state.iteration}: the best so far is kept in {output}")
        return EXIT_INTERRUPTED
    _report(args, output, found, score_hologram(found.hologram, source, settings.region))
    return 0


@dataclass(frozen=True)
class OptimisationResult:
    """What an optimisation ended with; `interrupted` by Ctrl-C."""

    hologram: Hologram
    state: IterationState
    interrupted: bool


_DEFAULT_OPTIONS = RunOptions()


def optimise_hologram(
    system: System,
    target: Target,
    settings: Settings,
    options: RunOptions = _DEFAULT_OPTIONS,
    process_group: ProcessGroup = SINGLE_PROCESS,
) -> OptimisationResult:
    """Runs the optimisation under a progress bar; Ctrl-C ends it with the best so far, for the whole team.

    On the grid "compact" it pads by the walk-off only; the hologram keeps the system's own sampling.
    """
    on = with_compact_grid(system) if options.grid == "compact" else system
    state: IterationState | None = None
    start = None if options.initial_hologram is None else options.initial_hologram.drive
    interrupted = False
    with deferred_interrupt() as asked, _leader_progress(system, process_group) as report:
        saved = shown = time.monotonic()
        for state in iterate(
            on, target.stack, settings, start, options.resume, device=options.device, team=process_group
        ):
            report(state.iteration, state.iterations, _progress_note(state))
            interrupted = process_group.any_rank(asked())
            enough = (
                interrupted
                or state.best_psnr_db >= options.stop_psnr_db
                or process_group.any_rank(state.seconds >= options.time_limit_s)
            )
            ends = enough or state.iteration == state.iterations
            now = time.monotonic()
            if process_group.is_main and (ends or now - saved >= options.checkpoint_interval_s):
                _write_or_warn("checkpoint", options.checkpoint, state, lambda s, path: s.checkpoint().save(path))
                saved = now
            if process_group.is_main and (ends or state.iteration == 0 or now - shown >= _PREVIEW_EVERY_S):
                _write_or_warn("preview", options.preview, state, _write_preview)
                shown = now
            if enough:
                break
    if state is None:
        raise UserError("--resume", "the checkpoint is of a finished optimisation", expected="one with iterations left")
    best = state.best.system.edit({"propagation": system.sampling.propagation})
    return OptimisationResult(Hologram(state.best.drive, best), state, interrupted)


def _leader_progress(system: System, team: ProcessGroup) -> AbstractContextManager[ProgressCallback]:
    """A progress bar of the process that leads."""
    return progress_bar(f"optimising {system.name}") if team.is_main else nullcontext(lambda done, total, note: None)


def _progress_note(state: IterationState) -> str:
    return f"loss {state.loss:.4g} PSNR {state.best_psnr_db:.2f} dB eyebox variation {state.eyebox:.2f}"


def _write_or_warn(
    what: str, path: Path | None, state: IterationState, write: Callable[[IterationState, Path], None]
) -> None:
    """A file on the way that can't be written is no reason to lose the optimisation: the one before stays."""
    if path is None:
        return
    try:
        write(state, path)
    except UserError as error:
        print_stderr(f"note: no {what} after iteration {state.iteration}: {error}")


def _write_preview(state: IterationState, path: Path) -> None:
    texts = {"holoview.iteration": str(state.iteration), "holoview.psnr_db": f"{state.psnr_db:.2f}"}
    write_png(path, to_srgb8(state.picture()), texts)


def _report(args: argparse.Namespace, output: Path, found: OptimisationResult, scores: dict[str, Any] | str) -> None:
    """What was written and how good it is."""
    state, system = found.state, found.hologram.system
    if isinstance(scores, str):
        print_stderr(f"note: {output} is saved but can't be scored: {scores}")
        scores = {}
    wavelengths = [round(float(λ) * 1e9, 3) for λ in system.wavelengths_m]
    if args.json:
        table = {"preset": system.name, "file": str(output), "iterations": state.iteration}
        table |= {"seconds": round(state.seconds, 2), "loss": state.loss, "wavelengths_nm": wavelengths}
        print(json.dumps(table | scores, indent=2))
        return
    print(f"{output}: {state.iteration} iterations in {state.seconds:.1f} s")
    if "wavelengths" in args.free:
        print(f"wavelengths {', '.join(f'{λ:.1f}' for λ in wavelengths)} nm")
    for line in format_scores(scores, system):
        print(line)
    print(f"look at it: holoview render --hologram {output} -o seen.png")
