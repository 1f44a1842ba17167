"""A whole optimisation on a rig: from a hologram of the model to the one that looks best to the rig's camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.experiment.camera_loop.bench_camera import BenchCamera
from holoview.experiment.camera_loop.loop import CameraLoop, LoopCheckpoint, LoopState, ModelUpdates
from holoview.io.hologram import Hologram
from holoview.model.system import System
from holoview.optimise.hologram_job import IntermediateFiles, RunOptions, nothing_left, optimise_hologram
from holoview.optimise.settings import Settings
from holoview.rig import RigDescription, open_rig
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback, TextCallback

STEP_RAD = 0.05  # a hologram that is nearly right isn't thrown away


@dataclass(frozen=True)
class RigJob:
    """An optimisation on a rig.

    stack: (plane, y, x, 3), what the camera should see. settings: those of the model's own optimisation, which comes
    first where there is no start. step_rad: first step of the patterns' phase with the camera. start: the first
    patterns. resume: where an earlier loop had ended.
    """

    rig: RigDescription
    system: System
    stack: NDArray[np.float32]
    settings: Settings
    options: RunOptions
    step_rad: float = STEP_RAD
    updates: ModelUpdates | None = None
    start: Hologram | None = None
    resume: LoopCheckpoint | None = None

    def with_own_sampling(self, hologram: Hologram) -> Hologram:
        """A hologram with the sampling of the job's bench."""
        return Hologram(hologram.drive, hologram.system.edit({"propagation": self.system.sampling.propagation}))


@dataclass
class RigOutcome:
    """The first and the latest state of a loop, and the PSNR of the best hologram in fresh pictures."""

    first: LoopState | None = None
    latest: LoopState | None = None
    fresh_psnr_db: float | None = None


def started_in_model(job: RigJob, progress: ProgressCallback, interruption: Interruption) -> RigJob:
    """The job with the hologram that the model alone finds as its start."""
    options = replace(job.options, checkpoint=None, preview=None, stop_psnr_db=math.inf)
    result = optimise_hologram(
        job.system, job.stack, job.settings, options, progress=progress, interruption=interruption
    )
    return replace(job, start=result.hologram)


def run_on_rig(
    job: RigJob, outcome: RigOutcome, progress: ProgressCallback, interruption: Interruption, tell: TextCallback
) -> None:
    """Opens the rig and runs the loop; what it reaches is in `outcome` even if it fails.

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


def _progress_note(state: LoopState) -> str:
    measured = f"measured PSNR {state.psnr_db:.2f} dB, best {state.best_psnr_db:.2f} dB, {state.pictures} pictures"
    return f"{measured} in {state.bench_s:.0f} s"
