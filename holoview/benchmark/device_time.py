"""Measures a frame by the device's own clock, and the share of the memory bandwidth that it reaches."""

from __future__ import annotations

import statistics
import time
from dataclasses import asdict, dataclass
from typing import Any

from holoview.benchmark.strategy_choice import resolve_strategy
from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import Device
from holoview.gpu.recorder import CommandRecorder
from holoview.gpu.timer import GpuTimer
from holoview.gpu.tune import StrategyOption
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.view import random_drive

_COPIES = 16
_COPY_BYTES = 2**26


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
    chosen = resolve_strategy(device, make_plan(periodic).grid.padded, strategy)
    renderer = IncrementalRenderer(periodic, random_drive(periodic), device, half=half, strategy=chosen)
    renderer.update(with_srgb=False)
    renderer.timer = GpuTimer(device)
    seconds = []
    for _ in range(rounds):
        renderer.invalidate()
        renderer.update(with_srgb=False)
        seconds.append(renderer.timer.take_seconds())
    frame_s, count = statistics.median(seconds), len(periodic.wavelengths_m)
    bandwidth = count * renderer.traffic_bytes / frame_s
    return DeviceTime(1e3 * frame_s, 1e3 * frame_s / count, bandwidth, _copy_bandwidth(device, rounds))


def _copy_bandwidth(device: Device, rounds: int) -> float:
    """Bandwidth (bytes/s, read plus written) of copying one large buffer to another."""
    source, target = (device.buffer(_COPY_BYTES, f"{name} of a copy") for name in ("source", "target"))
    seconds = []
    for _ in range(rounds + 1):
        recorder = CommandRecorder(device, "copies")
        for _ in range(_COPIES):
            recorder.copy(source, target)
        device.wait()
        start = time.perf_counter()
        recorder.submit(wait=True)
        seconds.append(time.perf_counter() - start)
    return 2 * _COPIES * _COPY_BYTES / statistics.median(seconds[1:])
