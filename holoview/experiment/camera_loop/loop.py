"""The loop: shows patterns, takes their pictures, and steps against the gradient at what was measured.

for state in camera_loop(system, stack, Settings(iterations=40), rig, camera, start=drive):
    print(state.iteration, state.psnr_db)      # measured
hologram = state.best

Patterns are rounded to the modulators' levels before they are shown, and gradients pass straight through the rounding
(Bengio et al., arXiv:1308.3432; `optimise.level_gradients`). A model that is wrong gives gradients that stop pointing
downhill before the optimum is reached. So where the measured loss hasn't fallen for three iterations, the loop goes
back to the best hologram and takes shorter steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.patterns import BLUR_SIGMAS_PX
from holoview.experiment.camera_loop.bench_camera import Picture, PictureSource, Shot
from holoview.experiment.camera_loop.bench_match import lasers_of, levels_of_drive, on_rig
from holoview.experiment.camera_loop.camera_problem import CameraProblem
from holoview.experiment.camera_loop.loop_checkpoint import LoopCheckpoint, LoopProgress
from holoview.experiment.camera_loop.model_update import ModelUpdates, update_model
from holoview.experiment.camera_loop.registration import PROBE_SIGMAS_PX, Registration, probe_levels, register
from holoview.io.hologram import Hologram
from holoview.model.system import System
from holoview.optimise.checkpoint import target_digest
from holoview.optimise.problem import EvaluationRequest, LossEvaluation
from holoview.optimise.settings import Settings
from holoview.optimise.variables import OptimisationVariables, initial_drive
from holoview.rig.description import RigDescription
from holoview.util.errors import UserError

_PATIENCE, _SHORTER = 3, 0.5  # iterations in which the loss doesn't fall, and the factor of steps that follows them
_UPDATE_SIGMAS_PX = BLUR_SIGMAS_PX * 2  # of the random patterns that updates of the model see beside holograms
_KEPT_PICTURES = 48  # of earlier holograms, for updates of the model


@dataclass(frozen=True)
class LoopState:
    """The state after an iteration.

    iteration, iterations: number of this one, from 0, and of the last. loss, psnr_db: measured, as those of
    `IterationState`. best_psnr_db, best: of the smallest loss so far. pictures, bench_s: taken, and bench time spent so
    far. notes: what happened since the state before. picture(): what the camera sees at the middle plane, linear sRGB
    (y, x, 3). checkpoint(): everything that is needed to go on. Call both before the next state is requested.
    """

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float
    best: Hologram
    pictures: int
    bench_s: float
    seconds: float
    notes: tuple[str, ...]
    picture: Callable[[], NDArray[np.floating]] = field(repr=False, compare=False)
    checkpoint: Callable[[], LoopCheckpoint] = field(repr=False, compare=False)


class CameraLoop:
    """An optimisation at what the camera of a rig sees.

    system: of the rig, with the effects that are known. stack: (plane, y, x, 3) linear sRGB on its simulation grid.
    camera: takes the pictures. start: first drive (frame, modulator, y, x); `settings.begin` chooses it when None.
    resume: a checkpoint to continue from. updates: of the model; None for none. device: of torch.
    is_asked_to_end: asked during long computations.

    Raises UserError for what doesn't fit together, and whatever `camera` raises.
    """

    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating],
        settings: Settings,
        rig: RigDescription,
        camera: PictureSource,
        start: NDArray[np.float32] | None = None,
        resume: LoopCheckpoint | None = None,
        updates: ModelUpdates | None = None,
        *,
        device: str = "cpu",
        is_asked_to_end: Callable[[], bool] = lambda: False,
    ) -> None:
        self.begun = self.system = on_rig(system, rig)
        self.settings, self.rig, self.camera, self.updates = settings, rig, camera, updates
        self._stack, self._device, self._is_asked_to_end = stack, device, is_asked_to_end
        self._target = target_digest(stack)
        drive = initial_drive(self.system, settings) if start is None else torch.tensor(start, dtype=torch.float32)
        if tuple(drive.shape) != self.system.drive_shape:
            raise UserError("--start", f"patterns of shape {tuple(drive.shape)}", expected=f"{self.system.drive_shape}")
        self.variables = OptimisationVariables(self.system, settings, drive.to(device))
        self.best: Hologram | None = None
        self.progress = LoopProgress(0, 0, 0.0, 0.0, math.inf, -math.inf)
        self.registration: Registration | None = None
        self._probes: list[Picture] = []
        self._random: list[Captures] = []
        self._kept: list[Captures] = []
        self._notes: list[str] = []
        if resume is not None:
            self._resume(resume)
        self.problem = CameraProblem(self.system, stack, settings, rig, device)

    def states(self) -> Iterator[LoopState]:
        """Runs the loop; it may be left at any time."""
        began, before = time.perf_counter(), self.progress
        self._register(from_pictures=self.registration is None)
        for iteration in range(before.iteration, self.settings.iterations + 1):
            if self.updates is not None and iteration > before.iteration and self.updates.is_due(iteration):
                self._update_model(self.updates)
            shown = self.variables.patterns.displayed_drive()
            self._record(shown)
            evaluation = self._evaluate(shown, iteration)
            self._advance(evaluation, shown, iteration)
            self.progress = replace(
                self.progress,
                iteration=iteration + 1,
                pictures=before.pictures + self.camera.pictures,
                bench_s=before.bench_s + self.camera.bench_s,
                seconds=before.seconds + time.perf_counter() - began,
            )
            yield self._state(evaluation, iteration)
            self._notes = []

    def measure(self, hologram: Hologram) -> LossEvaluation:
        """Loss and PSNR of a hologram from fresh pictures, with its amplitudes. After the first state only."""
        drive = torch.as_tensor(hologram.drive).to(self._device)
        self._record(drive)
        amplitudes = np.array(hologram.system.amplitudes)
        return self.problem.evaluate(self._path_m(drive), amplitudes, EvaluationRequest())

    def _state(self, evaluation: LossEvaluation, iteration: int) -> LoopState:
        progress = self.progress
        assert self.best is not None
        return LoopState(
            iteration=iteration,
            iterations=self.settings.iterations,
            loss=evaluation.loss,
            psnr_db=evaluation.psnr_db,
            best_psnr_db=progress.best_psnr_db,
            best=self.best,
            pictures=progress.pictures,
            bench_s=progress.bench_s,
            seconds=progress.seconds,
            notes=tuple(self._notes),
            picture=evaluation.picture,
            checkpoint=self._checkpoint,
        )

    def _advance(self, evaluation: LossEvaluation, shown: torch.Tensor, iteration: int) -> None:
        """Keeps the best hologram and takes a step, or goes back to the best one if the loss has long not fallen."""
        progress, patterns = self.progress, self.variables.patterns
        if evaluation.loss < progress.best_loss or self.best is None:
            self.best = self._hologram(shown)
            loss, psnr_db = evaluation.loss, evaluation.psnr_db
            progress = replace(progress, without_gain=0, best_loss=loss, best_psnr_db=psnr_db)
        else:
            progress = replace(progress, without_gain=progress.without_gain + 1)
        if progress.without_gain >= _PATIENCE:
            patterns.go_back(torch.as_tensor(self.best.drive).to(shown), _SHORTER)
            self.variables.amplitudes = np.array(self.best.system.amplitudes)
            progress = replace(progress, without_gain=-1)  # the best one is shown once more
        elif iteration < self.settings.iterations:
            self.variables.step(evaluation, iteration)
        self.progress = replace(progress, step_factor=patterns.step_factor)

    def _evaluate(self, shown: torch.Tensor, iteration: int) -> LossEvaluation:
        """The evaluation of an iteration; in the first and the last one, its amplitudes are solved for before."""
        variables, path_m = self.variables, self._path_m(shown)
        request = variables.evaluation_request(iteration)
        if iteration in (0, self.settings.iterations) and request.optimal_amplitudes:
            variables.amplitudes = self._solve_amplitudes(path_m)
        evaluation = self.problem.evaluate(path_m, variables.amplitudes, request)
        gradient = evaluation.path_gradient
        if not math.isfinite(evaluation.loss) or (gradient is not None and not gradient.isfinite().all()):
            found = f"the loss became {evaluation.loss}, or its gradient isn't finite"
            raise UserError("camera in the loop", found, remedy="lower --step or check the target")
        return evaluation

    def _solve_amplitudes(self, path_m: torch.Tensor) -> NDArray[np.float64]:
        """The amplitudes that suit the pictures best."""
        request = EvaluationRequest(optimal_amplitudes=True)
        solved = self.problem.evaluate(path_m, self.variables.amplitudes, request)
        assert solved.optimal_amplitudes is not None
        return solved.optimal_amplitudes

    # --- the bench --------------------------------------------------------------------------------------------------

    def _record(self, shown: torch.Tensor) -> None:
        """Takes the pictures of a drive; the latest ones are kept for updates of the model."""
        levels = levels_of_drive(shown.cpu().numpy(), self.system)
        pictures = self.camera.record(levels, self.problem.shots)
        self.problem.set_pictures(pictures)
        self._latest = [picture.capture for picture in pictures]

    def _register(self, *, from_pictures: bool) -> None:
        """Gives the problem its registration, which pictures of probe patterns are taken for if it isn't known."""
        if from_pictures:
            if not self._probes:
                self._probes = self._take_probes()
            self.registration = self._fit_registration()
            self._notes += self.registration.notes(self.system.planes_m)
        assert self.registration is not None
        self.problem.register(self.registration)

    def _take_probes(self, sigmas_px: Sequence[float] = PROBE_SIGMAS_PX) -> list[Picture]:
        """Pictures of random patterns, by plane, wavelength and pattern."""
        levels = probe_levels(self.rig, self.settings.seed, sigmas_px)
        wavelengths, planes = lasers_of(self.system, self.rig), self.system.planes_m
        shots = [Shot(p, λ, float(z)) for z in planes for λ in wavelengths for p in range(len(levels))]
        return self.camera.record(levels, shots)

    def _fit_registration(self) -> Registration:
        levels = probe_levels(self.rig, self.settings.seed)
        wavelengths, planes, probes = len(self.system.wavelengths_m), len(self.system.planes_m), len(levels)
        first = [next(i for i, laser in enumerate(self.problem.lasers) if laser[1] == λ) for λ in range(wavelengths)]
        predicted = []
        for own in levels:
            fractions = [m.levels[n] for m, n in zip(self.system.modulators, own, strict=True) if m.levels is not None]
            drive = torch.tensor(np.array([fractions] * self.system.frames), dtype=torch.float32, device=self._device)
            predicted.append(self.problem.predict(self._path_m(drive))[:, first])
        left = iter(self._probes)
        nested = [[[next(left) for _ in range(probes)] for _ in range(wavelengths)] for _ in range(planes)]
        return register(self.rig, torch.stack(predicted, dim=2), self.problem.sample_pitch_m, nested)

    def _update_model(self, updates: ModelUpdates) -> None:
        """Adds to the model what the pictures taken so far show, and registers them anew."""
        if not self._probes:  # they aren't in checkpoints
            self._probes = self._take_probes()
        if not self._random:
            self._random = [picture.capture for picture in self._take_probes(_UPDATE_SIGMAS_PX)]
        self.camera.rest()
        self._kept = [*self._kept, *self._latest][-_KEPT_PICTURES:]
        captures = [*self._random, *self._kept]
        updated = update_model(self.system, captures, updates, self._is_asked_to_end)
        self._notes.append(f"the model is updated: {updated.note}")
        self.system = updated.system
        self.problem = CameraProblem(self.system, self._stack, self.settings, self.rig, self._device)
        self._register(from_pictures=True)

    # --- holograms and checkpoints ----------------------------------------------------------------------------------

    def _path_m(self, drive: torch.Tensor) -> torch.Tensor:
        return self.variables.patterns.optical_path_m(drive)

    def _hologram(self, shown: torch.Tensor) -> Hologram:
        return Hologram(shown.cpu().numpy().copy(), self.system.edit({"amplitudes": self.variables.amplitudes}))

    def _checkpoint(self) -> LoopCheckpoint:
        assert self.best is not None and self.registration is not None
        best: dict[str, NDArray[np.floating]] = {
            "best_drive": self.best.drive,
            "best_amplitudes": np.array(self.best.system.amplitudes),
            "best_wavelengths": np.array(self.best.system.wavelengths_m),
        }
        exposures = [self.camera.exposures_s.get(λ, 0.0) for λ in lasers_of(self.system, self.rig)]
        return LoopCheckpoint(
            begun=self.begun,
            present=self.system,
            settings=self.settings,
            target=self._target,
            progress=self.progress,
            registration=self.registration,
            exposures_s=np.array(exposures),
            tensors=self.variables.state_dict() | best,
        )

    def _resume(self, resume: LoopCheckpoint) -> None:
        resume.check_matches(self.begun, self.settings, self._target, "checkpoint")
        tensors = resume.tensors
        self.variables.load_state_dict(tensors)
        self.system, self.progress, self.registration = resume.present, resume.progress, resume.registration
        self.variables.patterns.step_factor = resume.progress.step_factor
        best = self.system.edit({"amplitudes": tensors["best_amplitudes"]})
        self.best = Hologram(tensors["best_drive"].astype(np.float32), best)
        wavelengths = lasers_of(self.system, self.rig)
        self.camera.exposures_s |= {λ: float(s) for λ, s in zip(wavelengths, resume.exposures_s, strict=True) if s > 0}
