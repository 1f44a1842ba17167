"""The shader's complex arithmetic against numpy in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.light.gpu.device import Device
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import GeneratedWgsl, link

pytestmark = pytest.mark.gpu

CIS_TOLERANCE = 3e-7
"""Promised in the shader. Five roundings of f32 (6e-8 each) on values up to 1; about 2e-7 is seen."""
COUNT = 4096


def _apply(device: Device, element: str, expression: str, given: NDArray[Any]) -> NDArray[np.complex128]:
    """`expression` of `x`, an `element`, for each of 4096 given ones."""
    text = f"""//#include "lib/complex.wgsl"
@group(1) @binding(0) var<storage, read> given: array<{element}>;
@group(1) @binding(1) var<storage, read_write> found: array<vec2f>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {{
    let x = given[id.x];
    found[id.x] = {expression};
}}
"""
    source, target = device.upload(given, "given"), device.buffer(8 * COUNT, "found")
    pipeline = device.pipeline(link(GeneratedWgsl(expression, text)))
    recorder = CommandRecorder(device)
    recorder.add(Dispatch.bind(device, pipeline, [[], [source, target]], (COUNT // 64, 1, 1)))
    recorder.submit()
    return device.download(target, np.complex64, (COUNT,)).astype(np.complex128)


def _error(found: NDArray[np.complex128], turns: NDArray[np.float64]) -> float:
    """The largest error of either part."""
    difference = found - np.exp(2j * np.pi * (turns % 1.0))
    return float(max(np.abs(difference.real).max(), np.abs(difference.imag).max()))


@pytest.mark.parametrize("span", [0.25, 1.0, 8000.0])
def test_cis_is_accurate_for_any_number_of_turns(device: Device, span: float) -> None:
    turns = np.random.default_rng(1).uniform(-span, span, COUNT).astype(np.float32)
    assert _error(_apply(device, "f32", "cis(x)", turns), turns.astype(np.float64)) < CIS_TOLERANCE


def test_cis_is_accurate_at_every_eighth_of_a_turn(device: Device) -> None:
    turns = ((np.arange(COUNT) - COUNT // 2) / 8).astype(np.float32)
    assert _error(_apply(device, "f32", "cis(x)", turns), turns.astype(np.float64)) < CIS_TOLERANCE


def test_cis_of_whole_and_half_turns_is_exactly_one_and_minus_one(device: Device) -> None:
    turns = ((np.arange(COUNT) - COUNT // 2) / 2).astype(np.float32)
    assert np.array_equal(_apply(device, "f32", "cis(x)", turns), np.where(turns % 1 == 0, 1, -1))


def test_cis_fixed_is_accurate_over_the_circle_and_at_its_seams(device: Device) -> None:
    turns = np.random.default_rng(2).integers(0, 2**32, COUNT, np.uint32)
    seams = (np.arange(8, dtype=np.int64)[:, None] * 2**29 + np.arange(-4, 5)).ravel() % 2**32
    turns[: seams.size] = seams
    assert _error(_apply(device, "u32", "cis_fixed(x)", turns), turns / 2.0**32) < CIS_TOLERANCE


@pytest.mark.parametrize(("name", "second"), [("cmul", np.asarray), ("cmul_conj", np.conj)])
def test_products_are_those_of_numpy(device: Device, name: str, second: Any) -> None:
    parts = np.random.default_rng(3).standard_normal((COUNT, 4)).astype(np.float32)
    a, b = (parts[:, i].astype(np.float64) + 1j * parts[:, i + 1].astype(np.float64) for i in (0, 2))
    found = _apply(device, "vec4f", f"{name}(x.xy, x.zw)", parts)
    three_roundings = 3 * np.finfo(np.float32).eps / 2
    assert np.all(np.abs(found - a * second(b)) < 2 * three_roundings * np.abs(a) * np.abs(b))
