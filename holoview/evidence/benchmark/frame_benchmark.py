"""Times a frame and its edits beside torch, by the device's own clock, and from the start of a process.

`benchmark_frame`      a frame and its edits, timed in the same rounds as torch and judged as ratios with limits
`device_time`          a frame by the device's own clock, and its share of the memory bandwidth
`first_image_timings`  from the start of a process to its first image

The shaders are compared with the fastest loops in PyTorch. `TorchBaseline` has every advantage that a program for one
fixed bench can have: transfer functions are computed in advance, in float64, for all wavelengths; fields are complex64
and modified in place; the grid is periodic; there are one on-axis source and one frame. `PrunedTorchBaseline` computes,
moreover, only what stops of the first order pass.
"""

from __future__ import annotations

import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.evidence.benchmark.frame_jobs import (
    JobTimings,
    TimedJob,
    amplitude_edit,
    full_frame,
    middle_plane_m,
    open_renderer,
    pattern_edit,
    scrub,
    time_interleaved,
)
from holoview.evidence.benchmark.machine import probe_device
from holoview.holograms.optimise.parallel import torch_threads
from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.gpu.device import Device
from holoview.light.gpu.fft import FftPlan
from holoview.light.gpu.line_fft import Strategy
from holoview.light.gpu.recorder import CommandRecorder, GpuTimer
from holoview.light.gpu.tune import StrategyOption
from holoview.light.model import preset
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.numerics.sampling import frequency_indices
from holoview.light.optics.bench import relay_response
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.slm import pixel_spectrum
from holoview.util.progress import ProgressCallback, no_progress


class TorchBaseline:
    """Computes XYZ of one plane, (3, y, x) float32, in PyTorch.

    batched: all wavelengths at once instead of one after the other. device: of torch.
    Raises ValueError for a bench with padding, tilted light, several frames or several sources.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, *, batched: bool, device: str = "cpu") -> None:
        check_simple_bench(plan)
        system = plan.system
        wavelengths = range(len(system.wavelengths_m))
        self._batched = batched
        self._device = torch.device(device)
        paths_m = [upsample_nearest(opd, plan.grid.upsample) for opd in inputs.opd_m[0]]
        self._paths_nm = [path_m.float().to(self._device) * 1e9 for path_m in paths_m]
        self._radians_per_nm = [2 * math.pi / (float(λ) * 1e9) for λ in system.wavelengths_m]
        gap = [] if system.gap_m is None else [_transfer_functions(plan, inputs, 0)]
        transfers = [*gap, _transfer_functions(plan, inputs, 1)]
        self._transfers = [transfer.to(self._device) for transfer in transfers]
        weights = plan.weights[0][:, None] * plan.colour_weights
        self._weights = weights.tolist()
        self._xyz_weights = torch.from_numpy(np.ascontiguousarray(weights)).float().to(self._device)
        self._ones = torch.ones(plan.grid.shape, device=self._device)
        self._wavelengths = wavelengths

    def __call__(self) -> torch.Tensor:
        """Compute the frame."""
        return self._all_wavelengths() if self._batched else self._one_by_one()

    def _one_by_one(self) -> torch.Tensor:
        xyz = torch.zeros(3, *self._ones.shape, device=self._device)
        for wavelength in self._wavelengths:
            field: torch.Tensor | None = None
            for path, transfers in zip(self._paths_nm, self._transfers, strict=True):
                phasor = torch.polar(self._ones, path * self._radians_per_nm[wavelength])
                field = phasor if field is None else field.mul_(phasor)
                field = torch.fft.ifft2(torch.fft.fft2(field).mul_(transfers[wavelength]))
            assert field is not None
            intensity = field.real.square().add_(field.imag.square())
            for channel in range(3):
                xyz[channel].add_(intensity, alpha=self._weights[wavelength][channel])
        return xyz

    def _all_wavelengths(self) -> torch.Tensor:
        radians_per_nm = torch.tensor(self._radians_per_nm, device=self._device)[:, None, None]
        field: torch.Tensor | None = None
        for path, transfers in zip(self._paths_nm, self._transfers, strict=True):
            phase = path * radians_per_nm
            phasor = torch.polar(torch.ones(1, device=self._device).expand_as(phase), phase)
            field = phasor if field is None else field.mul_(phasor)
            field = torch.fft.ifft2(torch.fft.fft2(field).mul_(transfers))
        assert field is not None
        intensity = field.real.square().add_(field.imag.square())
        return torch.einsum("wyx,wc->cyx", intensity, self._xyz_weights)


def check_simple_bench(plan: Plan) -> None:
    """Raises ValueError for a bench with padding, tilted light, several frames or several sources."""
    is_padded = plan.grid.padded != plan.grid.shape
    if is_padded or plan.slopes.any() or plan.weights.shape[0] > 1 or len(plan.slopes) > 1:
        raise ValueError("expected a periodic grid, one frame and one source on the axis")


def _transfer_functions(plan: Plan, inputs: FrameInputs, relay: int) -> torch.Tensor:
    """Transfer function × pupil over the gap (0) or to the first plane (1), (wavelength, y, x) complex64."""
    ky, kx = (torch.from_numpy(frequency_indices(n)) for n in plan.grid.padded)
    return torch.stack(
        [
            relay_response(plan.transfer(relay, w), ky, kx, inputs.pupils[relay][w], torch.complex64)
            for w in range(len(plan.system.wavelengths_m))
        ]
    )


# --- only what stops of the first order pass ---
#
# With u samples along a side of a pixel, P/u frequencies along an axis pass at most, so that transforms have P/u points
# at most. Two ways of computing the samples of a field are offered, since which one is faster depends on the processor:
#
#     pixel parts   the u × u samples of a pixel one after the other: sample (r, s) of all pixels is an inverse FFT of
#                   P/u points of the spectrum times exp(2πi·(k_y·r + k_x·s)/P), which the transfer function includes
#     lines         only the columns of the band are transformed along y, and only their zero-padded rows along x


Way = Literal["pixel parts", "lines"]
WAYS: tuple[Way, ...] = ("pixel parts", "lines")


def can_prune(plan: Plan) -> bool:
    """Whether the stops of a bench with two modulators pass at most P/u frequencies along either axis."""
    u = plan.grid.upsample
    narrow = [
        -padded // (2 * u) <= low and high < padded / (2 * u)
        for relay in (0, 1)
        for padded, low, high in zip(plan.grid.padded, plan.band(relay).lowest, plan.band(relay).highest, strict=True)
    ]
    is_even = all(padded % (2 * u) == 0 for padded in plan.grid.padded)
    return plan.system.gap_m is not None and u > 1 and is_even and all(narrow)


class PrunedTorchBaseline:
    """Computes XYZ of one plane, (3, y, x) float32, in PyTorch.

    Raises ValueError as `TorchBaseline` does, and for a bench for which `can_prune` is False.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, way: Way) -> None:
        check_simple_bench(plan)
        if not can_prune(plan):
            raise ValueError("expected two modulators and stops within the first order in both relays")
        self._plan, self._way, u = plan, way, plan.grid.upsample
        self._upsample, self._pixels = u, (plan.grid.padded[0] // u, plan.grid.padded[1] // u)
        self._paths_nm = [opd.float() * 1e9 for opd in inputs.opd_m[0]]
        self._radians_per_nm = [2 * math.pi / (float(λ) * 1e9) for λ in plan.system.wavelengths_m]
        self._weights = (plan.weights[0][:, None] * plan.colour_weights).tolist()
        self._ones = torch.ones(self._pixels)
        ky, kx = (torch.from_numpy(frequency_indices(n)) for n in self._pixels)
        parts = self._part_phasors(ky, kx)
        self._first, self._last = [], []
        for wavelength in range(len(plan.system.wavelengths_m)):
            self._first.append(self._transfer(inputs, 0, wavelength, ky, kx) * self._one_pixel(ky, kx))
            self._last.append(self._transfer(inputs, 1, wavelength, ky, kx))
        if way == "pixel parts":
            scale = 1 / u**2  # of an inverse FFT of P points
            self._first = [(h * parts * scale).to(torch.complex64) for h in self._first]
            self._last = [(h * parts * scale).to(torch.complex64) for h in self._last]
            self._gather = parts.conj().to(torch.complex64)
        else:
            self._first, self._last = ([h.to(torch.complex64) for h in group] for group in (self._first, self._last))
            self._columns = torch.zeros(plan.grid.padded[0], self._pixels[1], dtype=torch.complex64)
            self._rows = torch.zeros(plan.grid.padded, dtype=torch.complex64)

    def __call__(self) -> torch.Tensor:
        """Compute the frame."""
        by_parts = self._way == "pixel parts"
        u, shape = self._upsample, self._plan.grid.padded
        xyz = torch.zeros(3, *((u * u, *self._pixels) if by_parts else shape))
        for wavelength, weights in enumerate(self._weights):
            first, second = (
                torch.polar(self._ones, path * self._radians_per_nm[wavelength]) for path in self._paths_nm
            )
            spectrum, transfers = torch.fft.fft2(first), (self._first[wavelength], self._last[wavelength])
            field = (
                self._by_parts(spectrum, second, *transfers)
                if by_parts
                else self._by_lines(spectrum, second, *transfers)
            )
            intensity = field.real.square().add_(field.imag.square())
            for channel in range(3):
                xyz[channel].add_(intensity, alpha=weights[channel])
        if not by_parts:
            return xyz
        return xyz.view(3, u, u, *self._pixels).permute(0, 3, 1, 4, 2).reshape(3, *shape)

    def _by_parts(
        self, spectrum: torch.Tensor, second: torch.Tensor, gap: torch.Tensor, last: torch.Tensor
    ) -> torch.Tensor:
        """The samples of the field at the plane, (u·u, P_y/u, P_x/u)."""
        behind_gap = torch.fft.ifft2(gap * spectrum).mul_(second)
        return torch.fft.ifft2(last * torch.fft.fft2(behind_gap).mul_(self._gather).sum(dim=0))

    def _by_lines(
        self, spectrum: torch.Tensor, second: torch.Tensor, gap: torch.Tensor, last: torch.Tensor
    ) -> torch.Tensor:
        """The samples of the field at the plane, (P_y, P_x)."""
        (rows, columns), u = self._pixels, self._upsample
        field = self._field(spectrum.mul_(gap))
        field.view(rows, u, columns, u).mul_(second[:, None, :, None])
        along_x = torch.fft.fft(field, dim=1)
        along_x = torch.cat([along_x[:, : columns // 2], along_x[:, -(columns // 2) :]], dim=1)
        along_y = torch.fft.fft(along_x, dim=0)
        return self._field(torch.cat([along_y[: rows // 2], along_y[-(rows // 2) :]]).mul_(last))

    def _field(self, spectrum: torch.Tensor) -> torch.Tensor:
        """The field of a spectrum of P/u rows and columns; overwrites the padded copies of the last spectrum."""
        for padded, narrow, dim in ((self._columns, spectrum, 0), (self._rows, None, 1)):
            given = torch.fft.ifft(self._columns, dim=0) if narrow is None else narrow
            half = self._pixels[dim] // 2
            padded.narrow(dim, 0, half).copy_(given.narrow(dim, 0, half))
            padded.narrow(dim, padded.shape[dim] - half, half).copy_(given.narrow(dim, half, half))
        return torch.fft.ifft(self._rows, dim=1)

    def _transfer(
        self, inputs: FrameInputs, relay: int, wavelength: int, ky: torch.Tensor, kx: torch.Tensor
    ) -> torch.Tensor:
        """Transfer function × pupil, (P_y/u, P_x/u) complex128."""
        transfer = self._plan.transfer(relay, wavelength)
        return relay_response(transfer, ky, kx, inputs.pupils[relay][wavelength], torch.complex128)

    def _one_pixel(self, ky: torch.Tensor, kx: torch.Tensor) -> torch.Tensor:
        y, x = (pixel_spectrum(n, self._upsample, 0.0) for n in self._plan.grid.padded)
        return y[ky][:, None] * x[kx]

    def _part_phasors(self, ky: torch.Tensor, kx: torch.Tensor) -> torch.Tensor:
        """exp(2πi·(k_y·r + k_x·s)/P) of sample (r, s) of a pixel, (u·u, P_y/u, P_x/u) complex128."""
        (rows, columns), u = self._plan.grid.padded, self._upsample
        turns = [ky[:, None] * (r / rows) + kx * (s / columns) for r, s in np.ndindex(u, u)]
        return torch.exp(2j * math.pi * torch.stack(turns))


# --- frames and their edits -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DeviceTime:
    """Time of a frame and of one wavelength (ms), and bandwidths (bytes/s, read plus written)."""

    frame_ms: float
    wavelength_ms: float
    bandwidth: float
    copy_bandwidth: float

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON values."""
        return asdict(self) | {"share_of_copy": self.bandwidth / self.copy_bandwidth}


def device_time(
    system: System, device: Device, rounds: int, *, half: bool = False, strategy: StrategyOption = "auto"
) -> DeviceTime:
    """Median of `rounds` frames of a short form without padding, or of a chain, after one that isn't timed.

    Raises UserError if the device has no timestamp queries.
    """
    renderer = open_renderer(_unpadded(system), device, half, strategy)
    frame_s = job_device_s(renderer, full_frame(renderer), rounds)
    count = len(renderer.plan.beams(range(len(system.wavelengths_m))))
    bandwidth = count * renderer.traffic_bytes / frame_s
    copy_bandwidth = probe_device(device, rounds).copy_bandwidth
    return DeviceTime(1e3 * frame_s, 1e3 * frame_s / count, bandwidth, copy_bandwidth)


def job_device_s(renderer: IncrementalRenderer, job: TimedJob, rounds: int) -> float:
    """Median time (s) of the device in `rounds` runs of a job of the renderer; gaps between its passes don't count.

    Raises UserError if the device has no timestamp queries.
    """
    renderer.timer = GpuTimer(renderer.device)
    seconds = []
    for _ in range(rounds):
        job()
        seconds.append(renderer.timer.take_seconds())
    renderer.timer = None
    return statistics.median(seconds)


# --- a 2-D FFT on the device, and torch.fft for comparison ---


FFT, TORCH_FFT = "FFT2", "torch.fft2, 2 threads"
_TORCH_THREADS, _FFTS_PER_JOB = 2, 4


def fft_jobs(device: Device, shape: tuple[int, int], strategy: Strategy) -> dict[str, TimedJob]:
    """Jobs of four 2-D FFTs each of a complex64 field of `shape` (ny, nx), in memory that is already allocated."""
    parts = np.random.default_rng(0).standard_normal((2, *shape)).astype(np.float32)
    field = (parts[0] + 1j * parts[1]).astype(np.complex64)
    plan = FftPlan(device, shape, strategy=strategy)
    buffer = device.upload(plan.pack(field), "field")
    tensor, out = torch.from_numpy(field), torch.empty(shape, dtype=torch.complex64)

    def device_ffts() -> None:
        recorder = CommandRecorder(device, "FFT2")
        for direction in (plan.forward, plan.inverse) * (_FFTS_PER_JOB // 2):  # alternating, so that values stay finite
            direction(recorder, buffer)
        recorder.submit(wait=True)

    def torch_ffts() -> None:
        with torch_threads(_TORCH_THREADS), torch.inference_mode():
            for _ in range(_FFTS_PER_JOB):
                torch.fft.fft2(tensor, out=out)

    return {FFT: device_ffts, TORCH_FFT: torch_ffts}


# --- a frame and its edits: each criterion is a ratio of two jobs, timed in the same rounds, with a limit ---


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

    timings: by job. strategies: of the FFTs, by job. traffic_bytes: memory traffic of one wavelength. memory_bytes: of
    the device.
    """

    timings: dict[str, JobTimings]
    criteria: list[Criterion]
    wavelengths: int
    strategies: dict[str, Strategy]
    traffic_bytes: int
    memory_bytes: int


def benchmark_frame(
    system: System,
    device: Device,
    rounds: int,
    *,
    half: bool = False,
    strategy: StrategyOption = "auto",
    progress: ProgressCallback = no_progress,
) -> FrameTimings:
    """Time frames and edits of a system at its middle focal plane, in the same rounds as torch.

    A short form has no padding unless the job says otherwise, and is timed with one of its wavelengths, too. A chain
    has its own shapes and padding, and an edit of each element's pattern.

    half: store fields as f16. progress: counts the rounds.
    Raises UserError if the device's limits or memory don't suffice.
    """
    progress(0, 1 + rounds, "the fastest transforms")
    base, others = _unpadded(system), dict[str, System]()
    if not system.is_chain:
        others = {SINGLE: one_wavelength(base), PADDED: system.edit({"propagation": "linear"})}
    opened = partial(open_renderer, device=device, half=half, strategy=strategy)
    renderers = {name: opened(bench) for name, bench in {FULL: base, **others}.items()}
    full = renderers[FULL]
    jobs: dict[str, TimedJob] = {name: full_frame(renderer) for name, renderer in renderers.items()}
    jobs |= {SCRUB: scrub(full), AMPLITUDE: amplitude_edit(opened(base))}
    if system.is_chain:
        jobs |= {f"pattern of {name}": pattern_edit(opened(base), name) for name in base.drive_shapes}
        jobs |= _on_threads(TORCH, {"in turn": stage_loop(shown_plan(full), full.drive)})
    else:
        jobs |= _torch_jobs(TORCH, base) | _torch_jobs(TORCH_SINGLE, others[SINGLE]) | _pruned_jobs(base)
        jobs |= _cuda_jobs(base)
    jobs |= fft_jobs(device, full.plan.grid.padded, full.strategy)
    samples = time_interleaved(jobs, rounds, progress=progress)
    ratios = [] if system.is_chain else _ratios(samples, len(base.wavelengths_m))
    error = intensity_error(renderers.get(SINGLE, full))
    strategies = {name: renderer.strategy for name, renderer in renderers.items()}
    criteria = [_fft_criterion(samples), *ratios, _error_criterion(error)]
    return FrameTimings(samples, criteria, len(base.wavelengths_m), strategies, full.traffic_bytes, full.memory_bytes)


def _unpadded(system: System) -> System:
    """A short form without padding; a chain as it is."""
    return system if system.is_chain else system.edit({"propagation": "periodic"})


def one_wavelength(system: System) -> System:
    """The system with the middle one of its wavelengths only, at unit amplitude."""
    middle = float(system.wavelengths_m[len(system.wavelengths_m) // 2])
    return system.edit({"wavelengths": [middle], "amplitudes": [[1.0]]})


def frame_error(
    system: System, device: Device, half: bool, strategy: StrategyOption, expected: NDArray[np.floating] | None = None
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


def stage_loop(plan: Plan, drive: Any) -> Callable[[], NDArray[np.floating]]:
    """A frame of a chain in PyTorch, complex64, stage by stage, one wavelength after the other.

    Returns a function that computes XYZ (y, x, 3) of the plan's first plane; transfer functions are kept from its first
    call on.
    """
    from holoview.holograms.optimise.chain_executor import ChainExecutor

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


def _ratios(samples: dict[str, JobTimings], wavelengths: int) -> list[Criterion]:
    ms = {name: sample.median_ms for name, sample in samples.items()}
    best, best_single = (
        min(time_ms for name, time_ms in ms.items() if name.startswith(f"{job}:")) for job in (TORCH, TORCH_SINGLE)
    )
    pruned = [time_ms for name, time_ms in ms.items() if name.startswith(f"{TORCH_PRUNED}:")]
    beside_pruned = [Criterion("frame / best pruned torch loop", ms[FULL] / min(pruned), 1.0, 0.85)] if pruned else []
    return [
        Criterion(f"frame / best torch loop, {wavelengths} λ", ms[FULL] / best, 0.80, 0.60),
        *beside_pruned,
        Criterion("frame / best torch loop, 1 λ", ms[SINGLE] / best_single, 1.0, 0.85),
        Criterion("padded (linear) / periodic frame", ms[PADDED] / ms[FULL], 4.0, 3.0),
        Criterion("focal-plane scrub / full frame", ms[SCRUB] / ms[FULL], 0.45, 0.35),
        Criterion("amplitude edit / full frame", ms[AMPLITUDE] / ms[FULL], 0.10, 0.05),
    ]


def _fft_criterion(samples: dict[str, JobTimings]) -> Criterion:
    """The transforms of a device, timed as `fft_jobs`, over those of torch."""
    return Criterion("FFT2 / torch.fft2 on 2 threads", samples[FFT].median_ms / samples[TORCH_FFT].median_ms, 2.0, 1.6)


def _error_criterion(error: float) -> Criterion:
    """The relative L2 error of a frame's intensity against PyTorch in complex128."""
    return Criterion("frame error, relative L2 against complex128", error, 1e-6, 7e-7)


def _torch_jobs(name: str, system: System) -> dict[str, TimedJob]:
    """The same frame in PyTorch: wavelengths one by one or in a batch, on one thread or PyTorch's default number.

    One thread is often faster on a busy machine, where several wait for each other.
    """
    return _on_threads(name, _torch_baselines(system, "cpu"))


def _on_threads(name: str, loops: Mapping[str, Callable[[], object]]) -> dict[str, TimedJob]:
    """Loops in PyTorch by what they are called, on one thread and on PyTorch's default number."""
    return {
        f"{name}: {what}, {threads} threads": partial(_run_on_threads, loop, threads)
        for what, loop in loops.items()
        for threads in sorted({1, torch.get_num_threads()})
    }


def _pruned_jobs(system: System) -> dict[str, TimedJob]:
    """The same frame by loops that compute only what the stops pass, if these pass no more than the first order."""
    plan = _plan_at_middle(system)
    if not can_prune(plan):
        return {}
    inputs = FrameInputs(plan, random_drive(system))
    return _on_threads(TORCH_PRUNED, {way: PrunedTorchBaseline(plan, inputs, way) for way in WAYS})


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


def _run_on_threads(baseline: Callable[[], object], threads: int) -> None:
    """Runs a loop in PyTorch on so many threads."""
    with torch_threads(threads), torch.inference_mode():
        baseline()


def _run_on_cuda(baseline: TorchBaseline) -> None:
    with torch.inference_mode():
        baseline()
    torch.cuda.synchronize()


# --- from the start of a process to its first image ---
#
# Each job is a command in a process of its own: the viewer, and `holoview render` by both backends. "Cold" is with
# empty caches of holoview (declarations of wgpu's library, FFT strategies) and of Mesa's drivers (compiled shaders);
# caches of other drivers aren't emptied. "Warm" is after the same command. The viewer draws off screen and reads its
# frames back; its first image is the quick one where the adapter is slow. The commands run in turn, so that other load
# on the machine slows all of them alike.


COLD, WARM = "first image of the viewer, cold caches", "first image of the viewer, warm caches"
RENDER_COLD, RENDER_WARM = "holoview render, cold caches", "holoview render, warm caches"
RENDER_TORCH = "holoview render --backend torch"
_LIMITS_S, _GOALS_S = {COLD: 3.0, WARM: 1.5}, {COLD: 2.0, WARM: 1.0}
_STARTS_S = 60.0
"""After so long no further round of starts begins."""
_CACHE_VARIABLES = ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR", "LOCALAPPDATA")
_VIEW = ("view", "bench.toml", "--new", "--offscreen", "--until-image")
_RENDER = ("render", "bench.toml", "--random", "0", "--output", "image.png")


@dataclass(frozen=True)
class _Command:
    """Arguments of holoview, whether its caches are warm, and whether it is timed until its first line or its end."""

    arguments: tuple[str, ...]
    is_warm: bool
    until_line: bool = False


def first_image_timings(
    system: System,
    adapter: str | None = None,
    rounds: int = 3,
    *,
    progress: ProgressCallback = no_progress,
    interruption: Callable[[], bool] = lambda: False,
) -> dict[str, JobTimings]:
    """Wall and processor time (s) of each job, `rounds` times; the processor time is that until the process has ended.

    On a machine where processes start slowly, fewer rounds are made. An interruption ends the measurement; jobs that
    were never timed are then absent.
    system: the bench that is shown at one plane. adapter: a part of the name of the WebGPU adapter.
    Raises RuntimeError with what a command printed if it fails.
    """
    on = () if adapter is None else ("--adapter", adapter)
    commands = {
        COLD: _Command((*_VIEW, *on), is_warm=False, until_line=True),
        WARM: _Command((*_VIEW, *on), is_warm=True, until_line=True),
        RENDER_COLD: _Command((*_RENDER, "--backend", "wgpu", *on), is_warm=False),
        RENDER_WARM: _Command((*_RENDER, "--backend", "wgpu", *on), is_warm=True),
        RENDER_TORCH: _Command((*_RENDER, "--backend", "torch"), is_warm=True),
    }
    return _time_commands(system, commands, rounds, progress, interruption)


def first_image_criteria(timings: dict[str, JobTimings]) -> list[Criterion]:
    """The medians of the viewer's first image, with their limits."""
    return [
        Criterion(name, timings[name].median_ms / 1e3, _LIMITS_S[name], _GOALS_S[name], "s")
        for name in (COLD, WARM)
        if name in timings
    ]


def first_image_criterion(system: System, adapter: str | None = None) -> Criterion:
    """The time to the viewer's first image with cold caches, once, with its limit."""
    on = () if adapter is None else ("--adapter", adapter)
    command = _Command((*_VIEW, *on), is_warm=False, until_line=True)
    return first_image_criteria(_time_commands(system, {COLD: command}, 1))[0]


def _time_commands(
    system: System,
    commands: dict[str, _Command],
    rounds: int,
    progress: ProgressCallback = no_progress,
    interruption: Callable[[], bool] = lambda: False,
) -> dict[str, JobTimings]:
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
    for name, sample in _command_runs(system, commands, rounds, progress, interruption):
        samples[name].append(sample)
    return {name: JobTimings(*zip(*pairs, strict=True)) for name, pairs in samples.items() if pairs}


def _command_runs(
    system: System,
    commands: dict[str, _Command],
    rounds: int,
    progress: ProgressCallback,
    interruption: Callable[[], bool],
) -> Iterator[tuple[str, tuple[float, float]]]:
    """The timed runs of commands, round by round, after one of each that needs warm caches."""
    warming = [name for name, command in commands.items() if command.is_warm]
    plan = [(-1, name) for name in warming] + [(number, name) for number in range(rounds) for name in commands]
    deadline = time.perf_counter() + _STARTS_S
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "bench.toml").write_text(preset.dumps(system), encoding="utf-8")
        for done, (number, job) in enumerate(plan):
            is_next_round = number > 0 and plan[done - 1][0] < number
            if interruption() or (is_next_round and time.perf_counter() > deadline):
                return
            progress(done, len(plan), job)
            caches = folder / ("warm" if commands[job].is_warm else f"cold {number} {job}")
            try:
                sample = _run(commands[job], folder, caches)
            except RuntimeError:
                if interruption():  # which the command was told as well
                    return
                raise
            if number >= 0:
                yield job, sample


def _run(command: _Command, folder: Path, caches: Path) -> tuple[float, float]:
    """Wall and processor time (s) of a command that runs in `folder`, with its caches in another."""
    caches.mkdir(exist_ok=True)
    environment = os.environ | dict.fromkeys(_CACHE_VARIABLES, str(caches))
    words: Sequence[str] = (sys.executable, "-m", "holoview", *command.arguments)
    cpu_start, start = _cpu_s_of_children(), time.perf_counter()
    with (folder / "errors.txt").open("w+", encoding="utf-8", errors="replace") as errors:
        process = subprocess.Popen(
            words, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True, encoding="utf-8"
        )
        with process:
            assert process.stdout is not None
            line = process.stdout.readline()
            until_line_s = time.perf_counter() - start
            process.stdout.read()
        seconds = until_line_s if command.until_line else time.perf_counter() - start
        if process.returncode or not line:
            errors.seek(0)
            raise RuntimeError(f"holoview {' '.join(command.arguments)}: {errors.read().strip()}")
    return seconds, _cpu_s_of_children() - cpu_start


def _cpu_s_of_children() -> float:
    """Processor time (s) of all processes that this one has started and waited for; 0 where that isn't counted."""
    times = os.times()
    return float(times.children_user + times.children_system)
