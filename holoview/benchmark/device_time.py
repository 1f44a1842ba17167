"""Time that a frame takes on the device by its own clock, and the share of the memory bandwidth that it reaches."""

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
    """Of a frame and of each wavelength of it, ms; bandwidths in bytes a second, both read and written bytes."""

    frame_ms: float
    wavelength_ms: float
    bandwidth: float
    copy_bandwidth: float

    def as_dict(self) -> dict[str, Any]:
        """For programs."""
        return asdict(self) | {"share_of_copy": self.bandwidth / self.copy_bandwidth}


def device_time(
    system: System, device: Device, rounds: int, *, half: bool = False, strategy: StrategyOption = "auto"
) -> DeviceTime:
    """Times warm frames of a periodic bench. Raises UserError where the device has no timestamp queries."""
    periodic = system.edit({"propagation": "periodic"})
    chosen = resolve_strategy(device, make_plan(periodic).grid.padded, strategy)
    session = IncrementalRenderer(periodic, random_drive(periodic), device, half=half, strategy=chosen)
    session.update(with_srgb=False)
    session.timer = GpuTimer(device)
    seconds = []
    for _ in range(rounds):
        session.invalidate()
        session.update(with_srgb=False)
        seconds.append(session.timer.take_seconds())
    taken, count = statistics.median(seconds), len(periodic.wavelengths_m)
    bandwidth = count * session.traffic_bytes / taken
    return DeviceTime(1e3 * taken, 1e3 * taken / count, bandwidth, _copy_bandwidth(device, rounds))


def _copy_bandwidth(device: Device, rounds: int) -> float:
    """Bytes a second, read and written, of copying one large buffer to another."""
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
