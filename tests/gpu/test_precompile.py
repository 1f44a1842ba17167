"""Shaders that are compiled ahead: whatever they bind, and without being bound to anything of the program."""

from __future__ import annotations

import pytest

from holoview.gpu.device import Device
from holoview.gpu.line_fft import TransformShader
from holoview.gpu.precompile import precompile
from holoview.gpu.shader import GeneratedWgsl, ShaderError, link

pytestmark = pytest.mark.gpu

LEFT_OUT = """
@group(0) @binding(0) var<uniform> factor: vec4f;
@group(1) @binding(1) var<storage, read> given: array<f32>;
@group(1) @binding(3) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(1) fn main() { out[0] = factor.x * given[0]; }
"""


def _stage(text: str) -> TransformShader:
    return TransformShader(link(GeneratedWgsl("probe", text)), {}, lambda lines: lines)


def test_numbers_of_bindings_and_groups_may_be_left_out(device: Device) -> None:
    precompile(device, [_stage(LEFT_OUT), _stage(LEFT_OUT.replace("@group(1)", "@group(2)"))])
    device.wait()


def test_a_pipeline_that_was_compiled_ahead_is_the_one_that_is_used(device: Device) -> None:
    stage = _stage(LEFT_OUT.replace("factor.x", "factor.y"))
    precompile(device, [stage])
    made = []
    device_compile, device._compile = device._compile, lambda *given: made.append(given)  # type: ignore[method-assign]
    try:
        device.pipeline(stage.source, stage.constants)
    finally:
        device._compile = device_compile  # type: ignore[method-assign]
    assert not made


def test_a_shader_that_is_wrong_is_told(device: Device) -> None:
    with pytest.raises(ShaderError, match="probe"):
        precompile(device, [_stage("@compute @workgroup_size(1) fn main() { nonsense(); }")])
