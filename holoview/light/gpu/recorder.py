"""Records dispatches, copies and clears into one command buffer and submits it, at once or in slices."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import wgpu

from holoview.light.gpu.device import TIMESTAMPS, Buffer, Device, Pipeline
from holoview.light.gpu.texels import Texels
from holoview.light.numerics.sampling import ceil_div
from holoview.util.errors import UserError

Workgroups = tuple[int, int, int]
_DISPATCH_LIMIT = "max-compute-workgroups-per-dimension"


@dataclass(frozen=True, eq=False)
class Dispatch:
    """A dispatch with its resources bound, to be recorded any number of times.

    bind_groups: (number, wgpu bind group). workgroups: counts along x, y and z. texels: copied before it runs.
    """

    pipeline: Pipeline
    bind_groups: tuple[tuple[int, Any], ...]
    workgroups: Workgroups
    texels: tuple[Texels, ...] = ()

    @classmethod
    def bind(
        cls, device: Device, pipeline: Pipeline, groups: Sequence[Sequence[Any]], workgroups: Workgroups
    ) -> Dispatch:
        """Bind `groups[g][b]`, a Buffer, Texels or a wgpu texture view or sampler, to `@group(g) @binding(b)`.

        Empty groups and bindings that are None are left out. Raises UserError if a count of workgroups exceeds the
        device's limit.
        """
        check_workgroups(device, pipeline.label, workgroups)
        bound = []
        for number, resources in enumerate(groups):
            if resources:
                entries = [{"binding": b, "resource": _resource(r)} for b, r in enumerate(resources) if r]
                layout = pipeline.raw.get_bind_group_layout(number)
                bound.append((number, device.raw.create_bind_group(layout=layout, entries=entries)))
        texels = tuple(each for resources in groups for each in resources if isinstance(each, Texels))
        return cls(pipeline, tuple(bound), workgroups, texels)


class CommandRecorder:
    """Records dispatches, copies and clears in order, and submits them once.

    Each dispatch sees what earlier ones have written. A timer, if given, measures the device time of the dispatches.
    """

    def __init__(self, device: Device, label: str = "", timer: GpuTimer | None = None) -> None:
        self._device, self._timer = device, timer
        self._encoder = device.raw.create_command_encoder(label=label)
        self._compute: Any = None
        self._submitted = False
        self._callbacks: list[Callable[[], None]] = []

    def add(self, step: Dispatch) -> None:
        """Record a dispatch."""
        self._check_open()
        if step.texels:
            self._end_pass()
            for texels in step.texels:
                texels.record(self._encoder)
        if self._compute is None:
            timed = self._timer.timestamp_writes() if self._timer else None
            self._compute = self._encoder.begin_compute_pass(timestamp_writes=timed)
        self._compute.set_pipeline(step.pipeline.raw)
        for number, group in step.bind_groups:
            self._compute.set_bind_group(number, group)
        self._compute.dispatch_workgroups(*step.workgroups)

    def clear(self, buffer: Buffer) -> None:
        """Record filling `buffer` with zeros."""
        self._end_pass()
        self._encoder.clear_buffer(buffer.raw)

    def copy(self, source: Buffer, target: Buffer) -> None:
        """Record copying all of `source` to the start of `target`."""
        if source.raw.size > target.raw.size:
            raise ValueError(f"{source.label} ({source.nbytes} bytes) doesn't fit {target.label} ({target.nbytes})")
        self._end_pass()
        self._encoder.copy_buffer_to_buffer(source.raw, 0, target.raw, 0, source.raw.size)

    def on_submit(self, call: Callable[[], None]) -> None:
        """Call a function after all recorded work has been submitted, for example to mark results as valid."""
        self._callbacks.append(call)

    def submit(self, wait: bool = False) -> None:
        """Submit the recorded work, once; with `wait`, return after it has run. Raises DeviceLost."""
        self._end_pass()
        self._device.check_alive()
        self._submitted = True
        self._device.raw.queue.submit([self._encoder.finish()])
        for call in self._callbacks:
            call()
        if wait:
            self._device.wait()

    def _end_pass(self) -> None:
        self._check_open()
        if self._compute is not None:
            self._compute.end()
            self._compute = None

    def _check_open(self) -> None:
        if self._submitted:
            raise RuntimeError("a recorder runs once: make a new one for the next submission")


class SlicedRecorder(CommandRecorder):
    """A recorder whose steps are submitted a few at a time by `submit_next`, so that other work can run in between.

    Functions given to `on_submit` are called after the last step only.
    """

    def __init__(self, device: Device, label: str = "", timer: GpuTimer | None = None) -> None:
        super().__init__(device, label, timer)
        self._steps: list[Callable[[CommandRecorder], None]] = []
        self._label, self._next = label, 0

    @property
    def remaining(self) -> int:
        """Number of steps that haven't been submitted yet."""
        return len(self._steps) - self._next

    def add(self, step: Dispatch) -> None:
        """Record a dispatch."""
        self._steps.append(lambda recorder: recorder.add(step))

    def clear(self, buffer: Buffer) -> None:
        """Record filling `buffer` with zeros."""
        self._steps.append(lambda recorder: recorder.clear(buffer))

    def copy(self, source: Buffer, target: Buffer) -> None:
        """Record copying all of `source` to the start of `target`."""
        self._steps.append(lambda recorder: recorder.copy(source, target))

    def submit_next(self, count: int, wait: bool = False) -> None:
        """Submit the next `count` steps; with `wait`, return after they have run. Raises DeviceLost."""
        recorder = CommandRecorder(self._device, self._label, self._timer)
        for step in self._steps[self._next : self._next + count]:
            step(recorder)
        self._next = min(self._next + count, len(self._steps))
        if self.remaining == 0:
            for call in self._callbacks:
                recorder.on_submit(call)
        recorder.submit(wait)

    def submit(self, wait: bool = False) -> None:
        """Submit all remaining steps."""
        self.submit_next(self.remaining, wait)


Submission = Callable[[CommandRecorder], None]
"""Records the work of one submission."""

_MAX_DISPATCHES = 256.0  # of a slice


class Submitter:
    """Submits work to a device, at once or in slices of about equal time.

    A `timer`, if set, measures the device time of all dispatches.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._slice_dispatches = 1.0
        self.timer: GpuTimer | None = None

    def submit(self, submission: Submission, *, wait: bool = False) -> None:
        """Submit all of it at once; with `wait`, return after it has run."""
        recorder = CommandRecorder(self._device, "frame", self.timer)
        submission(recorder)
        recorder.submit(wait=wait)

    def submit_sliced(self, submission: Submission, slice_s: float) -> Iterator[None]:
        """Submit it in slices, wait for each, and yield between them.

        The number of dispatches in a slice follows the measured time, so that a slice takes about `slice_s` seconds; it
        changes by a factor of 2 at most from one slice to the next.
        """
        recorder = SlicedRecorder(self._device, "frame", self.timer)
        submission(recorder)
        while True:
            count, start = max(min(round(self._slice_dispatches), recorder.remaining), 1), time.perf_counter()
            recorder.submit_next(count, wait=True)
            elapsed_s = max(time.perf_counter() - start, 1e-6)
            least, most = self._slice_dispatches / 2, 2 * self._slice_dispatches
            self._slice_dispatches = min(max(count * slice_s / elapsed_s, least), most, _MAX_DISPATCHES)
            if recorder.remaining == 0:
                return
            yield


def workgroup_grid(workgroups: int, device: Device) -> tuple[int, int]:
    """Counts along x and y whose product is at least `workgroups`, each within the device's limit.

    A shader numbers its workgroup as `id.y * num_workgroups.x + id.x` and ignores numbers from `workgroups` on.
    """
    rows = ceil_div(workgroups, device.limits[_DISPATCH_LIMIT])
    return ceil_div(workgroups, rows), rows


def check_workgroups(device: Device, label: str, workgroups: Workgroups) -> None:
    """Raise UserError if a dispatch has more workgroups along an axis than the device allows."""
    limit = device.limits[_DISPATCH_LIMIT]
    if max(workgroups) > limit:
        raise UserError(
            f"dispatch of '{label}'",
            f"{' × '.join(map(str, workgroups))} workgroups",
            expected=f"at most {limit} along an axis ({_DISPATCH_LIMIT} of {device.info.name})",
            remedy="lower the size of the grid or the number of fields at a time",
        )
    if min(workgroups) < 1:
        raise ValueError(f"dispatch of '{label}': {workgroups} workgroups")


def _resource(resource: Buffer | Texels | Any) -> Any:
    if isinstance(resource, Texels):
        return resource.view
    if isinstance(resource, Buffer):
        return {"buffer": resource.raw, "offset": 0, "size": resource.raw.size}
    return resource


# --- time of compute passes -------------------------------------------------------------------------------------------


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
