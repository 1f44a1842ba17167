"""Iterations on a card, each recorded once as a CUDA graph and then repeated: one launch in place of some hundred.

An iteration that only moves the patterns is always the same operations on the same memory: upload of a few numbers,
evaluation, gradient, Adam's step, download of the loss. Launching them one by one takes the processor longer than the
card needs to compute them. The few numbers, and the loss, cross in pinned memory, without waiting for each other.

Iterations that solve for amplitudes, measure the eyebox or move wavelengths need the processor in between; they are
launched one by one, as all are on other devices.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import torch

from holoview.holograms.optimise.problem import EvaluationRequest, Floats, LossEvaluation, Problem
from holoview.holograms.optimise.variables import PatternVariables

Tensor = torch.Tensor
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
        self._replays: dict[tuple[int, ...], tuple[Replay, Tensor]] = {}
        self._has_failed = False
        target, (lasers, channels) = problem.objective.target, problem.weights_shape
        self._shown = torch.empty_like(patterns.drive)
        self._uploaded = target.new_empty(_STEP_NUMBERS + lasers * channels)
        self._numbers = _host_buffer(self._uploaded.shape, target)
        self._weights = self._uploaded[_STEP_NUMBERS:].view(lasers, channels)

    def take(
        self, shown: Tensor, amplitudes: Floats, request: EvaluationRequest, scale: float
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

    def _gradient(self, planes: tuple[int, ...]) -> tuple[Tensor, Tensor]:
        path_m = self._patterns.optical_path_m(self._shown)
        return self._problem.path_gradient(path_m, self._weights, planes)


def _host_buffer(shape: torch.Size, like: Tensor) -> Tensor:
    """Memory of the processor that a card copies from and to by itself."""
    return torch.empty(shape, dtype=like.dtype, pin_memory=like.device.type == "cuda" and torch.cuda.is_available())
