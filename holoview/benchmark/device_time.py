"""Measures a frame by the device's own clock, and the share of the memory bandwidth that it reaches."""

from __future__ import annotations

import statistics
from dataclasses import asdict, dataclass
from typing import Any

from holoview.benchmark.device_probe import probe_device
from holoview.benchmark.frame_jobs import full_frame, open_renderer
from holoview.benchmark.timing import TimedJob
from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import Device
from holoview.gpu.recorder import GpuTimer
from holoview.gpu.tune import StrategyOption
from holoview.model.system import System


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
    """Median of `rounds` frames of a system without padding, after one that isn't timed.

    Raises UserError if the device has no timestamp queries.
    """
    periodic = system.edit({"propagation": "periodic"})
    renderer = open_renderer(periodic, device, half, strategy)
    frame_s, count = job_device_s(renderer, full_frame(renderer), rounds), len(periodic.wavelengths_m)
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
