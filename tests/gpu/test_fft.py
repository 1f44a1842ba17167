"""The shader FFT against what is known of a DFT, and against numpy in complex128."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from holoview.light.gpu.device import Device
from holoview.light.gpu.fft import FftPlan, RowRange
from holoview.light.gpu.fft_codegen import MAX_LENGTH, MAX_RADIX, radices
from holoview.light.gpu.recorder import CommandRecorder
from holoview.light.numerics.sampling import is_fast_length
from holoview.util.errors import UserError
from tests.explored import explored

TOLERANCE = 7e-7
"""Relative L2 error against float64 that the plan promises; 2.5e-7 is the worst seen at these sizes."""
EXACT = 1e-6
"""For single values of size 1: a few roundings of f32 a pass."""

SHAPES = [(1, 1), (3, 2), (4, 5), (6, 8), (9, 10), (12, 15), (16, 18), (20, 24), (25, 27), (30, 32)]
"""Every radix once, on lines that don't fill a workgroup."""
LONG_SHAPES = [(1, 8192), (3125, 1), (96, 1280), (243, 100)]
"""Two and three passes along an axis, with even and odd radices."""

Complex = NDArray[np.complexfloating]


def _fields(plan_shape: tuple[int, int], batch: int = 1, seed: int = 1) -> Complex:
    parts = np.random.default_rng(seed).standard_normal((2, batch, *plan_shape))
    fields: Complex = (parts[0] + 1j * parts[1]).astype(np.complex64).astype(np.complex128)
    return fields


def _run(plan: FftPlan, device: Device, fields: Complex, *steps: str, rows: RowRange | None = None) -> Complex:
    """The fields after transforms by name, as they lie in the buffer."""
    buffer = device.upload(plan.pack(fields), "fields")
    recorder = CommandRecorder(device)
    for step in steps:
        getattr(plan, step)(recorder, buffer, rows)
    recorder.submit()
    return plan.download(buffer).astype(np.complex128)


def _spectrum(plan: FftPlan, device: Device, fields: Complex) -> Complex:
    return plan.natural_order(_run(plan, device, fields, "forward"))


def _difference(found: Complex, expected: Complex) -> float:
    """Relative L2."""
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def test_every_good_length_has_few_and_even_radices() -> None:
    for n in filter(is_fast_length, range(1, MAX_LENGTH + 1)):
        found = radices(n)
        assert math.prod(found) == n
        assert all(radix <= MAX_RADIX for radix in found)
        assert len(found) <= 3
    assert radices(1024) == (32, 32)
    assert radices(8192) == (32, 16, 16)


@pytest.mark.parametrize(("n", "remedy"), [(7, "next good size is 8"), (1081, "next good size is 1125")])
def test_a_size_with_other_factors_is_answered_with_the_next_good_one(n: int, remedy: str) -> None:
    with pytest.raises(UserError, match=remedy):
        radices(n)


def test_a_size_beyond_the_largest_is_refused() -> None:
    with pytest.raises(UserError, match="at most 8192"):
        radices(8640)


@pytest.mark.gpu
@pytest.mark.parametrize("shape", explored(SHAPES + LONG_SHAPES, [*SHAPES[::2], LONG_SHAPES[-1]]))
def test_forward_agrees_with_numpy_and_inverse_undoes_it(device: Device, shape: tuple[int, int]) -> None:
    fields, plan = _fields(shape), FftPlan(device, shape)
    assert _difference(_spectrum(plan, device, fields), np.fft.fft2(fields)) < TOLERANCE
    assert _difference(_run(plan, device, fields, "forward", "inverse"), fields) < TOLERANCE


@pytest.mark.gpu
@settings(max_examples=12, derandomize=True, deadline=None)
@given(
    shape=st.sampled_from([(12, 15), (30, 32), (96, 64)]),
    batch=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_batch_of_any_fields_keeps_its_energy_and_comes_back(
    device: Device, shape: tuple[int, int], batch: int, seed: int
) -> None:
    fields, plan = _fields(shape, batch, seed), FftPlan(device, shape, batch)
    spectrum = _spectrum(plan, device, fields)
    energy = np.sum(np.abs(fields) ** 2, axis=(1, 2))
    assert np.sum(np.abs(spectrum) ** 2, axis=(1, 2)) / math.prod(shape) == pytest.approx(energy, rel=2 * TOLERANCE)
    assert _difference(spectrum, np.fft.fft2(fields)) < TOLERANCE
    assert _difference(_run(plan, device, fields, "forward", "inverse"), fields) < TOLERANCE


@pytest.mark.gpu
def test_an_impulse_has_a_flat_spectrum_of_one_forward_and_of_one_over_n_inverse(device: Device) -> None:
    plan = FftPlan(device, (96, 64))
    impulse = np.zeros((1, 96, 64), np.complex128)
    impulse[0, 0, 0] = 1
    assert np.abs(_run(plan, device, impulse, "forward") - 1).max() < EXACT
    assert np.abs(_run(plan, device, impulse, "inverse") - 1 / (96 * 64)).max() < EXACT / (96 * 64)


@pytest.mark.gpu
@pytest.mark.parametrize("frequency", [(0, 0), (1, 0), (0, 1), (-3, 5), (47, -32), (-48, 31)])
def test_a_tilt_lands_where_the_plan_says_its_frequency_is(device: Device, frequency: tuple[int, int]) -> None:
    plan = FftPlan(device, (96, 64))
    y, x = np.mgrid[:96, :64]
    tilt = np.exp(2j * np.pi * (frequency[0] * y / 96 + frequency[1] * x / 64))
    spectrum = _run(plan, device, tilt, "forward")[0]
    row, column = np.unravel_index(np.abs(spectrum).argmax(), spectrum.shape)
    assert (int(plan.frequency_y[row]), int(plan.frequency_x[column])) == frequency
    assert spectrum[row, column] == pytest.approx(96 * 64, rel=TOLERANCE)


@pytest.mark.gpu
@pytest.mark.parametrize("rows", [(0, 96), (0, 1), (95, 1), (13, 40)])
def test_forward_of_some_rows_is_that_of_a_field_with_zeros_elsewhere(device: Device, rows: RowRange) -> None:
    first, count = rows
    plan, fields = FftPlan(device, (96, 64), batch=2), _fields((96, 64), 2)
    fields[:, :first] = fields[:, first + count :] = 0
    found = plan.natural_order(_run(plan, device, fields, "forward", rows=rows))
    assert _difference(found, np.fft.fft2(fields)) < TOLERANCE


@pytest.mark.gpu
def test_inverse_of_some_rows_is_right_in_these_rows(device: Device) -> None:
    plan, fields = FftPlan(device, (96, 64), batch=2), _fields((96, 64), 2)
    buffer = device.upload(plan.pack(fields), "fields")
    recorder = CommandRecorder(device)
    plan.forward(recorder, buffer)
    plan.inverse(recorder, buffer, rows=(13, 40))
    recorder.submit()
    found = plan.download(buffer)
    assert _difference(found[:, 13:53], fields[:, 13:53]) < TOLERANCE
    assert _difference(found[:, :13], fields[:, :13]) > 0.1  # the work was saved


@pytest.mark.gpu
def test_padding_and_rows_that_are_left_out_stay_as_they_were(device: Device) -> None:
    plan = FftPlan(device, (30, 32), stride=45)
    packed = plan.pack(_fields((30, 32)))
    packed[:, :, 32:] = 7
    buffer = device.upload(packed, "fields")
    recorder = CommandRecorder(device)
    plan.forward(recorder, buffer)
    recorder.submit()
    assert np.all(device.download(buffer, np.complex64, packed.shape)[:, :, 32:] == 7)


@pytest.mark.gpu
def test_a_dispatch_that_is_spread_over_two_axes_reaches_every_value_once(device: Device) -> None:
    narrow = Device(device.raw, device.info, {**device.limits, "max-compute-workgroups-per-dimension": 5})
    fields, plan = _fields((96, 64)), FftPlan(narrow, (96, 64))
    assert _difference(_spectrum(plan, narrow, fields), np.fft.fft2(fields)) < TOLERANCE


@pytest.mark.gpu
def test_wrong_buffers_and_rows_are_refused(device: Device) -> None:
    plan, recorder = FftPlan(device, (4, 5)), CommandRecorder(device)
    with pytest.raises(ValueError, match="small: 8 bytes, expected at least 416"):
        plan.forward(recorder, device.buffer(8, "small"))
    for rows in ((-1, 2), (0, 0), (3, 2)):
        with pytest.raises(ValueError, match=r"expected \(first, count\) within 4 rows"):
            plan.forward(recorder, device.buffer(plan.buffer_bytes, "fields"), rows)
