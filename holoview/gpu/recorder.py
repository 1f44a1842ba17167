"""Passes and their recording into one submission."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from holoview.gpu.device import Buffer, Device, Pipeline
from holoview.gpu.timer import GpuTimer
from holoview.util.errors import UserError

Workgroups = tuple[int, int, int]
_DISPATCH_LIMIT = "max-compute-workgroups-per-dimension"


@dataclass(frozen=True, eq=False)
class Dispatch:
    """A dispatch, bound once and recorded often: pipeline, bind groups by their number, workgroups along x, y, z."""

    pipeline: Pipeline
    bind_groups: tuple[tuple[int, Any], ...]
    workgroups: Workgroups

    @classmethod
    def bind(
        cls, device: Device, pipeline: Pipeline, groups: Sequence[Sequence[Buffer | Any | None]], workgroups: Workgroups
    ) -> Dispatch:
        """Bind `groups[g][b]` to `@group(g) @binding(b)`: a Buffer, or a wgpu texture view or sampler.

        A group that the shader doesn't have stays empty, and so does a binding whose resource is None.
        Raises UserError when the dispatch is too large.
        """
        check_workgroups(device, pipeline.label, workgroups)
        bound = []
        for number, resources in enumerate(groups):
            if resources:
                entries = [{"binding": b, "resource": _resource(r)} for b, r in enumerate(resources) if r]
                layout = pipeline.raw.get_bind_group_layout(number)
                bound.append((number, device.raw.create_bind_group(layout=layout, entries=entries)))
        return cls(pipeline, tuple(bound), workgroups)


class CommandRecorder:
    """Collects passes, copies and clears in order, and submits them once.

    Each dispatch sees what the ones before it wrote. A timer takes the time of the dispatches on the device.
    """

    def __init__(self, device: Device, label: str = "", timer: GpuTimer | None = None) -> None:
        self._device, self._timer = device, timer
        self._encoder = device.raw.create_command_encoder(label=label)
        self._compute: Any = None
        self._submitted = False
        self._then: list[Callable[[], None]] = []

    def add(self, step: Dispatch) -> None:
        """Record a dispatch."""
        self._check_open()
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
        """Has a call made once all that was recorded is submitted, such as noting that results are valid."""
        self._then.append(call)

    def submit(self, wait: bool = False) -> None:
        """Run what was recorded, once; with `wait`, return when it has run. Raises DeviceLost."""
        self._end_pass()
        self._device.check_alive()
        self._submitted = True
        self._device.raw.queue.submit([self._encoder.finish()])
        for call in self._then:
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
    """A recorder whose steps are submitted a few at a time, by `play`, so that other work comes in between.

    Where it isn't played to its end, nothing that was to follow is called.
    """

    def __init__(self, device: Device, label: str = "", timer: GpuTimer | None = None) -> None:
        super().__init__(device, label, timer)
        self._steps: list[Callable[[CommandRecorder], None]] = []
        self._label, self._next = label, 0

    @property
    def remaining(self) -> int:
        """Steps that aren't submitted yet."""
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
        """Submit the next `count` steps; with `wait`, return when they have run. Raises DeviceLost."""
        recorder = CommandRecorder(self._device, self._label, self._timer)
        for step in self._steps[self._next : self._next + count]:
            step(recorder)
        self._next = min(self._next + count, len(self._steps))
        if self.remaining == 0:
            recorder._then = self._then
        recorder.submit(wait)

    def submit(self, wait: bool = False) -> None:
        """Submit all that is left."""
        self.submit_next(self.remaining, wait)


def workgroup_grid(workgroups: int, device: Device) -> tuple[int, int]:
    """Counts along x and y that make at least `workgroups`, each within the device's limit.

    The shader numbers them as `id.y * num_workgroups.x + id.x` and ignores those beyond the end.
    """
    rows = -(-workgroups // device.limits[_DISPATCH_LIMIT])
    return -(-workgroups // rows), rows


def check_workgroups(device: Device, label: str, workgroups: Workgroups) -> None:
    """Raise UserError when a dispatch has more workgroups along an axis than the device allows."""
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


def _resource(resource: Buffer | Any) -> Any:
    if isinstance(resource, Buffer):
        return {"buffer": resource.raw, "offset": 0, "size": resource.raw.size}
    return resource
