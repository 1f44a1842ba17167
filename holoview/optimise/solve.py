"""The iteration: patterns by Adam inside the stroke, amplitudes in closed form, wavelengths along their gradient.

for state in iterate(system, stack, Settings(iterations=60)):
    print(state.iteration, state.psnr_db)
hologram = state.best          # whatever iteration it came from; stop at any time
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.errors import UserError
from holoview.hologram import Hologram
from holoview.optics.slots import check_drive
from holoview.optimise.checkpoint import Checkpoint, Progress, digest
from holoview.optimise.patterns import first_drive
from holoview.optimise.problem import Evaluation, Problem, Wanted
from holoview.optimise.settings import Settings
from holoview.optimise.state import State
from holoview.optimise.team import ALONE, Team
from holoview.optimise.unknowns import Unknowns
from holoview.system import System

_DEFAULT = Settings()


def iterate(
    system: System,
    stack: NDArray[np.floating],
    settings: Settings = _DEFAULT,
    start: NDArray[np.float32] | None = None,
    resume: Checkpoint | None = None,
    *,
    device: str = "cpu",
    team: Team = ALONE,
) -> Iterator[State]:
    """Optimises for a focal stack (plane, y, x, 3) in linear sRGB at the system's planes; a state an iteration.

    start: a drive (frame, modulator, y, x) to begin with; as the settings say when None. resume: a checkpoint to go on
    from, bit for bit on the same machine. device: of torch, "cpu", "cuda", "cuda:1", "mps". team: the processes that
    share the lasers; each is given the same arguments, and asks for as many states.
    Raises UserError when the stack, the drive or the checkpoint doesn't fit, and when memory runs out.
    """
    return _Solver(system, stack, settings, start, resume, device, team).states()


class _Solver:
    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating],
        settings: Settings,
        start: NDArray[np.float32] | None,
        resume: Checkpoint | None,
        device: str,
        team: Team,
    ) -> None:
        self.system, self.settings, self.target = system, settings, digest(stack)
        if resume is not None:
            resume.check(system, settings, self.target, "checkpoint")
        self.problem = Problem(system, stack, settings, device, team)
        drive = first_drive(system, settings) if start is None else torch.tensor(start, dtype=torch.float32)
        check_drive(self.problem.model.plan, drive)
        self.unknowns = Unknowns(system, settings, drive.to(device))
        self.best: Hologram | None = None
        self.progress = Progress(0, 0.0, math.inf, -math.inf, math.nan)
        if resume is not None:
            self._go_on(resume)
        elif self.unknowns.wavelengths_moved:
            self.problem.use_wavelengths(self.unknowns.wavelengths_m)

    def states(self) -> Iterator[State]:
        started = time.perf_counter() - self.progress.seconds
        for iteration in range(self.progress.iteration, self.settings.iterations + 1):
            shown = self.unknowns.patterns.shown()
            found = self._evaluate(shown, iteration)
            if not math.isfinite(found.loss):
                raise UserError(
                    "optimisation", f"the loss became {found.loss}", remedy="lower the step or check the target"
                )
            best = (self.progress.best_loss, self.progress.best_psnr_db)
            if found.loss < best[0] or self.best is None:
                best, self.best = (found.loss, found.psnr_db), self._hologram(shown)
            if iteration < self.settings.iterations and self.unknowns.move(found, iteration):
                self.problem.use_wavelengths(self.unknowns.wavelengths_m)
            eyebox = self.progress.eyebox if found.eyebox is None else found.eyebox
            self.progress = Progress(iteration + 1, time.perf_counter() - started, *best, eyebox)
            yield State(
                iteration=iteration,
                iterations=self.settings.iterations,
                loss=found.loss,
                psnr_db=found.psnr_db,
                best_psnr_db=best[1],
                eyebox=eyebox,
                seconds=self.progress.seconds,
                best=self.best,
                picture=found.picture,
                checkpoint=self._checkpoint,
            )

    def _evaluate(self, shown: torch.Tensor, iteration: int) -> Evaluation:
        """The iteration's evaluation; the last one is made twice, so that its amplitudes are the best for it."""
        unknowns, path_m = self.unknowns, self.unknowns.patterns.path_m(shown)
        wanted = unknowns.wanted(iteration)
        if iteration < self.settings.iterations:
            return self.problem.evaluate(path_m, unknowns.amplitudes, wanted)
        if wanted.amplitudes:
            found = self.problem.evaluate(path_m, unknowns.amplitudes, Wanted(amplitudes=True))
            assert found.solved is not None
            unknowns.amplitudes = found.solved
        return self.problem.evaluate(path_m, unknowns.amplitudes, Wanted(eyebox=True))

    def _hologram(self, shown: torch.Tensor) -> Hologram:
        changes = {"wavelengths": self.unknowns.wavelengths_m, "amplitudes": self.unknowns.amplitudes}
        return Hologram(shown.cpu().numpy().copy(), self.system.edit(changes))

    def _checkpoint(self) -> Checkpoint:
        assert self.best is not None
        best: dict[str, NDArray[np.floating]] = {
            "best_drive": self.best.drive,
            "best_amplitudes": np.array(self.best.system.amplitudes),
            "best_wavelengths": np.array(self.best.system.wavelengths_m),
        }
        return Checkpoint(self.system, self.settings, self.target, self.progress, self.unknowns.tensors() | best)

    def _go_on(self, resume: Checkpoint) -> None:
        kept = resume.tensors
        self.unknowns.load(kept)
        changes = {"wavelengths": kept["best_wavelengths"], "amplitudes": kept["best_amplitudes"]}
        self.best = Hologram(kept["best_drive"].astype(np.float32), self.system.edit(changes))
        self.progress = resume.progress
        self.problem.use_wavelengths(self.unknowns.wavelengths_m)
