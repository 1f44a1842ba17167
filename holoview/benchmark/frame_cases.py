"""Times frames and edits of one case: a size, a number of wavelengths, a strategy, and wavelengths in a dispatch."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from holoview.benchmark.device_time import job_device_s
from holoview.benchmark.frame_jobs import amplitude_edit, frames_in_a_row, full_frame, gap_edit, open_renderer, scrub
from holoview.benchmark.timing import TimedJob, time_interleaved
from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import TIMESTAMPS, Device
from holoview.gpu.line_fft import Strategy
from holoview.model.system import System

FRAME, IN_A_ROW, SCRUB, GAP, AMPLITUDES = "frame", "frame in a row", "focal plane", "gap", "amplitudes"
_ROW_S = 0.05
"""Least duration of frames in a row, in which the wait at their end is a small part."""
_MAX_ROW = 64
_F32, _XYZ_PIXEL_BYTES = 4, 16


@dataclass(frozen=True)
class FrameCase:
    """What is timed. size: simulated samples, x by y. per_dispatch: how many wavelengths a dispatch computes."""

    size: tuple[int, int]
    wavelengths: int
    strategy: Strategy
    per_dispatch: int = 1

    @property
    def label(self) -> str:
        """The case in a few words."""
        together = f", {self.per_dispatch} in a dispatch" if self.per_dispatch > 1 else ""
        return f"{self.size[0]} × {self.size[1]}, {self.wavelengths} λ, {self.strategy}{together}"


def case_system(base: System, size: tuple[int, int], wavelengths: int) -> System:
    """A bench without padding, of `size` samples (x, y) and so many lasers of equal amplitude, all lit in one frame.

    One laser is the middle one of the bench; several are evenly spaced over its range. Raises UserError for a size
    that isn't a multiple of the bench's upsampling, as `System.edit` does for other impossible values.
    """
    lowest, highest = float(base.wavelengths_m.min()), float(base.wavelengths_m.max())
    middle = float(base.wavelengths_m[len(base.wavelengths_m) // 2])
    chosen = [middle] if wavelengths == 1 else np.linspace(lowest, highest, wavelengths).tolist()
    columns, rows = (n // base.sampling.upsample for n in size)
    return base.edit(
        {
            "wavelengths": chosen,
            "amplitudes": [[1.0] * wavelengths],
            "shape": [rows, columns],
            "propagation": "periodic",
        }
    )


def time_case(device: Device, base: System, case: FrameCase, rounds: int, limit_s: float) -> dict[str, Any]:
    """Times of a case as JSON values, ms; its device times are absent where the device has no timestamps.

    host_ms: processor time of recording and submitting a frame.

    limit_s: no further round begins after this time. Raises UserError if the device's limits or memory don't suffice.
    """
    system = case_system(base, case.size, case.wavelengths)
    start = time.perf_counter()
    renderer = open_renderer(system, device, strategy=case.strategy, max_wavelengths=case.per_dispatch)
    device.wait()
    first_s = time.perf_counter() - start
    jobs = _jobs(renderer, _row_length(renderer))
    timings = time_interleaved({name: job for name, (job, _) in jobs.items()}, rounds, limit_s=limit_s)
    result = asdict(case) | {
        "size": list(case.size),
        "first_frame_ms": 1e3 * first_s,
        "median_ms": {name: timings[name].median_ms / count for name, (_, count) in jobs.items()},
        "minimum_ms": {name: timings[name].minimum_ms / count for name, (_, count) in jobs.items()},
        "host_ms": 1e3 * _host_s(renderer, len(timings[FRAME].seconds)),
        "rounds": len(timings[FRAME].seconds),
        "frame_bytes": frame_bytes(renderer),
        "memory_bytes": renderer.memory_bytes,
    }
    if TIMESTAMPS not in device.features:
        return result
    timed = {name: job for name, (job, _) in jobs.items() if name != IN_A_ROW}
    repeats = len(timings[FRAME].seconds)
    return result | {"device_ms": {name: 1e3 * job_device_s(renderer, job, repeats) for name, job in timed.items()}}


def frame_bytes(renderer: IncrementalRenderer) -> int:
    """Bytes that the kernels of a frame must read and write, from the source to XYZ, for one frame and source.

    The fields between the kernels of each wavelength, the patterns, the intensities (written once, read once), and XYZ.
    What a strategy moves between the passes of one transform isn't counted.
    """
    wavelengths, samples = len(renderer.system.wavelengths_m), math.prod(renderer.compositor.shape)
    return wavelengths * (renderer.traffic_bytes + samples * _F32) + samples * _XYZ_PIXEL_BYTES


def parts_ms(case: Mapping[str, Any]) -> dict[str, float]:
    """Device times (ms) of the parts of a frame, as differences of edits that begin at different kernels.

    Empty without device times, and for a bench with one modulator.
    """
    device = case.get("device_ms", {})
    if GAP not in device:
        return {}
    return {
        "light": device[FRAME] - device[GAP],
        "propagate, modulate": device[GAP] - device[SCRUB],
        "propagate, observe": device[SCRUB] - device[AMPLITUDES],
        "composite": device[AMPLITUDES],
    }


def _jobs(renderer: IncrementalRenderer, row: int) -> dict[str, tuple[TimedJob, int]]:
    """What is timed by name, each with how often it does what its name says."""
    gap = gap_edit(renderer)
    return {
        FRAME: (full_frame(renderer), 1),
        IN_A_ROW: (frames_in_a_row(renderer, row), row),
        SCRUB: (scrub(renderer), 1),
        **({} if gap is None else {GAP: (gap, 1)}),
        AMPLITUDES: (amplitude_edit(renderer), 1),
    }


def _host_s(renderer: IncrementalRenderer, rounds: int) -> float:
    """Processor time (s) of this thread for recording and submitting a frame: a card can't be faster than that."""
    seconds = []
    for _ in range(rounds):
        renderer.invalidate()
        start = time.thread_time()
        renderer.update(with_srgb=False)
        seconds.append(time.thread_time() - start)
        renderer.device.wait()
    return statistics.median(seconds)


def _row_length(renderer: IncrementalRenderer) -> int:
    """How many frames in a row take at least _ROW_S."""
    job = full_frame(renderer)
    job()
    start = time.perf_counter()
    job()
    return min(_MAX_ROW, math.ceil(_ROW_S / (time.perf_counter() - start)))
