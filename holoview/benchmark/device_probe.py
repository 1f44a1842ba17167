"""What a device can do at best: bandwidth of a copy, time of an empty submission, time of a dispatch.

A frame's share of the memory bandwidth refers to the first; the other two tell what part of a short frame is overhead.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

from holoview.gpu.device import Buffer, Device
from holoview.gpu.recorder import CommandRecorder, Dispatch, workgroup_grid
from holoview.gpu.shader import link
from holoview.numerics.sampling import ceil_div

_COPY_BYTES, _CPU_COPY_BYTES = 2**28, 2**25
"""Size of the copied buffer: more than a card's cache holds; less on CPU adapters, which take long."""
_COPIES, _CPU_COPIES = (4, 20), (1, 4)
"""Few and many copies: the difference of two such submissions is free of the time that a submission takes."""
_DISPATCHES = (20, 220)
_WORKGROUP = 256  # of shaders/benchmark/copy.wgsl
_VEC4_BYTES = 16


@dataclass(frozen=True)
class DeviceProbe:
    """Bandwidths (bytes/s, read plus written) of copies by command and by shader, and overheads (s).

    submission_s: of an empty submission and waiting for its end. check_s: of the check that precedes each submission,
    whether the device is still there. dispatch_s: of a dispatch that does next to nothing, after another.
    """

    copy_command: float
    copy_shader: float
    copy_bytes: int
    submission_s: float
    check_s: float
    dispatch_s: float

    @property
    def copy_bandwidth(self) -> float:
        """The greater of the two bandwidths."""
        return max(self.copy_command, self.copy_shader)


def probe_device(device: Device, rounds: int, copy_bytes: int | None = None) -> DeviceProbe:
    """Measure a device; medians of `rounds` differences.

    copy_bytes: size of the copied buffer; by default 256 MiB (32 MiB on a CPU adapter) or the most that the device
    allows. Raises UserError if that is too much for the device's memory.
    """
    allowed = min(device.limits["max-buffer-size"], device.limits["max-storage-buffer-binding-size"])
    wanted, copies = (_CPU_COPY_BYTES, _CPU_COPIES) if device.info.is_cpu else (_COPY_BYTES, _COPIES)
    nbytes = copy_bytes or min(wanted, allowed - allowed % _VEC4_BYTES)
    source, target = (device.buffer(nbytes, f"{name} of a copy") for name in ("source", "target"))

    def command(recorder: CommandRecorder) -> None:
        recorder.copy(source, target)

    large = copy_dispatch(device, source, target)
    small = copy_dispatch(device, *(device.buffer(_VEC4_BYTES, f"small {i}") for i in (0, 1)))
    moved = 2 * nbytes
    return DeviceProbe(
        copy_command=moved / _step_s(device, command, copies, rounds),
        copy_shader=moved / _step_s(device, lambda recorder: recorder.add(large), copies, rounds),
        copy_bytes=nbytes,
        submission_s=statistics.median(_submission_s(device, command, 0) for _ in range(rounds)),
        check_s=statistics.median(_check_s(device) for _ in range(rounds)),
        dispatch_s=_step_s(device, lambda recorder: recorder.add(small), _DISPATCHES, rounds),
    )


def copy_dispatch(device: Device, source: Buffer, target: Buffer) -> Dispatch:
    """The dispatch of a shader that copies `source` to `target`, whose size is a multiple of 16 bytes."""
    pipeline = device.pipeline(link("benchmark/copy.wgsl"))
    groups = workgroup_grid(ceil_div(target.nbytes, _WORKGROUP * _VEC4_BYTES), device)
    return Dispatch.bind(device, pipeline, [[source, target]], (*groups, 1))


def _step_s(device: Device, record: Callable[[CommandRecorder], None], counts: tuple[int, int], rounds: int) -> float:
    """Time (s) of one recorded step: the difference of submissions with many and with few of them, `counts`.

    Where noise hides the difference, the whole time of the many, which is an upper limit.
    """
    few, many = counts
    for count in counts:
        _submission_s(device, record, count)
    pairs = [[_submission_s(device, record, count) for count in counts] for _ in range(rounds)]
    short, long = (statistics.median(times) for times in zip(*pairs, strict=True))
    return (long - short) / (many - few) if long > short else long / many


def _submission_s(device: Device, record: Callable[[CommandRecorder], None], count: int) -> float:
    """Time (s) from submitting `count` recorded steps to their end."""
    recorder = CommandRecorder(device, "probe")
    for _ in range(count):
        record(recorder)
    device.wait()
    start = time.perf_counter()
    recorder.submit(wait=True)
    return time.perf_counter() - start


def _check_s(device: Device) -> float:
    """Time (s) of a check whether the device is still there."""
    start = time.perf_counter()
    device.check_alive()
    return time.perf_counter() - start
