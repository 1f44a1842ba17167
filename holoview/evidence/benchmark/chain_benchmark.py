"""Times a frame of a chain of elements and its edits beside torch.

A chain is rendered at its own shapes and with its own padding. Torch computes it stage by stage; its transfer functions
are kept from an earlier frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.evidence.benchmark.frame_benchmark import (
    AMPLITUDE,
    FULL,
    SCRUB,
    TORCH,
    FrameTimings,
    error_criterion,
    fft_criterion,
    fft_jobs,
    run_on_threads,
)
from holoview.evidence.benchmark.frame_jobs import (
    TimedJob,
    amplitude_edit,
    full_frame,
    open_renderer,
    pattern_edit,
    scrub,
    time_interleaved,
)
from holoview.holograms.optimise.chain_loop import ChainExecutor
from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.gpu.device import Device
from holoview.light.gpu.tune import StrategyOption
from holoview.light.model.plan import Plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.progress import ProgressCallback, no_progress


def benchmark_chain(
    system: System,
    device: Device,
    rounds: int,
    *,
    half: bool = False,
    strategy: StrategyOption = "auto",
    progress: ProgressCallback = no_progress,
) -> FrameTimings:
    """Time a frame of a chain at its middle focal plane, edits of the plane, of a laser and of each pattern.

    half: store fields as f16. progress: counts the rounds.
    Raises UserError if the device's limits or memory don't suffice.
    """
    drive = random_drive(system)
    opened = partial(open_renderer, system, device, half, strategy, drive=drive)
    renderer = opened()
    jobs: dict[str, TimedJob] = {
        FULL: full_frame(renderer),
        SCRUB: scrub(opened()),
        AMPLITUDE: amplitude_edit(opened()),
    }
    jobs |= {f"pattern of {name}": pattern_edit(opened(), name) for name in system.drive_shapes}
    loop = torch_loop(shown_plan(renderer), drive)
    threads = sorted({1, torch.get_num_threads()})
    jobs |= {f"{TORCH}: in turn, {count} threads": partial(run_on_threads, loop, count) for count in threads}
    jobs |= fft_jobs(device, renderer.plan.grid.padded, renderer.strategy)
    samples = time_interleaved(jobs, rounds, progress=progress)
    criteria = [fft_criterion(samples), error_criterion(intensity_error(renderer))]
    return FrameTimings(samples, criteria, len(system.wavelengths_m), {FULL: renderer.strategy})


def torch_loop(plan: Plan, drive: Any) -> Callable[[], NDArray[np.floating]]:
    """The same frame in PyTorch, complex64, one wavelength after the other: XYZ (y, x, 3) of the plan's first plane."""
    executor = ChainExecutor(plan, FrameInputs(plan, drive))

    def frame() -> NDArray[np.floating]:
        executor.clear_xyz()
        for wavelength in range(len(plan.system.wavelengths_m)):
            executor.run(wavelength)
            executor.composite(wavelength)
        return executor.xyz()[0]

    return frame


def shown_plan(renderer: IncrementalRenderer) -> Plan:
    """The plan of the plane that is rendered alone, on the grid that fits all planes."""
    return replace(renderer.plan, planes=renderer.plan.planes[-1:], _transfers={})


def intensity_error(renderer: IncrementalRenderer) -> float:
    """Relative L2 error of the intensity of the first laser against PyTorch in complex128."""
    plan = shown_plan(renderer)
    reference = TorchExecutor(plan, FrameInputs(plan, renderer.drive), double=True)
    expected = np.zeros(plan.grid.shape)
    for wavelength in plan.lasers[0].indices:
        reference.run(wavelength)
        expected += reference.intensity(0)
    return float(np.linalg.norm(renderer.intensity(0) - expected) / np.linalg.norm(expected))
