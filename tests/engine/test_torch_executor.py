"""The reference executor against a short implementation of the formulas in numpy, complex128."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from holoview.light.engine.frame import compute_focal_stack
from holoview.light.engine.torch_executor import TorchExecutor
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.frame_inputs import FrameInputs

SINGLE_TOLERANCE = 1e-6  # relative L2 of intensity; measured 3e-7 … 5e-7
DOUBLE_TOLERANCE = 1e-13  # measured up to 2e-14


def _system(**changes: Any) -> System:
    modulator = Modulator(pitch_m=8e-6, shape=(12, 17), stroke_m=825e-9)
    base = System(
        wavelengths_m=[460e-9, 638e-9],
        amplitudes=[[1.0, 2.0]],
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=[3e-3, 4e-3],
    )
    return base.edit(changes)


def _drive(system: System, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random(system.drive_shape)


def _simulated(system: System, drive: np.ndarray, double: bool = True) -> np.ndarray:
    plan = make_plan(system)
    return compute_focal_stack(TorchExecutor(plan, FrameInputs(plan, drive), double=double))[0]


# --- the formulas ---------------------------------------------------------------------------------------------------


def _transfer(padded: tuple[int, int], dx: float, λ: float, z: float, relay: Relay, band_limited: bool) -> np.ndarray:
    uy, ux = np.meshgrid(*(np.fft.fftfreq(p, dx) for p in padded), indexing="ij")
    a = (λ * uy) ** 2 + (λ * ux) ** 2
    h = np.exp(-2j * np.pi * z / λ * a / (1 + np.sqrt(1 - a)))  # √(1 − a) − 1 without its cancellation
    if relay.iris_na is not None:
        h = h * (a <= relay.iris_na**2)
    if relay.dc_block_na is not None:
        h = h * (a > relay.dc_block_na**2)
    if relay.apodisation_na is not None:
        h = h * np.exp(-a / relay.apodisation_na**2)
    for noll, rms_m in relay.aberration_m:
        assert noll == 4 and relay.iris_na is not None
        h = h * np.exp(2j * np.pi * rms_m / λ * np.sqrt(3) * (2 * a / relay.iris_na**2 - 1))
    if band_limited:
        limit_y, limit_x = (1 / (λ * np.sqrt((2 * z / (p * dx)) ** 2 + 1)) for p in padded)
        h = h * (np.abs(uy) <= limit_y) * (np.abs(ux) <= limit_x)
    return h


def _relayed(field: np.ndarray, h: np.ndarray) -> np.ndarray:
    rows, columns = field.shape
    return np.fft.ifft2(np.fft.fft2(field, s=h.shape) * h)[:rows, :columns]


def _expected(system: System, drive: np.ndarray) -> np.ndarray:
    upsample, linear = system.sampling.upsample, system.sampling.propagation == "linear"
    dx = system.modulators[0].pitch_m / upsample
    shape, padded = np.multiply(system.modulators[0].shape, upsample), make_plan(system).grid.padded
    y, x = ((np.arange(n) - (n - 1) / 2) * dx for n in shape)
    out = np.zeros((len(system.planes_m), len(system.wavelengths_m), *shape))
    for i, λ in enumerate(system.wavelengths_m):
        for frame in range(system.frames):
            masks = [
                np.kron(np.exp(2j * np.pi * pattern * modulator.stroke_m / λ), np.ones((upsample, upsample)))
                for pattern, modulator in zip(drive[frame], system.modulators, strict=True)
            ]
            for direction in system.source.directions_rad:
                sine_y, sine_x = np.sin(direction)
                field = np.exp(2j * np.pi / λ * (sine_y * y[:, None] + sine_x * x)) * masks[0]
                if system.gap_m is not None:
                    field = _relayed(field, _transfer(padded, dx, λ, system.gap_m, system.relay1, linear)) * masks[1]
                for k, z in enumerate(system.planes_m):
                    at_plane = _relayed(field, _transfer(padded, dx, λ, z, system.relay2, linear))
                    out[k, i] += system.amplitudes[frame, i] * np.abs(at_plane) ** 2
    return out / (system.frames * len(system.source.directions_rad))


SOURCES = {"directions": [[0.0, 0.0], [0.01, -0.02], [-0.03, 0.0]]}
CASES: dict[str, dict[str, Any]] = {
    "plain": {},
    "planes at zero and far": {"planes": [0.0, "5 mm"]},
    "no gap between": {"gap": 0.0},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [12, 17], "stroke": "825 nm"}], "gap": None},
    "frames": {"amplitudes": [[1.0, 0.0], [0.5, 2.0], [0.0, 3.0]]},
    "sources": {"source": SOURCES},
    "stops": {"relay1.iris_na": 0.03, "relay2.iris_na": 0.025, "relay2.dc_block_na": 0.003},
    "glass": {"relay2": {"iris_na": 0.03, "apodisation_na": 0.02, "aberration": {"Z4": "70 nm"}}},
    "upsampled thrice": {"upsample": 3},
    "unequal strokes": {"modulators.1.stroke": "400 nm"},
    "everything": {
        "amplitudes": [[1.0, 0.5], [0.0, 2.0]],
        "source": SOURCES,
        "relay1.iris_na": 0.035,
        "relay2": {"iris_na": 0.03, "dc_block_na": 0.002, "aberration": {"Z4": "70 nm"}},
    },
}


@pytest.mark.parametrize("propagation", ["linear", "periodic"])
@pytest.mark.parametrize("case", CASES)
def test_a_frame_is_what_the_formulas_say(case: str, propagation: str) -> None:
    system = _system(**CASES[case], propagation=propagation)
    drive = _drive(system).astype(np.float32).astype(np.float64)  # exact in both precisions
    expected = _expected(system, drive)
    for double, tolerance in ((True, DOUBLE_TOLERANCE), (False, SINGLE_TOLERANCE)):
        actual = _simulated(system, drive, double)
        assert actual.dtype == (np.float64 if double else np.float32)
        assert actual.shape == expected.shape
        assert np.linalg.norm(actual - expected) <= tolerance * np.linalg.norm(expected)


def test_compact_padding_agrees_with_linear_padding_where_pupils_bound_the_angles() -> None:
    modulator = {"pitch": "8 um", "shape": [40, 48], "stroke": "825 nm"}
    soft = {"iris_na": 0.02, "apodisation_na": 0.005}  # the iris, which sets the padding, cuts at exp(−16)
    system = _system(modulators=[modulator, modulator], relay1=soft, relay2=soft)
    drive = _drive(system)
    linear, compact = (_simulated(system.with_(propagation=how), drive) for how in ("linear", "compact"))
    assert make_plan(system.with_(propagation="compact")).grid.padded < make_plan(system).grid.padded
    # Measured 3e-8. A hard iris differs more: its disc is made of whole frequency bins, others on either grid.
    assert np.linalg.norm(compact - linear) <= 1e-7 * np.linalg.norm(linear)


# --- invariants -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("double", "tolerance"), [(True, 1e-14), (False, 1e-6)])
def test_an_idle_bench_of_no_length_shows_its_laser_amplitude(double: bool, tolerance: float) -> None:
    system = _system(planes=[0.0], gap=0.0, amplitudes=[[1.0, 0.25]])
    intensity = _simulated(system, np.zeros(system.drive_shape), double)
    np.testing.assert_allclose(intensity[0, 0], 1.0, rtol=tolerance)
    np.testing.assert_allclose(intensity[0, 1], 0.25, rtol=tolerance)


def test_intensity_is_linear_in_the_laser_amplitudes() -> None:
    drive = _drive(_system())
    unit = _simulated(_system(amplitudes=[[1.0, 1.0]]), drive)
    scaled = _simulated(_system(amplitudes=[[3.0, 0.5]]), drive)
    np.testing.assert_allclose(scaled, unit * np.array([3.0, 0.5])[:, None, None], rtol=1e-14)


def test_time_sequential_frames_are_averaged_each_with_its_own_laser() -> None:
    sequential = _system(amplitudes=[[2.0, 0.0], [0.0, 4.0]])
    drive = _drive(sequential)
    actual = _simulated(sequential, drive)
    for laser, amplitudes in enumerate([[2.0, 0.0], [0.0, 4.0]]):
        alone = _simulated(_system(amplitudes=[amplitudes]), drive[laser : laser + 1])
        np.testing.assert_allclose(actual[:, laser], alone[:, laser] / 2, rtol=1e-13, atol=1e-15)


def test_equal_frames_and_equal_sources_average_to_one_of_them() -> None:
    system, drive = _system(), _drive(_system())
    repeated = system.with_(frames=3, source={"directions": [[0, 0], [0, 0]]})
    actual = _simulated(repeated, np.repeat(drive, 3, axis=0))
    np.testing.assert_allclose(actual, _simulated(system, drive), rtol=1e-13)


def test_a_constant_added_to_a_pattern_changes_nothing() -> None:
    system = _system()
    drive = _drive(system) / 2
    shifted = drive.copy()
    shifted[:, 1] += 0.3
    # A phase of 3 rad taken modulo a turn keeps 1e-15; intensities at dark samples are small beside it.
    np.testing.assert_allclose(_simulated(system, shifted), _simulated(system, drive), rtol=1e-11, atol=1e-13)


# --- the executor ---------------------------------------------------------------------------------------------------


def test_one_wavelength_can_be_recomputed_alone_in_any_order() -> None:
    system = _system()
    plan = make_plan(system)
    executor = TorchExecutor(plan, FrameInputs(plan, _drive(system)))
    whole, _ = compute_focal_stack(executor)
    for wavelength in (1, 0, 1):
        executor.run(wavelength)
        alone = np.stack([executor.intensity(plane) for plane in range(2)])
        np.testing.assert_array_equal(alone, whole[:, wavelength])


def test_progress_counts_the_wavelengths() -> None:
    system, calls = _system(), []
    plan = make_plan(system)
    compute_focal_stack(
        TorchExecutor(plan, FrameInputs(plan, _drive(system))), lambda done, total: calls.append((done, total))
    )
    assert calls == [(1, 2), (2, 2)]


@pytest.mark.parametrize(("double", "tolerance"), [(True, 1e-14), (False, 1e-6)])
def test_the_composite_is_the_observers_sum_over_wavelengths(double: bool, tolerance: float) -> None:
    system = _system()
    plan = make_plan(system)
    executor = TorchExecutor(plan, FrameInputs(plan, _drive(system)), double=double)
    intensity, xyz = compute_focal_stack(executor)
    expected = np.moveaxis(intensity.astype(float), 1, -1) @ plan.colour_weights
    assert np.linalg.norm(xyz - expected) <= tolerance * np.linalg.norm(expected)
    np.testing.assert_array_equal(compute_focal_stack(executor)[1], xyz)  # a second frame starts from black


def test_transmitting_leaves_the_spectrum_for_the_next_plane() -> None:
    plan = make_plan(_system())
    executor = TorchExecutor(plan, FrameInputs(plan, _drive(plan.system)))
    spectrum = executor.spectrum(executor.illuminate(0, 0), 1)
    before = spectrum.values.clone()
    executor.transmit(spectrum, 1, 0)
    assert torch.equal(spectrum.values, before)


def test_gradients_reach_the_drive() -> None:
    system = _system(amplitudes=[[1.0, 0.5], [0.0, 2.0]])
    plan, start = make_plan(system), torch.from_numpy(_drive(system))

    def total(drive: torch.Tensor) -> torch.Tensor:
        inputs = FrameInputs(plan, drive)
        return TorchExecutor(plan, inputs, double=True).intensity_tensor().square().sum()

    drive = start.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(total(drive), drive)
    for index in ((0, 0, 3, 4), (1, 1, 11, 16), (1, 0, 0, 0)):
        step = torch.zeros_like(start)
        step[index] = 1e-5
        slope = float(total(start + step) - total(start - step)) / 2e-5
        # A step is 1e-4 rad: differences leave its square, relative to the largest gradient.
        assert float(gradient[index]) == pytest.approx(slope, abs=1e-7 * float(gradient.abs().max()))


def test_what_gradients_flow_through_is_the_intensity_itself() -> None:
    system = _system()
    plan = make_plan(system)
    executor = TorchExecutor(plan, FrameInputs(plan, _drive(system)), double=True)
    np.testing.assert_array_equal(executor.intensity_tensor().numpy(), compute_focal_stack(executor)[0])
