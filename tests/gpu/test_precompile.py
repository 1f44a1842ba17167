"""Shaders are compiled ahead of their first use, whatever buffers they bind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import TransformShader, precompile
from holoview.light.gpu.shader import GeneratedWgsl, ShaderError, link

pytestmark = pytest.mark.gpu

UNUSED_NUMBERS = """
@group(0) @binding(0) var<uniform> factor: vec4f;
@group(1) @binding(1) var<storage, read> given: array<f32>;
@group(1) @binding(3) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(1) fn main() { out[0] = factor.x * given[0]; }
"""


def _shader(text: str) -> TransformShader:
    return TransformShader(link(GeneratedWgsl("probe", text)), {}, lambda lines: lines)


def test_numbers_of_bindings_and_groups_may_be_left_out(device: Device) -> None:
    precompile(device, [_shader(UNUSED_NUMBERS), _shader(UNUSED_NUMBERS.replace("@group(1)", "@group(2)"))])
    device.wait()


def test_a_pipeline_that_was_compiled_ahead_is_the_one_that_is_used(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    shader = _shader(UNUSED_NUMBERS.replace("factor.x", "factor.y"))
    precompile(device, [shader])
    compiled = []
    monkeypatch.setattr(type(device.raw), "create_compute_pipeline", lambda *_, **options: compiled.append(options))
    device.pipeline(shader.source, shader.constants)
    assert not compiled


def test_a_driver_compiles_each_shader_while_the_next_pipeline_is_created(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []
    for owner, name in ((type(device.raw), "create_compute_pipeline"), (type(device.raw.queue), "submit")):
        monkeypatch.setattr(owner, name, _noted(steps, name, getattr(owner, name)))
    precompile(device, [_shader(UNUSED_NUMBERS.replace("factor.x", f"factor.{axis}")) for axis in "zw"])
    assert steps == ["create_compute_pipeline", "submit"] * 2


def _noted(steps: list[str], name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    def noted(*args: Any, **options: Any) -> Any:
        steps.append(name)
        return method(*args, **options)

    return noted


def test_a_shader_that_is_wrong_is_told(device: Device) -> None:
    with pytest.raises(ShaderError, match="probe"):
        precompile(device, [_shader("@compute @workgroup_size(1) fn main() { nonsense(); }")])
