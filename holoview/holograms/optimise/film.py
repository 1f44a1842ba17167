"""Holograms for the pictures of a film: each begins with the patterns and amplitudes of the hologram before.

Neighbouring pictures are alike, so that later holograms need fewer iterations than the first. Each starts from the last
file in the folder, whether this run wrote it or an earlier run: a run that goes on makes the same files.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.hologram import Hologram, load_hologram
from holoview.holograms.optimise.chain_loop import ChainOptimiser
from holoview.holograms.optimise.hologram_job import RunOptions, tell_of_compiling, watch
from holoview.holograms.optimise.lasers import next_amplitudes
from holoview.holograms.optimise.parallel import SINGLE_PROCESS
from holoview.holograms.optimise.settings import Settings, next_settings
from holoview.holograms.optimise.solve import Optimiser, check_changing_target, optimiser_of
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.processes import Interruption
from holoview.util.progress import ProgressCallback, TextCallback, no_progress


@dataclass(frozen=True)
class FilmJob:
    """The holograms to make of a film.

    settings: of the first hologram. next_iterations: of each hologram after it. folder: where to write the files
    00000.safetensors, … count: number of pictures, 0 if unknown. as_uint8: store patterns as bytes.
    """

    system: System
    settings: Settings
    next_iterations: int
    options: RunOptions
    folder: Path
    count: int = 0
    as_uint8: bool = False

    def __post_init__(self) -> None:
        if self.next_iterations < 1:
            raise UserError("--next-iterations", str(self.next_iterations), expected="at least 1")
        check_changing_target(self.settings)

    @property
    def next_settings(self) -> Settings:
        """Settings of each hologram after the first."""
        return next_settings(self.settings, self.next_iterations)

    def file(self, number: int) -> Path:
        """The hologram of a picture, counted from 0."""
        return self.folder / f"{number:05d}.safetensors"


def optimise_film(
    job: FilmJob,
    stacks: Iterable[NDArray[np.float32]],
    *,
    progress: ProgressCallback,
    interruption: Interruption,
    tell: TextCallback,
) -> list[float]:
    """Writes a hologram for each focal stack (plane, y, x, 3); returns the PSNR (dB) of the holograms it optimised.

    Holograms that are in the folder already are kept. An interruption ends the film after an iteration, without the
    hologram that was being optimised. Raises UserError for a hologram in the folder that is of another bench.
    """
    found_db: list[float] = []
    last: Hologram | None = None
    optimiser: Optimiser | ChainOptimiser | None = None
    if not job.system.is_chain:
        tell_of_compiling(job.options.device, tell)
    for number, stack in enumerate(stacks):
        path = job.file(number)
        if path.exists():
            last = _of_same_bench(path, job.system)
            continue
        note = "" if not found_db else f"PSNR {found_db[-1]:.2f} dB"
        progress(number, max(job.count, number + 1), note)
        optimiser = _begin(job, stack, last, optimiser)
        state = watch(optimiser.states(), job.options, SINGLE_PROCESS, no_progress, interruption, tell)
        if state is None or interruption():
            return found_db
        hologram = Hologram(state.best.drive, job.system.edit({"amplitudes": state.best.system.amplitudes}))
        hologram.save(path, as_uint8=job.as_uint8)
        last = load_hologram(path)
        found_db.append(state.best_psnr_db)
        progress(number + 1, max(job.count, number + 1), f"PSNR {found_db[-1]:.2f} dB")
    return found_db


def _begin(
    job: FilmJob, stack: NDArray[np.float32], last: Hologram | None, optimiser: Optimiser | ChainOptimiser | None
) -> Optimiser | ChainOptimiser:
    """The optimisation of a picture. last: the hologram before. optimiser: of the picture before, which goes on."""
    device = job.options.device
    if last is None:
        return optimiser_of(job.options.simulated(job.system), stack, job.settings, device=device)
    if optimiser is not None:
        optimiser.go_on(stack, job.next_settings, last)
        return optimiser
    amplitudes = next_amplitudes(last.system.amplitudes, job.system.amplitudes > 0)  # lasers that are on stay on
    system = job.options.simulated(job.system.edit({"amplitudes": amplitudes}))
    return optimiser_of(system, stack, job.next_settings, last.drive, device)


def _of_same_bench(path: Path, system: System) -> Hologram:
    hologram = load_hologram(path)
    if hologram.system.edit({"amplitudes": system.amplitudes}) != system:
        raise UserError(
            str(path),
            "is a hologram of another bench",
            expected=f"none, or those of an earlier run for {system.name}",
            remedy="choose another folder",
        )
    return hologram
