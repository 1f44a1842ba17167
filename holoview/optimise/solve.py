"""The iteration: patterns by Adam inside the modulator's stroke, laser amplitudes in closed form.

for state in iterate(system, stack, Settings(iterations=60)):
    print(state.iteration, state.psnr_db)
hologram = state.best          # whatever iteration it came from; stop at any time
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.hologram import Hologram
from holoview.optics.slm import nearest_level
from holoview.optics.slots import check_drive
from holoview.optimise.amplitudes import solve_amplitudes
from holoview.optimise.checkpoint import Checkpoint, Progress, digest
from holoview.optimise.memory import keeps_traces
from holoview.optimise.model import Model, Trace
from holoview.optimise.objective import Objective, make_objective
from holoview.optimise.settings import Settings
from holoview.plan import make_plan
from holoview.system import System

Tensor = torch.Tensor

_DEFAULT = Settings()


@dataclass(frozen=True)
class State:
    """Where the optimisation stands after an iteration; `best` is the hologram of least loss so far.

    checkpoint() gives all that continues from here; call it before the next state is asked for.
    """

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float
    seconds: float
    best: Hologram
    checkpoint: Callable[[], Checkpoint] = field(repr=False, compare=False)


def iterate(
    system: System,
    stack: NDArray[np.floating],
    settings: Settings = _DEFAULT,
    start: NDArray[np.float32] | None = None,
    resume: Checkpoint | None = None,
) -> Iterator[State]:
    """Optimises for a focal stack (plane, y, x, 3) in linear sRGB at the system's planes; a state an iteration.

    start: a drive (frame, modulator, y, x) to begin with; uniform random over the stroke when None. resume: a
    checkpoint to go on from, bit for bit. Raises UserError when the stack, the drive or the checkpoint doesn't fit.
    """
    return _Solver(system, stack, settings, start, resume).states()


class _Solver:
    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating],
        settings: Settings,
        start: NDArray[np.float32] | None,
        resume: Checkpoint | None,
    ) -> None:
        self.system, self.settings, self.target = system, settings, digest(stack)
        plan = make_plan(system)
        self.objective: Objective = make_objective(plan, stack)
        self.model = Model(plan)
        strokes = torch.tensor([modulator.stroke_m for modulator in system.modulators])
        self.stroke_m = strokes[None, :, None, None]
        middle = float(np.median(system.wavelengths_m))
        self.step = settings.step_rad * middle / (2 * math.pi * self.stroke_m)
        self.keep = keeps_traces(plan)
        if resume is None:
            self._begin(start)
        else:
            self._go_on(resume)
        check_drive(plan, self.drive)

    def _begin(self, start: NDArray[np.float32] | None) -> None:
        if start is None:
            generator = torch.Generator().manual_seed(self.settings.seed)
            self.drive = torch.rand(self.system.drive_shape, generator=generator)
        else:
            self.drive = torch.tensor(start, dtype=torch.float32)
        self.first, self.second = torch.zeros_like(self.drive), torch.zeros_like(self.drive)
        self.amplitudes = np.array(self.system.amplitudes)
        self.best: Hologram | None = None
        self.progress = Progress(0, 0.0, math.inf, -math.inf)

    def _go_on(self, resume: Checkpoint) -> None:
        resume.check(self.system, self.settings, self.target, "checkpoint")
        self.drive, self.first, self.second = (
            torch.from_numpy(resume.tensors[name].copy()) for name in ("drive", "first", "second")
        )
        self.amplitudes = resume.tensors["amplitudes"].astype(np.float64)
        best = self.system.edit({"amplitudes": resume.tensors["best_amplitudes"]})
        self.best = Hologram(resume.tensors["best_drive"].astype(np.float32), best)
        self.progress = resume.progress

    def states(self) -> Iterator[State]:
        started = time.perf_counter() - self.progress.seconds
        for iteration in range(self.progress.iteration, self.settings.iterations + 1):
            last = iteration == self.settings.iterations
            solving = last or iteration % self.settings.amplitudes_every == 0
            shown = self._shown()
            loss, psnr_db, gradient = self._evaluate(shown * self.stroke_m, solving, want_gradient=not last)
            if not math.isfinite(loss):
                raise UserError("optimisation", f"the loss became {loss}", remedy="lower the step or check the target")
            best = (self.progress.best_loss, self.progress.best_psnr_db)
            if loss < best[0] or self.best is None:
                best, self.best = (loss, psnr_db), self._hologram(shown)
            if gradient is not None:
                self._update(gradient, iteration)
            self.progress = Progress(iteration + 1, time.perf_counter() - started, *best)
            seconds = self.progress.seconds
            yield State(
                iteration, self.settings.iterations, loss, psnr_db, best[1], seconds, self.best, self._checkpoint
            )

    def _checkpoint(self) -> Checkpoint:
        assert self.best is not None
        tensors: dict[str, NDArray[np.floating]] = {
            "drive": self.drive.numpy().copy(),
            "first": self.first.numpy().copy(),
            "second": self.second.numpy().copy(),
            "best_drive": self.best.drive,
            "amplitudes": self.amplitudes.copy(),
            "best_amplitudes": np.array(self.best.system.amplitudes),
        }
        return Checkpoint(self.system, self.settings, self.target, self.progress, tensors)

    def _shown(self) -> Tensor:
        """The stroke fractions that the modulators really show for the current drive."""
        modulators = self.system.modulators
        return torch.stack(
            [nearest_level(self.drive[:, i], modulator) for i, modulator in enumerate(modulators)], dim=1
        )

    def _hologram(self, shown: Tensor) -> Hologram:
        return Hologram(shown.numpy().copy(), self.system.edit({"amplitudes": self.amplitudes}))

    def _evaluate(self, opd: Tensor, solving: bool, want_gradient: bool) -> tuple[float, float, Tensor | None]:
        """Loss, PSNR and ∂L/∂drive for optical paths (frame, modulator, y, x), amplitudes solved first if `solving`."""
        traces: dict[tuple[int, int], list[Trace]] = {}
        image = torch.zeros_like(self.objective.target)
        intensities: list[Tensor] = []
        for frame, λ in self.model.lasers:
            mine = self._traces(opd, frame, λ)
            intensity = self.model.intensity(mine)
            if self.keep and want_gradient:
                traces[frame, λ] = mine
            if solving:
                intensities.append(intensity)
            else:
                self._add(image, intensity, frame, λ)
        if solving:
            self._solve(intensities)
            for (frame, λ), intensity in zip(self.model.lasers, intensities, strict=True):
                self._add(image, intensity, frame, λ)
            intensities.clear()
        psnr_db = self.objective.psnr_db(image)
        residual = self.objective.residual(image)
        loss = self.objective.loss(residual)
        return loss, psnr_db, self._gradient(residual, opd, traces) if want_gradient else None

    def _traces(self, opd: Tensor, frame: int, λ: int) -> list[Trace]:
        return [self.model.trace(opd, frame, λ, source) for source in range(self.model.sources)]

    def _add(self, image: Tensor, intensity: Tensor, frame: int, λ: int) -> None:
        weight = float(self.amplitudes[frame, λ]) / self.system.frames
        for channel, colour in enumerate(self.objective.colours[λ].tolist()):
            image[:, channel].add_(intensity, alpha=weight * colour)

    def _solve(self, intensities: list[Tensor]) -> None:
        colours = torch.stack([self.objective.colours[λ] for _, λ in self.model.lasers]) / self.system.frames
        found = solve_amplitudes(intensities, colours, self.objective.target)
        self.amplitudes = np.zeros_like(self.amplitudes)
        for (frame, λ), amplitude in zip(self.model.lasers, found, strict=True):
            self.amplitudes[frame, λ] = amplitude

    def _gradient(self, residual: Tensor, opd: Tensor, traces: dict[tuple[int, int], list[Trace]]) -> Tensor:
        gradient = torch.zeros_like(self.drive)
        for frame, λ in self.model.lasers:
            weight = (
                2.0 / residual.numel() * float(self.amplitudes[frame, λ]) / (self.system.frames * self.model.sources)
            )
            if weight == 0.0:
                continue
            slope = self.objective.slope(residual, λ, weight)
            for trace in traces.pop((frame, λ), None) or self._traces(opd, frame, λ):
                self.model.backward(trace, slope, frame, λ, gradient)
        return gradient.mul_(self.stroke_m)

    def _update(self, gradient: Tensor, iteration: int) -> None:
        """Adam (Kingma & Ba, arXiv:1412.6980) with a cosine schedule, held inside the stroke."""
        beta1, beta2 = self.settings.betas
        self.first.mul_(beta1).add_(gradient, alpha=1 - beta1)
        self.second.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        mean = self.first / (1 - beta1 ** (iteration + 1))
        spread = (self.second / (1 - beta2 ** (iteration + 1))).sqrt_().add_(1e-20)
        fall = 0.5 * (1 + math.cos(math.pi * iteration / self.settings.iterations))
        self.drive = (self.drive - fall * self.step * mean / spread).clamp_(0, 1)
