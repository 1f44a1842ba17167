"""A frame and its edits beside torch: each figure is a ratio of two jobs of the same rounds, and has a bar."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
import torch

from holoview.benchmark.fft_benchmark import FFT, TORCH_FFT, fft_jobs
from holoview.benchmark.strategy_choice import resolve_strategy
from holoview.benchmark.timing import JobTimings, TimedJob, time_interleaved
from holoview.benchmark.torch_baseline import TorchBaseline
from holoview.engine.incremental import IncrementalRenderer
from holoview.engine.torch_executor import TorchExecutor
from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.tune import StrategyOption
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import make_frame_inputs
from holoview.view import random_drive

FULL, SINGLE, PADDED, SCRUB, AMPLITUDE = "frame", "frame, 1 λ", "frame, padded", "focal plane", "amplitude"
TORCH, TORCH_SINGLE = "torch", "torch, 1 λ"


@dataclass(frozen=True)
class Criterion:
    """A figure, the bar that it should stay below, and what it aims at."""

    name: str
    value: float
    limit: float
    goal: float
    unit: str = ""

    @property
    def is_met(self) -> bool:
        """Whether the bar is met."""
        return self.value <= self.limit


@dataclass(frozen=True)
class FrameTimings:
    """What was measured: wall times by job, ratios with their bars, the traffic of a frame and wavelength, and by which
    strategies the transforms went."""

    timings: dict[str, JobTimings]
    criteria: list[Criterion]
    wavelengths: int
    traffic_bytes: int
    memory_bytes: int
    strategies: dict[str, Strategy]


def benchmark_frame(
    system: System, device: Device, rounds: int, *, half: bool = False, strategy: StrategyOption = "auto"
) -> FrameTimings:
    """Times frames of a periodic, on-axis bench of one frame, warm, at its middle focal plane.

    Raises UserError when the device can't hold it.
    """
    base = system.edit({"propagation": "periodic"})
    single = one_wavelength(base)
    sessions = {
        FULL: _session(base, device, half, strategy),
        SINGLE: _session(single, device, half, strategy),
        PADDED: _session(system.edit({"propagation": "linear"}), device, half, strategy),
    }
    jobs: dict[str, TimedJob] = {name: _full(session) for name, session in sessions.items()}
    jobs |= {SCRUB: _scrub(sessions[FULL]), AMPLITUDE: _amplitudes(sessions[FULL])}
    jobs |= _torch_jobs(TORCH, base) | _torch_jobs(TORCH_SINGLE, single)
    jobs |= fft_jobs(device, make_plan(base).grid.padded, sessions[FULL].strategy)
    samples = time_interleaved(jobs, rounds)
    bars = _criteria(samples, len(base.wavelengths_m), frame_error(single, device, half, strategy))
    frame = sessions[FULL]
    chosen = {name: session.strategy for name, session in sessions.items()}
    return FrameTimings(samples, bars, len(base.wavelengths_m), frame.traffic_bytes, frame.memory_bytes, chosen)


def one_wavelength(system: System) -> System:
    """The bench with the wavelength in the middle of its list alone."""
    middle = float(system.wavelengths_m[len(system.wavelengths_m) // 2])
    return system.edit({"wavelengths": [middle], "amplitudes": [[1.0]]})


def frame_error(system: System, device: Device, half: bool, strategy: StrategyOption) -> float:
    """Relative L2 of the intensity of the first wavelength against torch in complex128."""
    session = _session(system, device, half, strategy)
    plan = make_plan(system, [session.plane_m])
    reference = TorchExecutor(plan, make_frame_inputs(plan, random_drive(system)), double=True)
    reference.run(0)
    expected = reference.intensity(0)
    return float(np.linalg.norm(session.intensity(0) - expected) / np.linalg.norm(expected))


def _criteria(samples: dict[str, JobTimings], wavelengths: int, error: float) -> list[Criterion]:
    ms = {name: sample.median_ms for name, sample in samples.items()}
    best, best_single = (min(t for name, t in ms.items() if name.startswith(f"{of}:")) for of in (TORCH, TORCH_SINGLE))
    return [
        Criterion("FFT2 / torch.fft2 on 2 threads", ms[FFT] / ms[TORCH_FFT], 2.0, 1.6),
        Criterion(f"frame / best torch loop, {wavelengths} λ", ms[FULL] / best, 0.80, 0.65),
        Criterion("frame / best torch loop, 1 λ", ms[SINGLE] / best_single, 1.0, 0.85),
        Criterion("padded (linear) / periodic frame", ms[PADDED] / ms[FULL], 4.0, 3.0),
        Criterion("focal-plane scrub / full frame", ms[SCRUB] / ms[FULL], 0.45, 0.35),
        Criterion("amplitude edit / full frame", ms[AMPLITUDE] / ms[FULL], 0.10, 0.05),
        Criterion("frame error, relative L2 against complex128", error, 1e-6, 7e-7),
    ]


def _session(system: System, device: Device, half: bool, strategy: StrategyOption) -> IncrementalRenderer:
    middle = float(system.planes_m[len(system.planes_m) // 2])
    chosen = resolve_strategy(device, make_plan(system, [*system.planes_m, middle]).grid.padded, strategy)
    session = IncrementalRenderer(system, random_drive(system), device, plane_m=middle, half=half, strategy=chosen)
    session.update()
    return session


def _full(session: IncrementalRenderer) -> TimedJob:
    """Everything from the drive to XYZ."""

    def job() -> None:
        session.invalidate()
        _until_seen(session)

    return job


def _scrub(session: IncrementalRenderer) -> TimedJob:
    """The focal plane moves there and back."""
    planes_m = cycle([session.plane_m * 1.01, session.plane_m])
    return _edit(session, lambda: {"plane_m": next(planes_m)})


def _amplitudes(session: IncrementalRenderer) -> TimedJob:
    """All lasers become a little stronger or weaker."""
    factors = cycle([1.01, 1.0])
    before = session.system
    return _edit(session, lambda: {"system": before.with_(amplitudes=before.amplitudes * next(factors))})


def _edit(session: IncrementalRenderer, change: Callable[[], dict[str, Any]]) -> TimedJob:
    """An edit, from the call to XYZ; what came before is up to date."""

    def job() -> None:
        session.edit(**change())
        _until_seen(session)

    return job


def _until_seen(session: IncrementalRenderer) -> None:
    session.update(with_srgb=False)
    session.device.wait()


def _torch_jobs(name: str, system: System) -> dict[str, TimedJob]:
    """The same frame by torch: wavelengths in turn or in one batch, on one thread or as many as torch chooses.

    On a busy machine one thread is often the faster choice: several wait for each other.
    """
    plan = make_plan(system, [float(system.planes_m[len(system.planes_m) // 2])])
    slots, many = make_frame_inputs(plan, random_drive(system)), torch.get_num_threads()
    orders = {"in turn": False, "batched": True} if len(system.wavelengths_m) > 1 else {"in turn": False}
    loops = {order: TorchBaseline(plan, slots, batched=batched) for order, batched in orders.items()}
    return {
        f"{name}: {order}, {threads} threads": _on_threads(loop, threads)
        for order, loop in loops.items()
        for threads in sorted({1, many})
    }


def _on_threads(loop: TorchBaseline, threads: int) -> TimedJob:
    def job() -> None:
        before = torch.get_num_threads()
        torch.set_num_threads(threads)
        try:
            with torch.inference_mode():
                loop()
        finally:
            torch.set_num_threads(before)

    return job
