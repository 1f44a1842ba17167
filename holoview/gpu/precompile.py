"""Compiles shaders before they are needed: all are dispatched once, in one submission, on otherwise unused buffers.

Drivers that execute shaders on the CPU compile a shader when it first runs, in a thread of their own. Such a driver
compiles the submitted shaders while the program continues.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from holoview.gpu.device import Buffer, Device
from holoview.gpu.line_fft import TransformShader
from holoview.gpu.recorder import CommandRecorder, Dispatch

_BUFFER_BYTES = 1 << 16


def precompile(device: Device, shaders: Iterable[TransformShader]) -> None:
    """Create the pipelines of shaders and dispatch each once; doesn't wait until the driver has finished.

    Raises ShaderError and DeviceLost as `Device.pipeline` does.
    """
    recorder = CommandRecorder(device, "shaders")
    for shader in shaders:
        declared = shader.source.buffer_bindings() or {}
        groups = [_dummy_buffers(device, declared.get(number, {})) for number in range(max(declared, default=-1) + 1)]
        recorder.add(Dispatch.bind(device, device.pipeline(shader.source, shader.constants), groups, (1, 1, 1)))
    recorder.submit()


def _dummy_buffers(device: Device, bindings: Mapping[int, str]) -> list[Buffer | None]:
    """A zero buffer for each binding of a group, and None for each unused binding number."""
    buffers: list[Buffer | None] = [None] * (max(bindings, default=-1) + 1)
    for binding, kind in bindings.items():
        is_uniform = kind == "uniform"
        buffers[binding] = (
            device.uniform(bytes(_BUFFER_BYTES), "precompile")
            if is_uniform
            else device.buffer(_BUFFER_BYTES, "precompile")
        )
    return buffers
