"""The optimisation loop: Adam steps on patterns, least squares for laser amplitudes, gradient steps on wavelengths.

for state in iterate(system, stack, Settings(iterations=60)):
    print(state.iteration, state.psnr_db)
hologram = state.best          # of the smallest loss so far; the loop may be left at any time
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib import import_module
from threading import Thread
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram
from holoview.holograms.optimise.chain_loop import ChainOptimiser, iterate_chain
from holoview.holograms.optimise.checkpoint import Checkpoint, CheckpointProgress, IterationState, target_digest
from holoview.holograms.optimise.eyes import StacksAt, drawn_pupils
from holoview.holograms.optimise.field_loss import ComplexTarget, split_target
from holoview.holograms.optimise.kernel_choice import (
    KernelTurn,
    iterations_beside,
    load_kernels,
    tell_of_turn,
    will_compile,
)
from holoview.holograms.optimise.parallel import SINGLE_PROCESS, ProcessGroup
from holoview.holograms.optimise.plane_turns import planes_in_turn
from holoview.holograms.optimise.problem import EvaluationRequest, Floats, LossEvaluation, Problem
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.holograms.optimise.settings import NEXT_ITERATIONS, Settings, next_settings
from holoview.holograms.optimise.variables import OptimisationVariables, PatternVariables, first_drive
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.progress import TextCallback, no_text

_DEFAULT = Settings()
_NOTHING_DONE = CheckpointProgress(0, 0.0, math.inf, -math.inf, math.nan)
_FEWEST_PLANES = 4  # of which one is drawn by default
LONG_RUN = 80
"""Iterations from which on one plane is drawn by default: in shorter runs noise doesn't average out."""


def iterate(
    system: System,
    stack: NDArray[np.floating] | StacksAt | ComplexTarget,
    settings: Settings = _DEFAULT,
    start: NDArray[np.float32] | None = None,
    resume: Checkpoint | None = None,
    *,
    done: int = 0,
    device: str = "cpu",
    team: ProcessGroup = SINGLE_PROCESS,
    record: bool = True,
    beside: TextCallback | None = None,
) -> Iterator[IterationState]:
    """Optimises patterns, and laser amplitudes and wavelengths where these are free, for a focal stack.

    Adam on the patterns with the analytic adjoint of the simulation (complex64); amplitudes by non-negative least
    squares; wavelengths by gradient steps. Scalar diffraction as in `simulate`; the optimum is a local one.

    system: the display. Its effects are optimised for, except those that split a laser or change its power.
    stack: (plane, y, x, 3) linear sRGB at the system's planes, on the simulation grid, (rows, columns) · `upsample`.
    `target_for` makes it. With `settings.pupil_places_m`, the stacks of all places one after the other, and with
    `settings.drawn_pupils` a function from places (y, x), m, to their stacks
    (`targets.moving_pupil.moving_target`). A `field_loss.ComplexTarget` has fields instead,
    of which phases count as well.
    settings: options of the optimiser.
    start: initial drive (frame, modulator, y, x) in 0…1 of the stroke, of a chain of elements as of `simulate`;
    `settings.begin` chooses it when None.
    resume: a checkpoint to continue from, bit for bit on the same machine.
    done: iterations of the plan that lie behind `start`, where there is no checkpoint: the first state has this number,
    and steps and planes are those that the whole plan has from there on. Adam's memory begins anew.
    device: of torch, "cpu", "cuda", "cuda:1" or "mps".
    team: the group of processes that share the lasers; each has to give the same arguments and request as many states.
    record: repeat iterations that only move patterns as CUDA graphs, on a card that can; False to compare with.
    beside: where kernels have yet to be compiled for this processor, begin by torch meanwhile, for a number of
    iterations that the size of the problem alone decides, and then wait if need be; called with what to tell a user,
    several times a second while it waits, and may raise. Compile first when None.

    Yields an `IterationState` after each iteration, `settings.iterations` + 1 of them: its `psnr_db` and `loss`, and
    `best`, the `Hologram` of the smallest loss so far of all planes; the latest one where pupils are drawn, since
    losses of different draws can't be compared. The loop may be left at any time. Raises UserError when the stack, the
    drive or the checkpoint doesn't fit, and when memory runs out.

    >>> import numpy as np
    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[16, 24], planes=["10 mm"])
    >>> stack = np.full((1, 32, 48, 3), 0.2, dtype=np.float32)
    >>> states = list(hv.iterate(system, stack, hv.Settings(iterations=10)))
    >>> len(states), states[-1].psnr_db > states[0].psnr_db, states[-1].best.drive.shape
    (11, True, (1, 2, 16, 24))
    """
    if not 0 <= done <= settings.iterations:
        raise UserError("done", str(done), expected=f"from 0 to the {settings.iterations} iterations of the plan")
    if system.is_chain:
        if team.size > 1:
            raise UserError("optimisation", "shared by processes, of a chain of elements", expected="one process")
        return iterate_chain(system, stack, settings, start, resume, device=device, done=done, beside=beside)
    return Optimiser(system, stack, settings, start, resume, device, team, record, done, beside).states()


def follow(
    system: System,
    stacks: Iterable[NDArray[np.floating]],
    settings: Settings = _DEFAULT,
    next_iterations: int = NEXT_ITERATIONS,
    start: NDArray[np.float32] | None = None,
    *,
    device: str = "cpu",
) -> Iterator[IterationState]:
    """Optimises for one focal stack after the other; each begins with the hologram before, and all that is prepared.

    stacks: as for `iterate`, all of one shape. A stack is asked for when the iterations of the one before are done, so
    that a generator may give what a camera sees then. settings: of the first one; `next_settings` of it for the others.
    Other arguments and errors as of `iterate`. The iterations count from 0 for each stack.
    """
    check_changing_target(settings)
    optimiser = None
    for stack in stacks:
        if optimiser is None:
            optimiser = optimiser_of(system, stack, settings, start, device)
        else:
            optimiser.go_on(stack, next_settings(settings, next_iterations), optimiser.best())
        yield from optimiser.states()


def optimiser_of(
    system: System, stack: NDArray[np.floating], settings: Settings, start: Any = None, device: str = "cpu"
) -> Optimiser | ChainOptimiser:
    """What optimises for a stack and can go on for others. Arguments as of `iterate`."""
    kind = ChainOptimiser if system.is_chain else Optimiser
    return kind(system, stack, settings, start, device=device)


def check_changing_target(settings: Settings) -> None:
    """Raises UserError for settings with which a target can't change."""
    if settings.drawn_pupils or "wavelengths" in settings.free:
        found = "drawn pupils" if settings.drawn_pupils else "free wavelengths"
        raise UserError("target", f"that changes, with {found}", expected="patterns and amplitudes")


def load_beside(device: str) -> None:
    """Begins to load, in a thread, what the first iteration needs and this module doesn't import.

    To be called before a target is built, most of which is done without Python's lock. Results are the same without it.
    """
    Thread(target=load_rest, args=(device,)).start()


def load_rest(device: str) -> None:
    """Loads what the first iteration needs and this module doesn't import."""
    with suppress(Exception):  # where something is missing, the optimisation says so
        import_module("scipy.optimize")
        load_kernels(device)


class Optimiser:
    """The state between two iterations: the problem, its variables, the best hologram and the progress."""

    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating] | StacksAt | ComplexTarget,
        settings: Settings,
        start: NDArray[np.float32] | None = None,
        resume: Checkpoint | None = None,
        device: str = "cpu",
        group: ProcessGroup = SINGLE_PROCESS,
        record: bool = True,
        done: int = 0,
        beside: TextCallback | None = None,
    ) -> None:
        """Arguments and errors as of `iterate`."""
        self.system, self.settings, self._tell = system, settings, beside or no_text
        drive = first_drive(system, settings, start)
        self._drawn = drawn_pupils(system, settings, stack)
        places, first = (None, stack) if self._drawn is None else self._drawn(0)
        assert not callable(first)
        self.target_digest = target_digest(*split_target(first))
        if resume is not None:
            resume.check_matches(system, settings, self.target_digest, "checkpoint")
        compiles = beside is not None and resume is None and group.size == 1 and will_compile(device)
        by_torch = compiles or (resume is not None and resume.progress.by_torch > resume.progress.iteration)
        kernels = TORCH_KERNELS if by_torch else None
        self.problem = Problem(system, first, settings, device, group, places_m=places, kernels=kernels)
        self.variables = OptimisationVariables(system, settings, drive.to(device))
        recorder = recorder_for(device) if record and "patterns" in settings.free else None
        self._graphed = None if recorder is None else GraphedStep(self.problem, self.variables.patterns, recorder)
        self._make_best: Callable[[], Hologram] | None = None
        self.progress = replace(_NOTHING_DONE, iteration=done)
        if compiles:
            self.progress = replace(self.progress, by_torch=done + self._beside)
            tell_of_turn(self._tell, self._beside, settings.iterations - done)
        if resume is not None:
            self._resume(resume)
        elif self.variables.wavelengths.adjusted:
            self.problem.set_wavelengths(self.variables.wavelengths.values_m)

    def best(self) -> Hologram:
        """The hologram of the smallest loss so far."""
        assert self._make_best is not None
        return self._make_best()

    def go_on(self, stack: NDArray[np.floating], settings: Settings, start: Hologram) -> None:
        """Begins again for another focal stack from a hologram of the same bench; only its amplitudes may differ.

        settings: other iterations and another step than before.
        """
        self.settings, self.target_digest = settings, target_digest(stack, None)
        self.problem.objective.set_stack(stack)
        self.variables.begin_again(settings, start)
        self._make_best, self.progress = None, _NOTHING_DONE

    def states(self) -> Iterator[IterationState]:
        """The states as of `iterate`, from the present one on."""
        started, by_torch = time.perf_counter() - self.progress.seconds, self.progress.by_torch
        turn = KernelTurn(str(self.problem.model.device), self._tell, by_torch)
        for iteration in range(self.progress.iteration, self.settings.iterations + 1):
            if turn.is_due(iteration):
                self.problem.change_kernels()
            if self._drawn is not None and iteration > 0:
                self.problem.see_from(*self._drawn(iteration))
            with self.problem.guarded():
                shown = self.variables.patterns.displayed_drive()
                request = self._request(iteration)
                evaluation = self._evaluate(shown, iteration, request)
                if not math.isfinite(evaluation.loss):
                    raise UserError(
                        "optimisation",
                        f"the loss became {evaluation.loss}",
                        remedy="lower the step or check the target",
                    )
                best = (self.progress.best_loss, self.progress.best_psnr_db)
                is_whole = request.planes is None
                if is_whole and (evaluation.loss < best[0] or self._drawn is not None):
                    best, self._make_best = (evaluation.loss, evaluation.psnr_db), self._maker_of(shown)
                assert self._make_best is not None  # the first iteration takes all planes
                if iteration < self.settings.iterations and self.variables.step(evaluation, iteration):
                    self.problem.set_wavelengths(self.variables.wavelengths.values_m)
            eyebox = self.progress.eyebox if evaluation.eyebox_variation is None else evaluation.eyebox_variation
            self.progress = CheckpointProgress(iteration + 1, time.perf_counter() - started, *best, eyebox, by_torch)
            yield IterationState(
                iteration=iteration,
                iterations=self.settings.iterations,
                loss=evaluation.loss,
                psnr_db=evaluation.psnr_db,
                best_psnr_db=best[1],
                eyebox=eyebox,
                seconds=self.progress.seconds,
                make_best=self._make_best,
                picture=evaluation.picture,
                checkpoint=self._checkpoint,
            )

    @property
    def _beside(self) -> int:
        """How many iterations torch computes in about the time in which another processor compiles."""
        model = self.problem.model
        samples = math.prod(model.plan.grid.padded) * len(model.lasers) * model.source_count
        return iterations_beside(samples * len(self.problem.objective.target))

    def _evaluate(self, shown: torch.Tensor, iteration: int, request: EvaluationRequest) -> LossEvaluation:
        """The evaluation of an iteration; in the first and the last, amplitudes are solved for before it.

        Otherwise the first gradient would be that of a picture of another brightness, and Adam would remember it.
        """
        variables, path_m = self.variables, self.variables.patterns.optical_path_m(shown)
        if request.optimal_amplitudes and iteration in (0, self.settings.iterations):
            solved = self.problem.evaluate(path_m, variables.amplitudes, EvaluationRequest(optimal_amplitudes=True))
            assert solved.optimal_amplitudes is not None
            variables.amplitudes = solved.optimal_amplitudes
            request = replace(request, optimal_amplitudes=False)
        if iteration < self.settings.iterations:
            taken = None
            if self._graphed is not None:
                scale = variables.wavelengths.pattern_step_scale(iteration)
                taken = self._graphed.take(shown, variables.amplitudes, request, scale)
            return taken or self.problem.evaluate(path_m, variables.amplitudes, request)
        return self.problem.evaluate(path_m, variables.amplitudes, EvaluationRequest(eyebox_variation=True))

    def _request(self, iteration: int) -> EvaluationRequest:
        """The quantities and the planes to evaluate in an iteration."""
        request, settings = self.variables.evaluation_request(iteration), self.settings
        if self._make_best is None or request.takes_all_planes:
            return request
        count, few = len(self.problem.objective.target), self._planes_at_a_time
        return replace(request, planes=planes_in_turn(iteration, settings.iterations, count, few, settings.seed))

    @property
    def _planes_at_a_time(self) -> int:
        """How many planes an early iteration takes; 0: all."""
        settings, count = self.settings, len(self.problem.objective.target)
        if settings.drawn_planes is not None:
            return settings.drawn_planes
        is_plain = count == len(self.system.planes_m) and settings.plane_weights is None
        return 1 if is_plain and count >= _FEWEST_PLANES and settings.iterations >= LONG_RUN else 0

    def _maker_of(self, shown: torch.Tensor) -> Callable[[], Hologram]:
        """Makes the hologram of present patterns when it is asked for, since few are; the same one each time."""
        changes = {"wavelengths": self.variables.wavelengths.values_m, "amplitudes": self.variables.amplitudes}
        return cache(lambda: Hologram(shown.cpu().numpy().copy(), self.system.edit(changes)))

    def _checkpoint(self) -> Checkpoint:
        hologram = self.best()
        best: dict[str, NDArray[np.floating]] = {
            "best_drive": hologram.drive,
            "best_amplitudes": np.array(hologram.system.amplitudes),
            "best_wavelengths": np.array(hologram.system.wavelengths_m),
        }
        return Checkpoint(
            self.system, self.settings, self.target_digest, self.progress, self.variables.state_dict() | best
        )

    def _resume(self, resume: Checkpoint) -> None:
        tensors = resume.tensors
        self.variables.load_state_dict(tensors)
        self._make_best = cache(resume.best)
        self.progress = resume.progress
        self.problem.set_wavelengths(self.variables.wavelengths.values_m)


# --- recorded steps ---
#
# Iterations on a card, each recorded once as a CUDA graph and then repeated: one launch in place of some hundred.
#
# An iteration that only moves the patterns is always the same operations on the same memory: upload of a few numbers,
# evaluation, gradient, Adam's step, download of the loss. Launching them one by one takes the processor longer than the
# card needs to compute them. The few numbers, and the loss, cross in pinned memory, without waiting for each other.
#
# Iterations that solve for amplitudes, measure the eyebox or move wavelengths need the processor in between; they are
# launched one by one, as all are on other devices.


Replay = Callable[[], None]
Record = Callable[[Callable[[], None]], Replay]
"""Records a function's operations on the device without running them, and returns what runs them to their end."""

_STEP_NUMBERS = 3  # of `PatternVariables.step_numbers`


class CudaRecorder:
    """Records functions as CUDA graphs that share their temporary memory, since they never run at the same time."""

    def __init__(self, device: str) -> None:
        self._device, self._pool = torch.device(device), torch.cuda.graph_pool_handle()

    def __call__(self, function: Callable[[], None]) -> Replay:
        """Records, without running it, and returns what runs it to its end."""
        graph = torch.cuda.CUDAGraph()
        # other threads, such as a viewer's, may go on using the card while this one records
        with (
            torch.cuda.device(self._device),
            torch.cuda.graph(graph, pool=self._pool, capture_error_mode="thread_local"),
        ):
            function()

        def replay() -> None:
            with torch.cuda.device(self._device):
                graph.replay()
                torch.cuda.current_stream().synchronize()

        return replay


def recorder_for(device: str) -> Record | None:
    """How to record on a device of torch; None where it can't record."""
    return CudaRecorder(device) if device.startswith("cuda") and torch.cuda.is_available() else None


class GraphedStep:
    """Steps of the patterns of a problem, one recording for each set of planes.

    Where a recording fails, a RuntimeWarning says why, and from then on nothing is recorded.
    """

    def __init__(self, problem: Problem, patterns: PatternVariables, record: Record) -> None:
        self._problem, self._patterns, self._record = problem, patterns, record
        self._replays: dict[tuple[int, ...], tuple[Replay, torch.Tensor]] = {}
        self._has_failed = False
        target, (lasers, channels) = problem.objective.target, problem.weights_shape
        self._shown = torch.empty_like(patterns.drive)
        self._uploaded = target.new_empty(_STEP_NUMBERS + lasers * channels)
        self._numbers = _host_buffer(self._uploaded.shape, target)
        self._weights = self._uploaded[_STEP_NUMBERS:].view(lasers, channels)

    def take(
        self, shown: torch.Tensor, amplitudes: Floats, request: EvaluationRequest, scale: float
    ) -> LossEvaluation | None:
        """Evaluates patterns (frame, modulator, y, x) and moves them; None, and no step, for any other request.

        amplitudes (frame, wavelength). scale: of the step, as in `PatternVariables.step`. The evaluation has no
        gradient, since its step is taken.
        """
        problem = self._problem
        if self._has_failed or not problem.is_fixed_work(request):
            return None
        planes = request.planes or tuple(range(len(problem.objective.target)))
        with problem.guarded():
            self._shown.copy_(shown)
            self._numbers[_STEP_NUMBERS:] = problem.image_weights(amplitudes).flatten()
            if planes not in self._replays and not self._recorded(planes):
                return None
            self._numbers[:_STEP_NUMBERS] = torch.tensor(self._patterns.step_numbers(scale), dtype=torch.float64)
            replay, norms = self._replays[planes]
            replay()
        return problem.plane_losses(norms, planes)

    def _recorded(self, planes: tuple[int, ...]) -> bool:
        """Records a step for some planes; False if that fails."""
        self._uploaded.copy_(self._numbers)
        norms, _ = self._gradient(planes)  # libraries make plans and take memory in their first calls
        on_host = _host_buffer(norms.shape, norms)

        def step() -> None:
            self._uploaded.copy_(self._numbers, non_blocking=True)
            norms, gradient = self._gradient(planes)
            self._patterns.move(gradient, self._uploaded[:_STEP_NUMBERS])
            on_host.copy_(norms, non_blocking=True)

        try:
            self._replays[planes] = self._record(step), on_host
        except RuntimeError as error:  # of a driver or a version of torch that can't record an operation
            reason = str(error).partition("\n")[0]
            warnings.warn(f"iterations aren't recorded as CUDA graphs: {reason}", RuntimeWarning, stacklevel=2)
            self._has_failed = True
        return not self._has_failed

    def _gradient(self, planes: tuple[int, ...]) -> tuple[torch.Tensor, torch.Tensor]:
        path_m = self._patterns.optical_path_m(self._shown)
        return self._problem.path_gradient(path_m, self._weights, planes)


def _host_buffer(shape: torch.Size, like: torch.Tensor) -> torch.Tensor:
    """Memory of the processor that a card copies from and to by itself."""
    return torch.empty(shape, dtype=like.dtype, pin_memory=like.device.type == "cuda" and torch.cuda.is_available())
