"""Shaders compiled ahead: handed to the device together, run once on memory that holds nothing.

Drivers that run shaders on the processor compile them when they first run, in a thread of their own. What has been
submitted is compiled while the program goes on with something else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from holoview.gpu.device import Buffer, Device
from holoview.gpu.line_fft import TransformShader
from holoview.gpu.recorder import CommandRecorder, Dispatch

_BYTES = 1 << 16


def precompile(device: Device, stages: Iterable[TransformShader]) -> None:
    """Compile shaders; one that is compiled when it first runs need not be when this returns.

    Raises ShaderError and UserError as `Device.pipeline` does.
    """
    recorder = CommandRecorder(device, "shaders")
    for stage in stages:
        declared = stage.source.buffer_bindings() or {}
        groups = [_memory(device, declared.get(number, {})) for number in range(max(declared, default=-1) + 1)]
        recorder.add(Dispatch.bind(device, device.pipeline(stage.source, stage.constants), groups, (1, 1, 1)))
    recorder.submit()


def _memory(device: Device, bindings: Mapping[int, str]) -> list[Buffer | None]:
    """A buffer for each binding of a group, and None where a number is left out."""
    made: list[Buffer | None] = [None] * (max(bindings, default=-1) + 1)
    for binding, kind in bindings.items():
        is_uniform = kind == "uniform"
        made[binding] = device.uniform(bytes(_BYTES), "nothing") if is_uniform else device.buffer(_BYTES, "nothing")
    return made
