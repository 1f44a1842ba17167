"""Times a frame and its edits. Each criterion is a ratio of two jobs, timed in the same rounds, with a limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.benchmark.fft_benchmark import FFT, TORCH_FFT, fft_jobs
from holoview.benchmark.frame_jobs import amplitude_edit, full_frame, middle_plane_m, open_renderer, scrub
from holoview.benchmark.pruned_torch_baseline import WAYS, PrunedTorchBaseline, can_prune
from holoview.benchmark.timing import JobTimings, TimedJob, time_interleaved
from holoview.benchmark.torch_baseline import TorchBaseline, torch_threads
from holoview.engine.torch_executor import TorchExecutor
from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.tune import StrategyOption
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optics.frame_inputs import FrameInputs
from holoview.view import random_drive

FULL, SINGLE, PADDED, SCRUB, AMPLITUDE = "frame", "frame, 1 λ", "frame, padded", "focal plane", "amplitude"
TORCH, TORCH_SINGLE, TORCH_PRUNED = "torch", "torch, 1 λ", "torch, pruned"


@dataclass(frozen=True)
class Criterion:
    """A measured value, the limit that it must not exceed, and the goal of further work."""

    name: str
    value: float
    limit: float
    goal: float
    unit: str = ""

    @property
    def is_met(self) -> bool:
        """Whether the value is within the limit."""
        return self.value <= self.limit

    def as_dict(self) -> dict[str, Any]:
        """The criterion as JSON values."""
        return {
            "name": self.name,
            "value": self.value,
            "bar": self.limit,
            "aim": self.goal,
            "unit": self.unit,
            "holds": self.is_met,
        }


@dataclass(frozen=True)
class FrameTimings:
    """Results of `benchmark_frame`.

    timings: by job. traffic_bytes: memory traffic of one wavelength. memory_bytes: of the device. strategies: of the
    FFTs, by job.
    """

    timings: dict[str, JobTimings]
    criteria: list[Criterion]
    wavelengths: int
    traffic_bytes: int
    memory_bytes: int
    strategies: dict[str, Strategy]


def benchmark_frame(
    system: System, device: Device, rounds: int, *, half: bool = False, strategy: StrategyOption = "auto"
) -> FrameTimings:
    """Time frames and edits of a system at its middle focal plane, without padding unless the job says otherwise.

    half: store fields as f16. Raises UserError if the device's limits or memory don't suffice.
    """
    base = system.edit({"propagation": "periodic"})
    single = one_wavelength(base)
    renderers = {
        FULL: open_renderer(base, device, half, strategy),
        SINGLE: open_renderer(single, device, half, strategy),
        PADDED: open_renderer(system.edit({"propagation": "linear"}), device, half, strategy),
    }
    jobs: dict[str, TimedJob] = {name: full_frame(renderer) for name, renderer in renderers.items()}
    jobs |= {SCRUB: scrub(renderers[FULL]), AMPLITUDE: amplitude_edit(renderers[FULL])}
    jobs |= _torch_jobs(TORCH, base) | _torch_jobs(TORCH_SINGLE, single) | _pruned_jobs(base)
    jobs |= _cuda_jobs(base)
    jobs |= fft_jobs(device, make_plan(base).grid.padded, renderers[FULL].strategy)
    samples = time_interleaved(jobs, rounds)
    criteria = _criteria(samples, len(base.wavelengths_m), frame_error(single, device, half, strategy))
    full = renderers[FULL]
    strategies = {name: renderer.strategy for name, renderer in renderers.items()}
    return FrameTimings(samples, criteria, len(base.wavelengths_m), full.traffic_bytes, full.memory_bytes, strategies)


def one_wavelength(system: System) -> System:
    """The system with the middle one of its wavelengths only, at unit amplitude."""
    middle = float(system.wavelengths_m[len(system.wavelengths_m) // 2])
    return system.edit({"wavelengths": [middle], "amplitudes": [[1.0]]})


def frame_error(
    system: System,
    device: Device,
    half: bool,
    strategy: StrategyOption,
    expected: NDArray[np.floating] | None = None,
) -> float:
    """Relative L2 error of the intensity of the first wavelength against PyTorch in complex128.

    expected: `reference_intensity` of the system, if it is known already.
    """
    renderer = open_renderer(system, device, half, strategy)
    expected = reference_intensity(system) if expected is None else expected
    return float(np.linalg.norm(renderer.intensity(0) - expected) / np.linalg.norm(expected))


def reference_intensity(system: System) -> NDArray[np.floating]:
    """Intensity (y, x) of the first wavelength at the middle focal plane, in complex128, for the drive of the jobs."""
    plan = make_plan(system, [middle_plane_m(system)])
    reference = TorchExecutor(plan, FrameInputs(plan, random_drive(system)), double=True)
    reference.run(0)
    return reference.intensity(0)


def _criteria(samples: dict[str, JobTimings], wavelengths: int, error: float) -> list[Criterion]:
    ms = {name: sample.median_ms for name, sample in samples.items()}
    best, best_single = (
        min(time_ms for name, time_ms in ms.items() if name.startswith(f"{job}:")) for job in (TORCH, TORCH_SINGLE)
    )
    pruned = [time_ms for name, time_ms in ms.items() if name.startswith(f"{TORCH_PRUNED}:")]
    beside_pruned = [Criterion("frame / best pruned torch loop", ms[FULL] / min(pruned), 1.0, 0.9)] if pruned else []
    return [
        Criterion("FFT2 / torch.fft2 on 2 threads", ms[FFT] / ms[TORCH_FFT], 2.0, 1.6),
        Criterion(f"frame / best torch loop, {wavelengths} λ", ms[FULL] / best, 0.80, 0.65),
        *beside_pruned,
        Criterion("frame / best torch loop, 1 λ", ms[SINGLE] / best_single, 1.0, 0.85),
        Criterion("padded (linear) / periodic frame", ms[PADDED] / ms[FULL], 4.0, 3.0),
        Criterion("focal-plane scrub / full frame", ms[SCRUB] / ms[FULL], 0.45, 0.35),
        Criterion("amplitude edit / full frame", ms[AMPLITUDE] / ms[FULL], 0.10, 0.05),
        Criterion("frame error, relative L2 against complex128", error, 1e-6, 7e-7),
    ]


def _torch_jobs(name: str, system: System) -> dict[str, TimedJob]:
    """The same frame in PyTorch: wavelengths one by one or in a batch, on one thread or PyTorch's default number.

    One thread is often faster on a busy machine, where several wait for each other.
    """
    default_threads = torch.get_num_threads()
    return {
        f"{name}: {order}, {threads} threads": partial(_run_baseline, baseline, threads)
        for order, baseline in _torch_baselines(system, "cpu").items()
        for threads in sorted({1, default_threads})
    }


def _pruned_jobs(system: System) -> dict[str, TimedJob]:
    """The same frame by loops that compute only what the stops pass, if these pass no more than the first order."""
    plan = _plan_at_middle(system)
    if not can_prune(plan):
        return {}
    inputs = FrameInputs(plan, random_drive(system))
    baselines = {way: PrunedTorchBaseline(plan, inputs, way) for way in WAYS}
    return {
        f"{TORCH_PRUNED}: {way}, {threads} threads": partial(_run_baseline, baseline, threads)
        for way, baseline in baselines.items()
        for threads in sorted({1, torch.get_num_threads()})
    }


def _cuda_jobs(system: System) -> dict[str, TimedJob]:
    """The same frame in PyTorch on a card, if PyTorch has one."""
    if not torch.cuda.is_available():
        return {}
    baselines = _torch_baselines(system, "cuda")
    return {f"{TORCH} on cuda: {order}": partial(_run_on_cuda, baseline) for order, baseline in baselines.items()}


def _torch_baselines(system: System, device: str) -> dict[str, TorchBaseline]:
    """The loops over wavelengths one by one and, if there are several, over all at once."""
    plan = _plan_at_middle(system)
    inputs = FrameInputs(plan, random_drive(system))
    orders = {"in turn": False, "batched": True} if len(system.wavelengths_m) > 1 else {"in turn": False}
    return {order: TorchBaseline(plan, inputs, batched=batched, device=device) for order, batched in orders.items()}


def _plan_at_middle(system: System) -> Plan:
    return make_plan(system, [middle_plane_m(system)])


def _run_baseline(baseline: Callable[[], torch.Tensor], threads: int) -> None:
    with torch_threads(threads), torch.inference_mode():
        baseline()


def _run_on_cuda(baseline: TorchBaseline) -> None:
    with torch.inference_mode():
        baseline()
    torch.cuda.synchronize()
