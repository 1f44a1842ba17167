"""Transforms of a part of the points or frequencies agree with numpy's of all, by each strategy, along either axis."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import (
    Axis,
    Hooks,
    LineFft,
    LineTransform,
    Strategy,
    can_transform_repeats,
    spectrum_order,
    supported_strategies,
)
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.gpu.shader import GeneratedWgsl
from holoview.light.gpu.spectrum_order import Range
from holoview.light.numerics.sampling import frequency_indices
from tests.explored import explored

pytestmark = pytest.mark.gpu

TOLERANCE = 7e-7
"""Relative L2 against float64, as for whole transforms."""
LINES = 5
HOOKS = """
@group(1) @binding(0) var<storage, read> given: array<vec2f>;
@group(1) @binding(1) var<storage, read_write> found: array<vec2f>;
fn index_of(line: u32, along: i32, length: u32) -> u32 { return line * length + u32((along + NXi) % NXi); }
fn begin(line: u32, field: u32) {}
fn load(p: vec3u) -> vec2f { return given[index_of(LINE, INPUT, NXu)]; }
fn middle(p: vec3u, value: vec2f) -> vec2f {
    let k = MIDDLE;
    return select(vec2f(0.0), value * f32(1 + (k + NXi) % NXi % 3), k >= LOW && k <= HIGH);
}
fn store(p: vec3u, value: vec2f) { found[index_of(LINE, OUTPUT, NXu)] += value; }
"""
CASES: dict[str, tuple[LineTransform, ...]] = {
    "a band of the spectrum of some points": (LineTransform("forward", points=(9, 40), band=(-13, 13)),),
    "some points of a band that lies aside": (LineTransform("inverse", points=(30, 61), band=(4, 20)),),
    "a band wider than half": (
        LineTransform("forward", band=(-25, 30)),
        LineTransform("inverse", points=(0, 3), band=(-25, 30)),
    ),
    "points and a band between": (
        LineTransform("forward", (16, 47), (-16, 15)),
        LineTransform("inverse", (16, 47), (-16, 15)),
    ),
    "a band to another band": (
        LineTransform("inverse", (8, 50), (-7, 7)),
        LineTransform("forward", (8, 50), (-31, -3)),
    ),
    "repeated": (LineTransform("forward", repeats=2), LineTransform("inverse")),
    "some points repeated to a band": (
        LineTransform("forward", (5, 20), repeats=2),
        LineTransform("inverse", (10, 41), (-15, 15)),
    ),
    "repeated three times": (LineTransform("forward", repeats=3), LineTransform("inverse", (0, 100), (-40, 2))),
}

Complex = NDArray[np.complexfloating]


def _length(name: str) -> int:
    return 192 if "three" in name else 128 if "repeated" in name else 64


def _is_within(n: int, indices: NDArray[np.int64], wanted: Range | None) -> NDArray[np.bool_]:
    return np.ones(n, bool) if wanted is None else (indices >= wanted[0]) & (indices <= wanted[1])


def _given(n: int, step: LineTransform) -> Complex:
    """Random values where the step allows them, (LINES, n)."""
    parts = np.random.default_rng(3).standard_normal((2, LINES, n))
    count = n // step.repeats
    is_point = step.direction == "forward"
    kept = _is_within(count, np.arange(count), step.points) if is_point else None
    kept = _is_within(n, frequency_indices(n), step.band) if kept is None else np.pad(kept, (0, n - count))
    return np.where(kept, parts[0] + 1j * parts[1], 0).astype(np.complex64)


def _run(device: Device, strategy: Strategy, axis: Axis, steps: tuple[LineTransform, ...], given: Complex) -> Complex:
    n = given.shape[1]
    frequency = f"frequency_{axis}(p.{axis})"
    order = spectrum_order(device, n, strategy, steps[0].band)
    first = "i32" if steps[0].direction == "forward" else "input_frequency"
    text = order.frequency_wgsl("input_frequency") + HOOKS
    text = text.replace("INPUT", f"{first}(p.{axis})")
    text = text.replace("OUTPUT", frequency if steps[-1].direction == "forward" else f"i32(p.{axis})")
    text = text.replace("MIDDLE", frequency if steps[-1].direction == "inverse" else f"i32(p.{axis})")
    text = text.replace("LINE", "p.y" if axis == "x" else "p.x").replace("NX", str(n))
    low, high = (steps[-1].band if steps[-1].direction == "inverse" else steps[-1].points) or (-n, n)
    text = text.replace("LOW", str(low)).replace("HIGH", str(high))
    shape = (LINES, n) if axis == "x" else (n, LINES)
    transform = LineFft(device, axis, shape, steps, Hooks("test", (GeneratedWgsl("hooks", text),)), strategy)
    buffers = [device.upload(given, "given"), device.buffer(given.nbytes, "found")]
    work = device.buffer(transform.work_bytes, "work") if transform.work_bytes else None
    recorder = CommandRecorder(device)
    for dispatch in transform.bind(buffers, LINES, 1, work):
        recorder.add(dispatch)
    recorder.submit()
    return device.download(buffers[1], np.complex64, given.shape)


def _expected(steps: tuple[LineTransform, ...], given: Complex) -> Complex:
    values, n = given.astype(np.complex128), given.shape[1]
    indices = np.arange(n)
    for number, step in enumerate(steps):
        if number:
            values = values * (1 + indices % 3)
        if step.direction == "forward":
            values = np.fft.fft(values[:, : n // step.repeats], axis=1)
            values = np.tile(values, step.repeats)
            values = np.where(_is_within(n, frequency_indices(n), step.band), values, 0)
        else:
            values = np.where(_is_within(n, frequency_indices(n), step.band), values, 0)
            values = n * np.fft.ifft(values, axis=1)
            values = np.where(_is_within(n, indices, step.points), values, 0)
    return values


def _wanted(n: int, step: LineTransform) -> NDArray[np.bool_]:
    is_point = step.direction == "inverse"
    return _is_within(n, np.arange(n) if is_point else frequency_indices(n), step.points if is_point else step.band)


@pytest.mark.parametrize("name", explored(CASES, ["points and a band between", "repeated"]))
def test_what_is_needed_of_a_transform_is_that_of_numpy(device: Device, name: str) -> None:
    steps, n = CASES[name], _length(name)
    given = _given(n, steps[0])
    expected, wanted = _expected(steps, given), _wanted(n, steps[-1])
    for axis, strategy in product(("x", "y"), supported_strategies(device, (n, n))):
        assert all(can_transform_repeats(device, n, step.repeats, strategy) for step in steps)
        found = _run(device, strategy, axis, steps, given)
        error = np.linalg.norm((found - expected)[:, wanted])
        assert error <= TOLERANCE * np.linalg.norm(expected), (axis, strategy)


def test_values_outside_a_band_are_neither_loaded_nor_stored(device: Device) -> None:
    """64 points, whose last radix or number of lanes is at least 8: at most 8 frequencies more on either side."""
    given = np.ones((LINES, 64), np.complex64)
    for strategy in supported_strategies(device, (64, 64)):
        spectrum = _run(device, strategy, "y", (LineTransform("forward", band=(-8, 7)),), given)
        assert np.count_nonzero(spectrum) <= 16 * LINES
        order = spectrum_order(device, 64, strategy, (-8, 7))
        assert np.all(np.abs(order.frequencies()) <= 16)


def test_a_spectrum_can_be_repeated_if_groups_of_registers_stay_whole(device: Device) -> None:
    assert can_transform_repeats(device, 1024, 2, "passes")
    assert not can_transform_repeats(device, 1024, 3, "passes")
    assert not can_transform_repeats(device, 72, 2, "subgroup") or "subgroup" not in supported_strategies(
        device, (72, 72)
    )
