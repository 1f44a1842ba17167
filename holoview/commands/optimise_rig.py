"""`holoview optimise PRESET|RIG TARGET --rig RIG.toml`: the hologram that looks best on a rig, by its camera."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.commands.arguments import default_output, system_from_args, warn_of_camera_effects
from holoview.commands.console import deferred_interrupt, print_json, print_stderr, progress_bar
from holoview.commands.optimise_files import IntermediateFiles
from holoview.commands.optimise_options import RunOptions, run_options_from_args, settings_from_args
from holoview.commands.optimise_target import TargetSource
from holoview.commands.output_files import ResultSaver, check_files
from holoview.experiment.camera_loop.bench_camera import BenchCamera
from holoview.experiment.camera_loop.camera_problem import require_camera_settings
from holoview.experiment.camera_loop.loop import (
    CameraLoop,
    LoopCheckpoint,
    LoopState,
    ModelUpdates,
    load_loop_checkpoint,
)
from holoview.experiment.rig_bench import on_rig, system_of_rig
from holoview.io.hologram import Hologram
from holoview.model.system import System
from holoview.optimise.eyes import PupilPlaces
from holoview.optimise.memory import require_optimisation_memory, with_compact_grid
from holoview.optimise.settings import Settings
from holoview.rig import RigDescription, open_rig, read_rig
from holoview.util.errors import UserError
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback

_STEP_RAD = 0.05  # a hologram that is nearly right isn't thrown away

OptimiseInModel = Callable[[System, NDArray[np.float32], Settings, RunOptions], tuple[Hologram, Interruption]]


@dataclass(frozen=True)
class _Task:
    """What is optimised, on which bench, and where it is kept. start: the first patterns. output: the hologram file."""

    rig: RigDescription
    system: System
    stack: NDArray[np.float32]
    settings: Settings
    options: RunOptions
    updates: ModelUpdates | None
    start: Hologram | None
    resume: LoopCheckpoint | None
    output: Path

    def save(self, hologram: Hologram, as_uint8: bool) -> Callable[[Path], None]:
        """Saves a hologram with the sampling of its bench."""
        sampled = hologram.system.edit({"propagation": self.system.sampling.propagation})
        return partial(Hologram(hologram.drive, sampled).save, as_uint8=as_uint8)


@dataclass
class _Outcome:
    """What a loop has reached: its first and latest states, and the PSNR of the best hologram in fresh pictures."""

    first: LoopState | None = None
    latest: LoopState | None = None
    fresh_psnr_db: float | None = None


def run_on_rig(args: argparse.Namespace, optimise_in_model: OptimiseInModel) -> int:
    """Runs the loop, saves the best hologram and prints what was measured.

    Whatever ends it early, a signal or a device that fails, the best so far and a checkpoint are kept, and lasers are
    off.
    """
    task = _task(args)
    if task.start is None and task.resume is None:
        options = replace(task.options, checkpoint=None, preview=None, stop_psnr_db=math.inf)
        hologram, interruption = optimise_in_model(task.system, task.stack, task.settings, options)
        task = replace(task, start=hologram)
        if interruption():
            _keep_best(args, task, hologram)
            return interruption.exit_code
    saver, outcome = ResultSaver(), _Outcome()
    with deferred_interrupt() as interruption:
        try:
            _run_loop(args, task, outcome, interruption)
        except (UserError, KeyboardInterrupt):
            if outcome.latest is not None:
                _keep_best(args, task, outcome.latest.best, outcome.latest)
            elif args.start is None and task.start is not None:
                _keep_best(args, task, task.start)
            raise
    assert outcome.latest is not None
    output = saver.save(task.output, task.save(outcome.latest.best, args.drive_type == "uint8"))
    if interruption():
        print_stderr(f"interrupted after iteration {outcome.latest.iteration}: the best so far is kept in {output}")
        return interruption.exit_code
    if args.checkpoint is None and task.options.checkpoint is not None and args.resume is None:
        task.options.checkpoint.unlink(missing_ok=True)
    _print_outcome(args, task, output, outcome)
    return saver.exit_code


def _task(args: argparse.Namespace) -> _Task:
    """Everything that is known before a device is opened. Raises UserError for what doesn't fit together."""
    rig = read_rig(args.rig)
    system = on_rig(system_from_args(args, system_of_rig(rig) if _is_same_file(args.preset, args.rig) else None), rig)
    if args.sharded:
        raise UserError("--sharded", "with --rig", expected="one process: there is one bench")
    if args.chromatic == "ignore" or args.pupils is not None:
        raise UserError("--chromatic/--pupils", "with --rig", expected="no eye: the camera stands in the focal planes")
    warn_of_camera_effects(system)
    output = args.output or default_output(system.name, Path(args.target).stem, ".safetensors")
    checkpoint = args.checkpoint or args.resume or output.with_name(f"{output.stem}.loop.safetensors")
    check_files(args, {"-o": [output], "--checkpoint": [checkpoint]})
    require_optimisation_memory(system)
    settings = settings_from_args(args, system, PupilPlaces())
    require_camera_settings(settings)
    options = replace(run_options_from_args(args), checkpoint=checkpoint)
    resume = None if args.resume is None else load_loop_checkpoint(args.resume)
    return _Task(
        rig=rig,
        system=system,
        stack=TargetSource(args, system).build().stack,
        settings=settings,
        options=options,
        updates=_updates(args),
        start=options.initial_hologram,
        resume=resume,
        output=output,
    )


def _updates(args: argparse.Namespace) -> ModelUpdates | None:
    if args.model_updates is None:
        if args.update_effects:
            raise UserError("--update-effects", "without --model-updates", expected="both")
        return None
    return ModelUpdates(args.model_updates, tuple(args.update_effects))


def _run_loop(args: argparse.Namespace, task: _Task, outcome: _Outcome, interruption: Interruption) -> None:
    """Opens the rig and runs the loop; what it reaches is in `outcome` even if it fails."""
    system = with_compact_grid(task.system) if task.options.grid == "compact" else task.system
    settings = replace(task.settings, step_rad=_STEP_RAD if args.step is None else args.step)
    start = None if task.start is None else task.start.drive
    files = IntermediateFiles(task.options)
    with open_rig(task.rig) as devices, progress_bar(f"camera in the loop on {task.rig.name}") as progress:
        loop = CameraLoop(
            system,
            task.stack,
            settings,
            task.rig,
            BenchCamera(task.rig, devices, tell=lambda text: print_stderr(f"note: {text}")),
            start,
            task.resume,
            task.updates,
            device=task.options.device,
            is_asked_to_end=interruption,
        )
        for state in loop.states():
            outcome.first, outcome.latest = outcome.first or state, state
            _tell(progress, state)
            stops = (
                interruption()
                or state.best_psnr_db >= task.options.stop_psnr_db
                or state.seconds >= task.options.time_limit_s
            )
            files.write_due(state, is_last=stops or state.iteration == state.iterations)
            if stops:
                break
        if outcome.latest is None:
            expected = "one with iterations left"
            raise UserError("--resume", "the checkpoint is of a finished optimisation", expected=expected)
        if not interruption():
            outcome.fresh_psnr_db = loop.measure(outcome.latest.best).psnr_db


def _tell(progress: ProgressCallback, state: LoopState) -> None:
    note = f"measured PSNR {state.psnr_db:.2f} dB, best {state.best_psnr_db:.2f} dB, {state.pictures} pictures"
    progress(state.iteration, state.iterations, f"{note} in {state.bench_s:.0f} s")
    for text in state.notes:
        print_stderr(f"note: {text}")


def _keep_best(args: argparse.Namespace, task: _Task, hologram: Hologram, state: LoopState | None = None) -> None:
    """Saves what there is before the program ends early."""
    output = ResultSaver().save(task.output, task.save(hologram, args.drive_type == "uint8"))
    print_stderr(f"the best so far is kept in {output}")
    if state is not None:
        IntermediateFiles(task.options).write_checkpoint(state)
        print_stderr(f"to go on: the same command with --resume {task.options.checkpoint}")


def _print_outcome(args: argparse.Namespace, task: _Task, output: Path, outcome: _Outcome) -> None:
    first, latest, fresh_db = outcome.first, outcome.latest, outcome.fresh_psnr_db
    assert first is not None and latest is not None and fresh_db is not None
    if args.json:
        table = {"preset": task.system.name, "rig": task.rig.name, "file": str(output), "iterations": latest.iteration}
        table |= {"pictures": latest.pictures, "bench_seconds": round(latest.bench_s, 2)}
        table |= {"seconds": round(latest.seconds, 2), "first_psnr_db": first.psnr_db, "psnr_db": fresh_db}
        print_json(table)
        return
    print(
        f"{output}: {latest.iteration} iterations, {latest.pictures} pictures in {latest.bench_s:.0f} s of bench time"
    )
    began = "at the start" if first.iteration == 0 else f"after iteration {first.iteration}"
    print(f"measured on {task.rig.name}: PSNR {first.psnr_db:.2f} dB {began}, {fresh_db:.2f} dB now (fresh pictures)")


def _is_same_file(first: str, second: str) -> bool:
    with suppress(OSError):
        return Path(first).samefile(second)
    return False
