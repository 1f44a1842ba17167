"""FFTs along one axis with hooks agree with numpy, by each strategy, along either axis."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.light.gpu.device import Device, TransformOptions
from holoview.light.gpu.line_fft import (
    MAX_REGISTERS,
    Axis,
    Hooks,
    LineFft,
    Strategy,
    generate_subgroup_shader,
    lanes_per_line,
    subgroup_workgroups,
    supported_strategies,
)
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.gpu.shader import GeneratedWgsl
from holoview.light.gpu.spectrum_order import Direction, LineTransform
from tests.explored import explored

pytestmark = pytest.mark.gpu

TOLERANCE = 7e-7
"""Relative L2 against float64; 3e-7 is the worst seen."""
FIELDS = 2
AXES: tuple[Axis, ...] = ("x", "y")
HOOKS = """
@group(1) @binding(0) var<storage, read> given: array<vec2f>;
@group(1) @binding(1) var<storage, read_write> found: array<vec2f>;
var<private> scale: f32;
fn index_of(p: vec3u) -> u32 { return (p.z * NYu + p.y) * NXu + p.x; }
fn begin(line: u32, field: u32) { scale = f32(1u + line) + 0.5 * f32(field); }
fn load(p: vec3u) -> vec2f { return scale * given[index_of(p)]; }
fn middle(p: vec3u, value: vec2f) -> vec2f { return value * (1.0 + f32(WHERE)); }
fn store(p: vec3u, value: vec2f) { found[TARGET] = value; }
"""
ALONG = {"x": "u32(frequency_x(p.x) + select(0, NX, frequency_x(p.x) < 0))", "y": ""}
ALONG["y"] = ALONG["x"].replace("x", "y").replace("NX", "NY")
STEPS: list[tuple[Direction, ...]] = [("forward",), ("inverse",), ("forward", "inverse"), ("inverse", "forward")]
SHAPES = [(64, 128), (192, 64), (72, 120), (1, 30), (250, 3)]
"""Lines of one pass and of several; groups of registers that are full, and one that is not; a single point."""

Complex = NDArray[np.complexfloating]


def _given(shape: tuple[int, int]) -> Complex:
    parts = np.random.default_rng(7).standard_normal((2, FIELDS, *shape))
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def _run(device: Device, strategy: Strategy, axis: Axis, steps: tuple[Direction, ...], given: Complex) -> Complex:
    """The transform of all lines; spectra in the order of `numpy.fft`, on the way in as on the way out."""
    ny, nx = given.shape[1:]
    at_end, at_start = steps[-1] == "forward", steps[0] == "inverse"
    natural = {"x": f"vec3u({ALONG['x']}, p.y, p.z)", "y": f"vec3u(p.x, {ALONG['y']}, p.z)"}[axis]
    middle = f"p.{axis}" if at_start else ALONG[axis]
    text = HOOKS.replace("TARGET", f"index_of({natural if at_end else 'p'})").replace("WHERE", f"({middle}) % 5u")
    if at_start:
        text = text.replace("given[index_of(p)]", f"given[index_of({natural})]")
    text = text.replace("NY", str(ny)).replace("NX", str(nx))
    whole = [LineTransform(direction) for direction in steps]
    transform = LineFft(device, axis, (ny, nx), whole, Hooks("test", (GeneratedWgsl("hooks", text),)), strategy)
    buffers = [device.upload(given, "given"), device.buffer(given.nbytes, "found")]
    work = device.buffer(FIELDS * transform.work_bytes, "work") if transform.work_bytes else None
    recorder = CommandRecorder(device)
    for step in transform.bind(buffers, ny if axis == "x" else nx, FIELDS, work):
        recorder.add(step)
    recorder.submit()
    return device.download(buffers[1], np.complex64, given.shape)


def _expected(axis: Axis, steps: tuple[Direction, ...], given: Complex) -> Complex:
    along, across = (2, 1) if axis == "x" else (1, 2)
    n = given.shape[along]
    scale = 1.0 + np.arange(given.shape[across]) + 0.5 * np.arange(FIELDS)[:, None]
    values = given.astype(np.complex128) * np.expand_dims(scale, along)
    for number, step in enumerate(steps):
        if number:
            shape = (1, n, 1) if along == 1 else (1, 1, n)
            values = values * (1 + np.arange(n) % 5).reshape(shape)
        values = np.fft.fft(values, axis=along) if step == "forward" else n * np.fft.ifft(values, axis=along)
    return values


@pytest.mark.parametrize("shape", explored(SHAPES, [(1, 30)]))
def test_a_transform_is_that_of_numpy(device: Device, shape: tuple[int, int]) -> None:
    given = _given(shape)
    for axis, steps in product(AXES, STEPS):
        expected = _expected(axis, steps, given)
        for strategy in supported_strategies(device, shape):
            found = _run(device, strategy, axis, steps, given)
            assert np.linalg.norm(found - expected) <= TOLERANCE * np.linalg.norm(expected), (strategy, axis, steps)


@pytest.mark.parametrize("shape", explored(SHAPES, [(250, 3)]))
def test_rough_passes_by_large_workgroups_lose_a_digit_at_most(
    device: Device, shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device, "transforms", TransformOptions(pass_invocations=256, is_rough=True))
    given = _given(shape)
    for axis, steps in product(AXES, STEPS):
        expected = _expected(axis, steps, given)
        error = np.linalg.norm(_run(device, "passes", axis, steps, given) - expected)
        assert error <= 16 * TOLERANCE * np.linalg.norm(expected), (
            axis,
            steps,
        )  # w¹⁶ errs by sixteen times as much as w


@pytest.mark.parametrize(
    ("n", "largest", "lanes"),
    [
        (1024, 32, 32),
        (768, 32, 16),
        (768, 8, 8),
        (1080, 8, 8),
        (1080, 32, 8),
        (250, 8, 2),
        (375, 32, None),
        (8192, 8, None),
    ],
)
def test_a_line_belongs_to_as_many_lanes_as_its_length_allows(n: int, largest: int, lanes: int | None) -> None:
    assert lanes_per_line(n, largest) == lanes
    if lanes is not None:
        assert n % lanes == 0 and lanes <= n // lanes <= MAX_REGISTERS


def test_the_last_workgroup_stores_no_line_twice() -> None:
    assert subgroup_workgroups(8, 9) == 3
    text = generate_subgroup_shader("x", 64, 8, (LineTransform("forward"),))
    assert "if (is_valid_line) {" in text and text.count("store(") == 8
