"""The loop: shows patterns, takes their pictures, and steps against the gradient at the measured intensities.

CameraLoop       the loop, a generator of states
LoopCheckpoint   a loop saved in a safetensors file, with what its expensive pictures have taught
ModelUpdates     effects of the bench that the pictures show, added to the model, so that its gradients get better
run_on_rig       the whole job: from a hologram of the model to the best one that the rig's camera saw

for state in camera_loop(system, stack, Settings(iterations=40), rig, camera, start=drive):
    print(state.iteration, state.psnr_db)      # measured
hologram = state.best

Patterns are rounded to the modulators' levels before they are shown, and gradients pass straight through the rounding
(Bengio et al., arXiv:1308.3432; `optimise.level_gradients`). A model that is wrong gives gradients that stop pointing
downhill before the optimum is reached. So where the measured loss hasn't fallen for three iterations, the loop goes
back to the best hologram and takes shorter steps.

A checkpoint holds the tensors of `optimise.checkpoint` (patterns, amplitudes, Adam's moments, the best so far), and

    scale        float64 (wavelength,), of `CameraCalibration`
    shift        float64 (plane, 2), m
    correlation  float64 (plane,)
    exposures    float64 (wavelength,), s; 0 where the next picture is searched for
    metadata     format, version, systems as begun and at present (TOML), settings and progress (JSON), digest of the
                 target
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures, join_captures
from holoview.bench.captures.patterns import BLUR_SIGMAS_PX
from holoview.bench.diagnose.extended_model import extended_system
from holoview.bench.diagnose.pipeline import diagnose
from holoview.bench.experiment.bench_camera import BenchCamera, PictureRequest, PictureSource, TakenPicture
from holoview.bench.experiment.camera_problem import (
    PROBE_SIGMAS_PX,
    CameraCalibration,
    CameraProblem,
    calibrate_camera,
    probe_levels,
)
from holoview.bench.experiment.chain_camera import ChainCameraProblem, ChainVariables
from holoview.bench.experiment.rig_bench import drive_of_levels, lasers_of, levels_of_drive, on_rig
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.open_rig import open_rig
from holoview.holograms.hologram import Hologram, drive_sizes, system_with_elements
from holoview.holograms.optimise.checkpoint import best_of, refuse_other_run, target_digest, variable_tensors
from holoview.holograms.optimise.hologram_job import IntermediateFiles, RunOptions, nothing_left, optimise_hologram
from holoview.holograms.optimise.lasers import changes_lasers
from holoview.holograms.optimise.problem import EvaluationRequest, LossEvaluation
from holoview.holograms.optimise.settings import CAMERA_STEP_RAD, Settings
from holoview.holograms.optimise.variables import OptimisationVariables, first_drive
from holoview.light.model import preset
from holoview.light.model.drives import drive_fits
from holoview.light.model.effects.registry import effects_of, get_effect
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback, TextCallback
from holoview.util.safetensors_file import TensorFormat
from holoview.util.tables import ArraySchema, read_record

_PATIENCE, _SHORTER = 3, 0.5  # iterations in which the loss doesn't fall, and the factor of steps that follows them
_UPDATE_SIGMAS_PX = BLUR_SIGMAS_PX * 2  # of the random patterns that updates of the model see beside holograms
_KEPT_PICTURES = 48  # of earlier holograms, for updates of the model
_F64 = ("float64",)
Drive = NDArray[Any] | Mapping[str, NDArray[Any]]
_FORMAT = TensorFormat(
    name="holoview-camera-loop",
    version="1",
    what="a checkpoint that `holoview optimise --rig` wrote",
    tensors=(
        ArraySchema("scale", _F64, ("wavelength",), low=0.0),
        ArraySchema("shift", _F64, ("plane", 2)),
        ArraySchema("correlation", _F64, ("plane",), low=-1.0, high=1.0),
        ArraySchema("exposures", _F64, ("wavelength",), low=0.0),
    ),
    metadata_keys=("system", "present", "settings", "progress", "target"),
)


def _format_for(system: System | None) -> TensorFormat:
    """The format of a checkpoint: of the loop, and of the variables of its bench."""
    return replace(_FORMAT, tensors=(*variable_tensors(system), *_FORMAT.tensors))


@dataclass(frozen=True)
class CameraLoopState:
    """The state after an iteration.

    iteration, iterations: number of this one, from 0, and of the last. loss, psnr_db: measured, as those of
    `IterationState`. best_psnr_db, best: of the smallest loss so far. pictures, bench_s: taken, and bench time spent so
    far. notes: events since the state before. picture(): the camera's picture of the middle plane, linear sRGB
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
    """An optimisation at the intensities that the camera of a rig measures.

    system: of the rig, with the effects that are known. stack: (plane, y, x, 3) linear sRGB on its simulation grid.
    camera: takes the pictures. start: first drive (frame, modulator, y, x), of a chain (frame, y, x) by element;
    `settings.begin` chooses it when None.
    resume: a checkpoint to continue from. updates: of the model; None for none. device: of torch.
    is_asked_to_end: asked during long computations.

    Raises UserError for parts that don't fit together, and whatever `camera` raises.
    """

    def __init__(
        self,
        system: System,
        stack: NDArray[np.floating],
        settings: Settings,
        rig: RigDescription,
        camera: PictureSource,
        start: Drive | None = None,
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
        self.variables = _variables(self.system, settings, start, device)
        self.best: Hologram | None = None
        self.progress = LoopProgress(0, 0, 0.0, 0.0, math.inf, -math.inf)
        self.calibration: CameraCalibration | None = None
        self._probes: list[TakenPicture] = []
        self._random: list[Captures] = []
        self._kept: list[Captures] = []
        self._notes: list[str] = []
        if resume is not None:
            self._resume(resume)
        self.problem = self._make_problem()

    def _make_problem(self) -> CameraProblem | ChainCameraProblem:
        kind = ChainCameraProblem if self.system.is_chain else CameraProblem
        return kind(self.system, self._stack, self.settings, self.rig, self._device)

    def states(self) -> Iterator[CameraLoopState]:
        """Runs the loop; it may be left at any time."""
        began, before = time.perf_counter(), self.progress
        self._calibrate(from_pictures=self.calibration is None)
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
        drive = _tensors(hologram.drive, self._device)
        self._record(drive)
        amplitudes = np.array(hologram.system.amplitudes)
        return self.problem.evaluate(self._evaluated(drive), amplitudes, EvaluationRequest())

    def _state(self, evaluation: LossEvaluation, iteration: int) -> CameraLoopState:
        progress = self.progress
        assert self.best is not None
        return CameraLoopState(
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

    def _advance(self, evaluation: LossEvaluation, shown: Shown, iteration: int) -> None:
        """Keeps the best hologram and takes a step, or goes back to the best one if the loss has long not fallen."""
        progress, patterns = self.progress, self.variables.patterns
        if evaluation.loss < progress.best_loss or self.best is None:
            self.best = self._hologram(shown)
            loss, psnr_db = evaluation.loss, evaluation.psnr_db
            progress = replace(progress, without_gain=0, best_loss=loss, best_psnr_db=psnr_db)
        else:
            progress = replace(progress, without_gain=progress.without_gain + 1)
        if progress.without_gain >= _PATIENCE:
            patterns.go_back(_tensors(self.best.drive, self._device), _SHORTER)  # type: ignore[arg-type]  # its own
            self.variables.amplitudes = np.array(self.best.system.amplitudes)
            progress = replace(progress, without_gain=-1)  # the best hologram is shown once more
        elif iteration < self.settings.iterations:
            self.variables.step(evaluation, iteration)
        self.progress = replace(progress, step_factor=patterns.step_factor)

    def _evaluate(self, shown: Shown, iteration: int) -> LossEvaluation:
        """The evaluation of an iteration; in the first and the last one, its amplitudes are solved for before."""
        variables, evaluated = self.variables, self._evaluated(shown)
        request = variables.evaluation_request(iteration)
        if iteration in (0, self.settings.iterations) and request.optimal_amplitudes:
            variables.amplitudes = self._solve_amplitudes(evaluated)
        evaluation = self.problem.evaluate(evaluated, variables.amplitudes, request)
        gradient = evaluation.path_gradient
        if not math.isfinite(evaluation.loss) or (gradient is not None and not gradient.isfinite().all()):
            found = f"the loss became {evaluation.loss}, or its gradient isn't finite"
            raise UserError("camera in the loop", found, remedy="lower --step or check the target")
        return evaluation

    def _solve_amplitudes(self, evaluated: Any) -> NDArray[np.float64]:
        """The amplitudes that suit the pictures best."""
        request = EvaluationRequest(optimal_amplitudes=True)
        solved = self.problem.evaluate(evaluated, self.variables.amplitudes, request)
        assert solved.optimal_amplitudes is not None
        return solved.optimal_amplitudes

    # --- the bench --------------------------------------------------------------------------------------------------

    def _record(self, shown: Shown) -> None:
        """Takes the pictures of a drive; the latest pictures are kept for updates of the model."""
        levels = levels_of_drive(_arrays(shown), self.system)
        pictures = self.camera.record(levels, self.problem.shots)
        self.problem.set_pictures(pictures)
        self._latest = [picture.capture for picture in pictures]

    def _calibrate(self, *, from_pictures: bool) -> None:
        """Gives the problem its calibration, which pictures of probe patterns are taken for if it isn't known."""
        if from_pictures:
            if not self._probes:
                self._probes = self._take_probes()
            self.calibration = self._fit_calibration()
            self._notes += self.calibration.notes(self.system.planes_m)
        assert self.calibration is not None
        self.problem.calibrate(self.calibration)

    def _take_probes(self, sigmas_px: Sequence[float] = PROBE_SIGMAS_PX) -> list[TakenPicture]:
        """Pictures of random patterns, by plane, wavelength and pattern."""
        levels = probe_levels(self.rig, self.settings.seed, sigmas_px)
        wavelengths, planes = lasers_of(self.system, self.rig), self.system.planes_m
        shots = [PictureRequest(p, λ, float(z)) for z in planes for λ in wavelengths for p in range(len(levels))]
        return self.camera.record(levels, shots)

    def _fit_calibration(self) -> CameraCalibration:
        levels = probe_levels(self.rig, self.settings.seed)
        wavelengths, planes, probes = len(self.system.wavelengths_m), len(self.system.planes_m), len(levels)
        first = [next(i for i, laser in enumerate(self.problem.lasers) if laser[1] == λ) for λ in range(wavelengths)]
        predicted = []
        for own in levels:
            drive = _tensors(drive_of_levels(own, self.system), self._device)
            predicted.append(self.problem.predict(self._evaluated(drive))[:, first])
        left = iter(self._probes)
        nested = [[[next(left) for _ in range(probes)] for _ in range(wavelengths)] for _ in range(planes)]
        return calibrate_camera(self.rig, torch.stack(predicted, dim=2), self.problem.sample_pitch_m, nested)

    def _update_model(self, updates: ModelUpdates) -> None:
        """Adds to the model the effects that the pictures so far show, and calibrates the camera anew."""
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
        self.problem = self._make_problem()
        self._calibrate(from_pictures=True)

    # --- holograms and checkpoints ----------------------------------------------------------------------------------

    def _evaluated(self, shown: Shown) -> Any:
        """What the problem evaluates: optical paths (m), of a chain the patterns by element."""
        if isinstance(self.variables, OptimisationVariables):
            assert isinstance(shown, torch.Tensor)
            return self.variables.patterns.optical_path_m(shown)
        return shown

    def _hologram(self, shown: Shown) -> Hologram:
        return Hologram(_arrays(shown), self.system.edit({"amplitudes": self.variables.amplitudes}))

    def _checkpoint(self) -> LoopCheckpoint:
        assert self.best is not None and self.calibration is not None
        best: dict[str, NDArray[np.floating]] = {"best_amplitudes": np.array(self.best.system.amplitudes)}
        if self.system.is_chain:
            best |= {f"best_drive/{name}": drive for name, drive in self.best.drive.items()}
        else:
            wavelengths = np.array(self.best.system.wavelengths_m)
            best |= {"best_drive": self.best.drive, "best_wavelengths": wavelengths}
        exposures = [self.camera.exposures_s.get(λ, 0.0) for λ in lasers_of(self.system, self.rig)]
        return LoopCheckpoint(
            begun=self.begun,
            present=self.system,
            settings=self.settings,
            target=self._target,
            progress=self.progress,
            calibration=self.calibration,
            exposures_s=np.array(exposures),
            tensors=self.variables.state_dict() | best,
        )

    def _resume(self, resume: LoopCheckpoint) -> None:
        resume.check_matches(self.begun, self.settings, self._target, "checkpoint")
        tensors = resume.tensors
        self.variables.load_state_dict(tensors)
        self.system, self.progress, self.calibration = resume.present, resume.progress, resume.calibration
        self.variables.patterns.step_factor = resume.progress.step_factor
        self.best = best_of(self.system, tensors)
        wavelengths = lasers_of(self.system, self.rig)
        self.camera.exposures_s |= {λ: float(s) for λ, s in zip(wavelengths, resume.exposures_s, strict=True) if s > 0}


Shown = torch.Tensor | dict[str, torch.Tensor]
"""Patterns (frame, modulator, y, x), of a chain (frame, y, x) by element."""


def _variables(
    system: System, settings: Settings, start: Drive | None, device: str
) -> OptimisationVariables | ChainVariables:
    """What is sought, from a start. Raises UserError for patterns that the bench doesn't show."""
    if start is not None and not drive_fits(system, start):
        found = {n: own.shape for n, own in start.items()} if isinstance(start, Mapping) else start.shape
        expected = f"{system.drive_shapes if system.is_chain else system.drive_shape}"
        raise UserError("--start", f"patterns of shape {found}", expected=expected)
    if system.is_chain:
        return ChainVariables(system, settings, start)  # type: ignore[arg-type]  # a mapping, as it fits
    return OptimisationVariables(system, settings, first_drive(system, settings, start).to(device))


def _tensors(drive: Drive, device: str) -> Shown:
    if isinstance(drive, Mapping):
        return {name: torch.as_tensor(own).to(device) for name, own in drive.items()}
    return torch.as_tensor(drive).to(device)


def _arrays(shown: Shown) -> Any:
    """Copies of patterns as arrays."""
    if isinstance(shown, dict):
        return {name: own.detach().cpu().numpy().copy() for name, own in shown.items()}
    return shown.cpu().numpy().copy()


@dataclass(frozen=True)
class LoopProgress:
    """How far a loop has come.

    iteration: the next one. pictures, bench_s: taken so far, and seconds of bench time. seconds: elapsed.
    best_loss, best_psnr_db: of the smallest loss so far. step_factor: of the patterns' steps. without_gain: iterations
    since the loss fell last.
    """

    iteration: int
    pictures: int
    bench_s: float
    seconds: float
    best_loss: float
    best_psnr_db: float
    step_factor: float = 1.0
    without_gain: int = 0

    def __post_init__(self) -> None:
        if min(self.iteration, self.pictures) < 0 or not 0 <= self.bench_s < math.inf:
            found = f"iteration {self.iteration}, {self.pictures} pictures in {self.bench_s} s"
            raise UserError("progress", found, expected="numbers of 0 or more")


@dataclass(frozen=True)
class LoopCheckpoint:
    """A loop between two iterations.

    begun: the system that it began with. present: with the effects that have been found since. target: digest of the
    stack. tensors: of the variables and the best hologram. exposures_s: (wavelength,), 0 for none.
    """

    begun: System
    present: System
    settings: Settings
    target: str
    progress: LoopProgress
    calibration: CameraCalibration
    exposures_s: NDArray[np.float64]
    tensors: dict[str, NDArray[np.floating]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file; an existing file is replaced only by a complete file."""
        texts = {
            "system": preset.dumps(self.begun),
            "present": preset.dumps(self.present),
            "settings": json.dumps(dataclasses.asdict(self.settings)),
            "progress": json.dumps(dataclasses.asdict(self.progress)),
            "target": self.target,
        }
        own = {
            "scale": self.calibration.scale,
            "shift": self.calibration.shift_m,
            "correlation": self.calibration.correlation,
            "exposures": self.exposures_s,
        }
        _format_for(self.begun).write(path, self.tensors | own, texts)

    def check_matches(self, system: System, settings: Settings, target: str, where: str) -> None:
        """Raises UserError, which names the difference, unless the checkpoint is of this system, settings, target."""
        refuse_other_run((self.begun, self.settings, self.target), (system, settings, target), where, "camera loop")


def load_loop_checkpoint(path: str | os.PathLike[str]) -> LoopCheckpoint:
    """Reads a checkpoint. Raises UserError when the file is missing, damaged, or something else."""
    with _format_for(system_with_elements(path)).open(path) as file:
        begun, present = (preset.loads(file.texts[key], f"{path}: {key}") for key in ("system", "present"))
        settings = read_record(Settings, file.texts["settings"], f"{path}: settings", _FORMAT.what)
        progress = read_record(LoopProgress, file.texts["progress"], f"{path}: progress", _FORMAT.what)
        tensors = file.tensors({**drive_sizes(begun), "plane": len(begun.planes_m)})
    calibration = CameraCalibration(*(tensors.pop(name) for name in ("scale", "shift", "correlation")))
    exposures_s = tensors.pop("exposures")
    target = file.texts["target"]
    return LoopCheckpoint(begun, present, settings, target, progress, calibration, exposures_s, tensors)


@dataclass(frozen=True)
class ModelUpdates:
    """Every so many iterations the bench is diagnosed anew.

    every: iterations between two updates. effects: ids of those that may be the cause; all where empty. time_s: of one
    diagnosis; None for as long as `holoview diagnose` takes by default.
    """

    every: int
    effects: tuple[str, ...] = ()
    time_s: float | None = None

    def is_due(self, iteration: int) -> bool:
        """Whether the model is updated before this iteration."""
        return iteration > 0 and iteration % self.every == 0


@dataclass(frozen=True)
class UpdatedModel:
    """A bench with the effects that were found, and these in words."""

    system: System
    note: str


def update_model(
    system: System, captures: Sequence[Captures], updates: ModelUpdates, is_asked_to_end: Callable[[], bool]
) -> UpdatedModel:
    """The system with the effects that captures show beside those that it has.

    Effects that change the lasers themselves aren't taken over, since patterns can't be optimised for them.
    Raises UserError for an effect that is unknown.
    """
    joined = join_captures(captures)
    joined = dataclasses.replace(joined, levels_before=joined.levels)  # each settled before its picture was taken
    candidates = [get_effect(name) for name in updates.effects] or effects_of(joined.data_properties())
    found = diagnose(
        joined,
        candidates,
        known=system.effect_values,
        free_maps=False,
        time_s=updates.time_s,
        is_asked_to_end=is_asked_to_end,
    )
    values = {name: own for name, own in found.values.items() if not changes_lasers(system, {name: own})}
    left_out = [name for name in found.values if name not in values]
    sentences = [cause.sentence for cause in found.causes if cause.effect in values]
    note = " ".join(sentences) or "nothing beside what the model has"
    if left_out:
        note += f" ({', '.join(left_out)} can't be optimised for)"
    return UpdatedModel(extended_system(system, values), note)


# --- the whole job on a rig ---


@dataclass(frozen=True)
class RigJob:
    """An optimisation on a rig.

    stack: (plane, y, x, 3), the image that the camera should see. settings: those of the model's own optimisation,
    which comes first where there is no start. step_rad: first step of the patterns' phase with the camera. start: the
    first patterns. resume: where an earlier loop had ended.
    """

    rig: RigDescription
    system: System
    stack: NDArray[np.float32]
    settings: Settings
    options: RunOptions
    step_rad: float = CAMERA_STEP_RAD
    updates: ModelUpdates | None = None
    start: Hologram | None = None
    resume: LoopCheckpoint | None = None

    def with_own_sampling(self, hologram: Hologram) -> Hologram:
        """A hologram with the sampling of the job's bench."""
        return Hologram(hologram.drive, hologram.system.edit({"propagation": self.system.sampling.propagation}))


@dataclass
class RigOutcome:
    """The first and the latest state of a loop, and the PSNR of the best hologram in fresh pictures."""

    first: CameraLoopState | None = None
    latest: CameraLoopState | None = None
    fresh_psnr_db: float | None = None


def started_in_model(job: RigJob, progress: ProgressCallback, interruption: Interruption) -> RigJob:
    """The job with the hologram that the model alone finds as its start."""
    options = replace(job.options, checkpoint=None, preview=None, stop_psnr_db=None)
    result = optimise_hologram(
        job.system, job.stack, job.settings, options, progress=progress, interruption=interruption
    )
    return replace(job, start=result.hologram)


def run_on_rig(
    job: RigJob, outcome: RigOutcome, progress: ProgressCallback, interruption: Interruption, tell: TextCallback
) -> None:
    """Opens the rig and runs the loop; its results are in `outcome` even if it fails.

    Whatever ends it, the lasers are off afterwards. Raises UserError for devices that fail, and if the checkpoint to
    resume has no iteration left.
    """
    files = IntermediateFiles(job.options, tell)
    with open_rig(job.rig) as devices:
        loop = CameraLoop(
            job.options.simulated(job.system),
            job.stack,
            replace(job.settings, step_rad=job.step_rad),
            job.rig,
            BenchCamera(job.rig, devices, tell=tell),
            None if job.start is None else job.start.drive,
            job.resume,
            job.updates,
            device=job.options.device,
            is_asked_to_end=interruption,
        )
        for state in loop.states():
            outcome.first, outcome.latest = outcome.first or state, state
            progress(state.iteration, state.iterations, _progress_note(state))
            for text in state.notes:
                tell(text)
            stops = interruption() or job.options.is_enough(state.best_psnr_db, state.seconds)
            files.write_due(state, is_last=stops or state.iteration == state.iterations)
            if stops:
                break
        if outcome.latest is None:
            raise nothing_left()
        if not interruption():
            outcome.fresh_psnr_db = loop.measure(outcome.latest.best).psnr_db


def _progress_note(state: CameraLoopState) -> str:
    measured = f"measured PSNR {state.psnr_db:.2f} dB, best {state.best_psnr_db:.2f} dB, {state.pictures} pictures"
    return f"{measured} in {state.bench_s:.0f} s"
