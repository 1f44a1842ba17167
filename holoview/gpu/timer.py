"""Measures the time that compute passes take on the device, by timestamp queries at their start and end."""

from __future__ import annotations

from typing import Any

import numpy as np
import wgpu

from holoview.gpu.device import TIMESTAMPS, Device
from holoview.util.errors import UserError

_MAX_QUERIES = 4096  # of a query set, by the WebGPU specification
_TIMESTAMP_BYTES = 8


class GpuTimer:
    """Sums the device time of the compute passes of all recorders that were created with this timer.

    passes: the most compute passes between two calls of `take_seconds`; further ones aren't timed.
    Raises UserError if the device has no timestamp queries.
    """

    def __init__(self, device: Device, passes: int = 1024) -> None:
        if TIMESTAMPS not in device.features:
            raise UserError(
                f"adapter {device.info.label}", "has no timestamp queries", remedy="time it by the clock on the wall"
            )
        self._device = device
        self._count = min(2 * passes, _MAX_QUERIES)
        self._queries = device.raw.create_query_set(type="timestamp", count=self._count)
        usage = wgpu.BufferUsage.QUERY_RESOLVE | wgpu.BufferUsage.COPY_SRC
        self._resolved = device.raw.create_buffer(size=self._count * _TIMESTAMP_BYTES, usage=usage)
        self._used = 0

    def timestamp_writes(self) -> dict[str, Any] | None:
        """The `timestamp_writes` argument of the next compute pass; None when all queries are in use."""
        if self._used + 2 > self._count:
            return None
        self._used += 2
        indices = {"beginning_of_pass_write_index": self._used - 2, "end_of_pass_write_index": self._used - 1}
        return {"query_set": self._queries, **indices}

    def take_seconds(self) -> float:
        """Sum of the durations (s) of all passes since the last call; waits until they have run. Gaps don't count."""
        if not self._used:
            return 0.0
        self._device.check_alive()
        encoder = self._device.raw.create_command_encoder(label="timestamps")
        encoder.resolve_query_set(self._queries, 0, self._used, self._resolved, 0)
        self._device.raw.queue.submit([encoder.finish()])
        data = self._device.raw.queue.read_buffer(self._resolved, 0, self._used * _TIMESTAMP_BYTES)
        ticks = np.frombuffer(data, np.uint64).reshape(-1, 2).astype(np.int64)
        self._used = 0
        return float((ticks[:, 1] - ticks[:, 0]).sum()) * self._tick_s()

    def _tick_s(self) -> float:
        """Seconds per tick of the device's clock. WebGPU has no call for it, so this asks the native queue of wgpu."""
        from wgpu.backends.wgpu_native import lib as native  # here: importing it loads the backend, see `binding`

        nanoseconds: float = native.wgpuQueueGetTimestampPeriod(self._device.raw.queue._internal)
        return nanoseconds * 1e-9
