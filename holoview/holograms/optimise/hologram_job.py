"""A whole optimisation: how it runs, when it ends, and the checkpoint and preview that it writes in the meantime.

result = optimise_hologram(system, stack, Settings(iterations=100), RunOptions(time_limit_s=60))
result.hologram.save(Path("hologram.safetensors"))
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.checkpoint import Checkpoint, IterationState
from holoview.holograms.optimise.eyes import StacksAt
from holoview.holograms.optimise.field_loss import ComplexTarget
from holoview.holograms.optimise.kernel_choice import will_compile
from holoview.holograms.optimise.memory import with_compact_grid
from holoview.holograms.optimise.named_methods import METHODS, describe_method, iterate_named
from holoview.holograms.optimise.parallel import SINGLE_PROCESS, ProcessGroup
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.colour import to_srgb8
from holoview.light.model.fields import (
    Choice,
    Duration,
    FileContent,
    Maybe,
    Number,
    Truth,
    Word,
    WrittenFile,
    described_field,
    flag_of,
    validate,
    with_field_docs,
)
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import checked_drive
from holoview.util.errors import UserError
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback, TextCallback, no_progress, no_text

_PREVIEW_INTERVAL_S = 2.0
_DEFAULT_SETTINGS = Settings()
_OF_ITERATIONS = ("iterations", "seed", "begin")  # settings that a closed form doesn't have


@with_field_docs
@dataclass(frozen=True)
class RunOptions:
    """How to run an optimisation. Raises UserError for values out of range.

    Fields:
    """

    method: str = described_field(
        Word(METHODS),
        "adam: the optimiser's own, which drives all modulators; double-phase (a closed form) and gerchberg-saxton, to "
        "compare with.",
        default=METHODS[0],
    )
    modulator: str = described_field(
        Choice(),
        "Which one double-phase or gerchberg-saxton drives, by its name in `holoview info`; the first if absent. The "
        "others stay as the start has them, or flat.",
        default="",
    )
    grid: str = described_field(
        Word(("compact", "preset")),
        "compact: padded by the walk-off of the light, about twice as fast; preset: as the bench says, which the score "
        "uses in any case.",
        default="compact",
    )
    device: str = described_field(
        Choice(),
        "Of torch: cpu, cuda, cuda:1, mps; on the command line also auto, the fastest there is.",
        default="cpu",
    )
    sharded: bool = described_field(
        Truth(),
        "Share the lasers among the processes that torchrun started: torchrun --nproc-per-node 2 -m holoview optimise "
        "… --sharded; each takes a GPU of its own where there are.",
        default=False,
    )
    initial_hologram: Hologram | None = described_field(
        FileContent(), "A hologram whose patterns to begin with.", flag="start", default=None
    )
    resume: Checkpoint | None = described_field(
        FileContent(), "A checkpoint to go on from; on the command line it is written to as well.", default=None
    )
    checkpoint: Path | None = described_field(
        WrittenFile(".safetensors"), "Write all that goes on from here, now and then.", default=None
    )
    checkpoint_interval_s: float = described_field(
        Duration(), "Least time between two checkpoints.", flag="checkpoint-every", default=30.0
    )
    preview: Path | None = described_field(
        WrittenFile(".png"), "PNG of the middle plane, rewritten while it runs.", default=None
    )
    stop_psnr_db: float | None = described_field(
        Maybe(Number(low=np.nextafter(0, 1), high=1000, words="a positive number, at most 1000")),
        "Stop when it is this good (dB).",
        flag="until-psnr",
        default=None,
    )
    time_limit_s: float = described_field(
        Duration(), "Stop after this long, e.g. 90s, 10min.", flag="time", default=math.inf
    )

    def __post_init__(self) -> None:
        validate(self, flag_of)

    def check_method(self, settings: Settings) -> None:
        """Raises UserError for options and settings that the method doesn't have."""
        if self.method == "adam":
            if self.modulator:
                expected = f"with --method {' or '.join(METHODS[1:])}; adam drives all modulators"
                raise UserError("--modulator", f'"{self.modulator}"', expected=expected)
            return
        given: dict[str, object] = {
            "--resume": self.resume,
            "--checkpoint": self.checkpoint,
            "--sharded": self.sharded,
            "--loss": settings.loss,
            "--free": settings.free != _DEFAULT_SETTINGS.free,
            "--eyebox": settings.eyebox,
            "--pupils": settings.pupil_places_m or settings.drawn_pupils,
            "--observers": settings.observers,
            "--drawn-planes": settings.drawn_planes is not None,
            "--step": settings.step_rad != _DEFAULT_SETTINGS.step_rad,
        }
        if self.method == "double-phase":
            given["--start"] = self.initial_hologram
            given |= {f"--{key}": getattr(settings, key) != getattr(_DEFAULT_SETTINGS, key) for key in _OF_ITERATIONS}
        if flags := [flag for flag, value in given.items() if value]:
            raise UserError(flags[0], f"with --method {self.method}", expected="no such option, or --method adam")

    def simulated(self, system: System) -> System:
        """The system with the grid on which the optimisation simulates."""
        return with_compact_grid(system) if self.grid == "compact" else system

    def is_enough(self, best_psnr_db: float, seconds: float) -> bool:
        """Whether a hologram of this PSNR, found in this time, ends the optimisation."""
        is_good = self.stop_psnr_db is not None and best_psnr_db >= self.stop_psnr_db
        return is_good or seconds >= self.time_limit_s


@dataclass(frozen=True)
class OptimisationResult:
    """The best hologram and the last state."""

    hologram: Hologram
    state: IterationState


_DEFAULT_RUN_OPTIONS = RunOptions()


def optimise_hologram(
    system: System,
    stack: NDArray[np.float32] | StacksAt | ComplexTarget,
    settings: Settings,
    options: RunOptions = _DEFAULT_RUN_OPTIONS,
    process_group: ProcessGroup = SINGLE_PROCESS,
    *,
    progress: ProgressCallback = no_progress,
    interruption: Interruption | None = None,
    tell: TextCallback = no_text,
) -> OptimisationResult:
    """Runs the optimisation for a focal stack (plane, y, x, 3), a complex target, or drawn places of the pupil.

    process_group: of the processes that share the lasers. An interruption or a limit in one of them ends the loop in
    all, after the same iteration; each of them then counts as interrupted. tell: called with the reason why a file
    couldn't be written.

    With `options.grid` "compact" the grid is padded by the walk-off only while optimising; the hologram has the
    system's own sampling. Raises UserError if the checkpoint to resume has no iteration left.
    """
    options.check_method(settings)
    simulated, resume, device = options.simulated(system), options.resume, options.device
    start = None
    if options.initial_hologram is not None:  # checked before anything is told or compiled
        start = checked_drive(simulated, options.initial_hologram.drive)
    tell_of_compiling(options.device, tell)
    progress(0 if resume is None else resume.progress.iteration, settings.iterations, "preparing the bench")
    if options.method == "adam":
        states = iterate(simulated, stack, settings, start, resume, device=device, team=process_group)
    else:
        if isinstance(stack, ComplexTarget):
            raise UserError(f"--method {options.method}", "with a complex target", expected="--method adam")
        assert not callable(stack)
        name, has_start = options.modulator, start is not None
        tell(describe_method(options.method, simulated, name, has_start=has_start))
        states = iterate_named(options.method, simulated, stack, settings, start, element=name, device=device)
    last = watch(states, options, process_group, progress, interruption or Interruption(), tell)
    if last is None:
        raise nothing_left()
    best = last.best.system.edit({"propagation": system.sampling.propagation})
    return OptimisationResult(Hologram(last.best.drive, best), last)


def tell_of_compiling(device: str, tell: TextCallback) -> None:
    """Tells beforehand that an optimisation compiles its loops."""
    if will_compile(device):
        tell("compiling the optimiser for this processor, once: about twenty seconds")


def watch(
    states: Iterable[IterationState],
    options: RunOptions,
    process_group: ProcessGroup,
    progress: ProgressCallback,
    interruption: Interruption,
    tell: TextCallback,
) -> IterationState | None:
    """Shows the progress of an optimisation and writes its files until it ends, is interrupted, or reaches a limit.

    Arguments as of `optimise_hologram`. Returns the last state; None where there is none.
    """
    files, state = IntermediateFiles(options, tell), None
    for state in states:
        progress(state.iteration, state.iterations, _progress_note(state))
        is_interrupted = process_group.any_rank(interruption())  # the same in all processes, whenever it came
        is_enough = process_group.any_rank(options.is_enough(state.best_psnr_db, state.seconds))
        stops = is_interrupted or is_enough
        if process_group.is_main:
            files.write_due(state, is_last=stops or state.iteration == state.iterations)
        if is_interrupted:
            interruption.ask()
        if stops:
            break
    return state


def nothing_left() -> UserError:
    """The error for a checkpoint without an iteration left."""
    return UserError("--resume", "the checkpoint is of a finished optimisation", expected="one with iterations left")


def _progress_note(state: IterationState) -> str:
    return f"loss {state.loss:.4g} PSNR {state.best_psnr_db:.2f} dB eyebox variation {state.eyebox:.2f}"


class _State(Protocol):
    """A state of the model's loop or of the camera's."""

    @property
    def iteration(self) -> int: ...
    @property
    def psnr_db(self) -> float: ...
    @property
    def picture(self) -> Callable[[], NDArray[np.floating]]: ...
    @property
    def checkpoint(self) -> Callable[[], Any]: ...


class IntermediateFiles:
    """Writes the checkpoint and the preview from time to time, as the options of a run say.

    A failure only calls `tell`, because it doesn't affect the optimisation.
    """

    def __init__(self, options: RunOptions, tell: TextCallback) -> None:
        self._options, self._tell = options, tell
        self._checkpoint_time = self._preview_time = time.monotonic()

    def write_due(self, state: _State, *, is_last: bool) -> None:
        """Writes the files whose interval is over, and all of them after the last iteration."""
        now = time.monotonic()
        if is_last or now - self._checkpoint_time >= self._options.checkpoint_interval_s:
            self.write_checkpoint(state)
            self._checkpoint_time = now
        if is_last or state.iteration == 0 or now - self._preview_time >= _PREVIEW_INTERVAL_S:
            self._write("preview", self._options.preview, state, _write_preview)
            self._preview_time = now

    def write_checkpoint(self, state: _State) -> None:
        """Writes the checkpoint if one was asked for."""
        self._write("checkpoint", self._options.checkpoint, state, lambda s, path: s.checkpoint().save(path))

    def _write(self, kind: str, path: Path | None, state: _State, write: Callable[[_State, Path], None]) -> None:
        if path is None:
            return
        try:
            write(state, path)
        except UserError as error:
            self._tell(f"no {kind} after iteration {state.iteration}: {error}")


def _write_preview(state: _State, path: Path) -> None:
    texts = {"holoview.iteration": str(state.iteration), "holoview.psnr_db": f"{state.psnr_db:.2f}"}
    write_png(path, to_srgb8(state.picture()), texts)
