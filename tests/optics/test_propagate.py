"""Angular-spectrum propagation against plane waves, Gaussian beams, Rayleigh–Sommerfeld, and its own adjoint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from holoview.light.model.bench_parts import Modulator, Relay, Sampling
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import positions
from holoview.light.optics.propagate import nominal_pupil, phase_wavelength_derivative, support_mask, transfer_function

CPU = torch.device("cpu")
WAVELENGTH = 532e-9


def _plan(shape: tuple[int, int], pitch_m: float = 4e-6, propagation: str = "periodic") -> Plan:
    modulator = Modulator(pitch_m=pitch_m, shape=shape, stroke_m=825e-9)
    sampling = Sampling(upsample=1, propagation=propagation)
    return make_plan(System([WAVELENGTH], [[1.0]], (modulator,), planes_m=[0.01], sampling=sampling))


def _transfer(plan: Plan, distance_m: float) -> torch.Tensor:
    at = make_plan(plan.nominal, [distance_m])  # on the same grid: neither periodic nor linear padding depends on it
    return transfer_function(at.transfer(1, 0), plan.grid, torch.complex128, CPU)


def _propagated(plan: Plan, field: np.ndarray, distance_m: float) -> np.ndarray:
    """The field on the modulator's area after `distance_m`, without the carrier."""
    padded = torch.zeros(plan.grid.padded, dtype=torch.complex128)
    padded[plan.grid.inside] = torch.from_numpy(field).to(torch.complex128)
    return torch.fft.ifft2(torch.fft.fft2(padded) * _transfer(plan, distance_m))[plan.grid.inside].numpy()


def _axes(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    y, x = (positions(n, plan.grid.pitch_m) for n in plan.grid.shape)
    return y[:, None], x[None, :]


def _gaussian(plan: Plan, waist_m: float, tilt: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """A Gaussian beam at its waist that travels at direction sines `tilt` (y, x)."""
    y, x = _axes(plan)
    phase = 2 * np.pi / WAVELENGTH * (tilt[0] * y + tilt[1] * x)
    return np.exp(-(y**2 + x**2) / waist_m**2 + 1j * phase)


def _complex(seed: int, shape: tuple[int, int]) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


# --- plane waves and energy, on the periodic grid -------------------------------------------------------------------


@pytest.mark.parametrize("bins", [(0, 0), (3, 0), (0, -5), (-7, 4), (12, 16)], ids=str)
@pytest.mark.parametrize("shape", [(24, 32), (15, 27)], ids=str)
def test_a_plane_wave_stays_one_and_gains_the_phase_of_its_direction(
    bins: tuple[int, int], shape: tuple[int, int]
) -> None:
    bins = tuple(min(k, (n - 1) // 2) for k, n in zip(bins, shape, strict=True))
    plan, distance_m = _plan(shape), 9.7e-3
    y, x = (np.arange(n) for n in shape)
    wave = np.exp(2j * np.pi * (bins[0] * y[:, None] / shape[0] + bins[1] * x / shape[1]))
    a = sum((WAVELENGTH * k / (n * 4e-6)) ** 2 for k, n in zip(bins, shape, strict=True))
    expected = wave * np.exp(-2j * np.pi * distance_m / WAVELENGTH * a / (1 + math.sqrt(1 - a)))
    # 18 000 waves of path times the rounding of A, a few 1e-16, times 2π.
    np.testing.assert_allclose(_propagated(plan, wave, distance_m), expected, atol=1e-11)


def test_the_phase_without_carrier_is_that_of_the_textbook() -> None:
    plan, distance_m = _plan((24, 32), pitch_m=1e-6), 50e-6
    uy, ux = (np.fft.fftfreq(n, 1e-6) for n in (24, 32))
    longitudinal = np.sqrt(1 - (WAVELENGTH * uy[:, None]) ** 2 - (WAVELENGTH * ux) ** 2)
    expected = np.exp(2j * np.pi * distance_m / WAVELENGTH * (longitudinal - 1))
    np.testing.assert_allclose(_transfer(plan, distance_m).numpy(), expected, atol=1e-12)


@pytest.mark.parametrize("shape", [(24, 32), (15, 27)], ids=str)
def test_energy_is_kept_on_a_periodic_grid(shape: tuple[int, int]) -> None:
    plan, field = _plan(shape), _complex(0, shape)
    after = _propagated(plan, field, 7e-3)
    assert np.sum(np.abs(after) ** 2) == pytest.approx(np.sum(np.abs(field) ** 2), rel=1e-13)
    torch.testing.assert_close(_transfer(plan, 7e-3).abs(), torch.ones(shape).double(), rtol=0, atol=1e-14)


def test_two_steps_are_one_of_their_sum() -> None:
    plan, field = _plan((24, 30)), _complex(1, (24, 30))
    twice = _propagated(plan, _propagated(plan, field, 2.3e-3), 6.1e-3)
    np.testing.assert_allclose(twice, _propagated(plan, field, 8.4e-3), atol=1e-10)


def test_no_distance_changes_nothing() -> None:
    plan, field = _plan((12, 16), propagation="linear"), _complex(2, (12, 16))
    np.testing.assert_allclose(_propagated(plan, field, 0.0), field, atol=1e-14)


@pytest.mark.parametrize("propagation", ["linear", "periodic"])
def test_the_adjoint_is_the_conjugate_transfer_function(propagation: str) -> None:
    plan = _plan((15, 22), propagation=propagation)
    x, y = _complex(3, (15, 22)), _complex(4, (15, 22))
    forward = np.vdot(_propagated(plan, x, 3e-3), y)
    backward = np.vdot(x, np.conj(_propagated(plan, np.conj(y), 3e-3)))  # H is even: conj(A(conj y)) = Aᴴy
    assert abs(forward - backward) <= 1e-12 * np.linalg.norm(x) * np.linalg.norm(y)


# --- how the phase depends on the wavelength ------------------------------------------------------------------------


def _phase_per_metre(λ: float, plan: Plan) -> np.ndarray:
    """2π·(√(1 − A) − 1)/λ, where the wave travels; 0 elsewhere."""
    uy, ux = (np.fft.fftfreq(n, plan.grid.pitch_m) for n in plan.grid.padded)
    a = (λ * uy[:, None]) ** 2 + (λ * ux) ** 2
    return np.where(a < 1, -2 * np.pi / λ * a / (1 + np.sqrt(np.maximum(1 - a, 0))), 0)


@pytest.mark.parametrize(("pitch_m", "travelling"), [(4e-6, 1.0), (0.5e-6, 1.0), (0.2e-6, 0.44)])
def test_the_phases_slope_is_what_central_differences_approach(pitch_m: float, travelling: float) -> None:
    plan, step = _plan((24, 30), pitch_m), 1e-6
    found = phase_wavelength_derivative(WAVELENGTH, plan.grid).numpy()
    sides = [_phase_per_metre(WAVELENGTH * (1 + sign * step), plan) for sign in (1, -1)]
    expected = (sides[0] - sides[1]) / (2 * step * WAVELENGTH)
    inside = _phase_per_metre(WAVELENGTH, plan) != 0
    assert inside.mean() == pytest.approx(travelling, abs=0.02)
    # Rounding of 1e-16/1e-6 of the phase; near grazing the slope grows as (1 − A)^(−1/2), and the cubic term with it.
    np.testing.assert_allclose(found[inside], expected[inside], rtol=1e-7)
    assert not found[~inside].any()
    assert np.isfinite(found).all()


def test_the_transfer_function_turns_by_the_phases_slope() -> None:
    plan, distance_m, step_m = _plan((24, 30)), 10e-3, 1e-15
    system = plan.system.edit({"wavelengths": [WAVELENGTH + step_m]})
    turned = _transfer(make_plan(system), distance_m) * _transfer(plan, distance_m).conj()
    expected = phase_wavelength_derivative(WAVELENGTH, plan.grid) * distance_m
    # 19 000 waves of path keep 1e-11 rad, over 1e-15 m.
    torch.testing.assert_close(turned.angle() / step_m, expected, rtol=1e-5, atol=1e-3 * float(expected.abs().max()))


# --- beams, on the padded grid --------------------------------------------------------------------------------------


@pytest.mark.parametrize("tilt", [(0.01, 0.0), (0.0, 0.01), (-0.008, 0.004)], ids=str)
def test_a_phase_slope_moves_a_beam_towards_where_the_phase_rises(tilt: tuple[float, float]) -> None:
    plan, distance_m = _plan((96, 128), propagation="linear"), 8e-3
    intensity = np.abs(_propagated(plan, _gaussian(plan, 50e-6, tilt), distance_m)) ** 2
    y, x = _axes(plan)
    centroid = [float((intensity * axis).sum() / intensity.sum()) for axis in (y, x)]
    cosine = math.sqrt(1 - tilt[0] ** 2 - tilt[1] ** 2)
    # The centroid of a beam moves along its mean direction; the beam's own spread of 3.4 mrad changes 1/cos by 1e-5.
    np.testing.assert_allclose(centroid, [distance_m * sine / cosine for sine in tilt], atol=5e-9)


@pytest.mark.parametrize("distance_m", [5e-3, 10e-3, 15e-3])
def test_a_gaussian_beam_widens_as_the_paraxial_formula_says(distance_m: float) -> None:
    plan, waist_m = _plan((96, 128), propagation="linear"), 40e-6
    intensity = np.abs(_propagated(plan, _gaussian(plan, waist_m), distance_m)) ** 2
    rayleigh_m = np.pi * waist_m**2 / WAVELENGTH
    width_m = waist_m * math.hypot(1, distance_m / rayleigh_m)
    y, x = _axes(plan)
    for axis in (y, x):
        measured_m = 2 * math.sqrt((intensity * axis**2).sum() / intensity.sum())
        # Beyond the paraxial formula lies a term of the order of (divergence 4.2 mrad)² = 2e-5; measured 6e-6.
        assert measured_m == pytest.approx(width_m, rel=2e-5)


def test_light_that_leaves_the_window_does_not_come_back_at_the_other_side() -> None:
    linear, periodic = _plan((48, 48), propagation="linear"), _plan((48, 48))
    beam = _gaussian(linear, 40e-6, (0.0, 0.01))  # goes to the window's right edge, 96 µm, and widens to 64 µm
    left = np.s_[:, :12]
    after = {plan.grid.padded[0]: np.abs(_propagated(plan, beam, 9.6e-3)) ** 2 for plan in (linear, periodic)}
    total = np.sum(np.abs(beam) ** 2)
    assert after[48][left].sum() > 0.2 * total
    assert after[linear.grid.padded[0]][left].sum() < 1e-6 * total


def test_a_small_grid_agrees_with_direct_rayleigh_sommerfeld_summation() -> None:
    plan, distance_m = _plan((24, 30), pitch_m=2e-6, propagation="linear"), 0.4e-3
    field = _gaussian(plan, 6e-6, (0.012, -0.02))
    y, x = (axis.ravel() for axis in _axes(plan))
    dy, dx = y[:, None] - y[None, :], x[:, None] - x[None, :]
    r = np.sqrt(dy[:, None, :, None] ** 2 + dx[None, :, None, :] ** 2 + distance_m**2)
    k = 2 * np.pi / WAVELENGTH
    kernel = distance_m / (2 * np.pi * r**2) * (1 / r - 1j * k) * np.exp(1j * k * (r - distance_m))
    expected = np.einsum("YXyx,yx->YX", kernel, field) * (2e-6) ** 2
    after = _propagated(plan, field, distance_m)
    # What differs are the beam's tails at the window's edge, exp(−16) of its middle, and the band limit; measured 6e-8.
    assert np.linalg.norm(after - expected) <= 1e-6 * np.linalg.norm(expected)


IRIS = 0.05


def _plan_of_relay(relay: Relay, **changes: Any) -> Plan:
    modulator = Modulator(pitch_m=8e-6, shape=(20, 24), stroke_m=825e-9)
    sampling = Sampling(upsample=1, propagation="periodic")
    base = System([460e-9, 638e-9], [[1.0, 1.0]], (modulator,), relay2=relay, sampling=sampling)
    return make_plan(base.edit(changes))


@pytest.mark.parametrize("relay", [Relay(), Relay(iris_na=IRIS), Relay(iris_na=IRIS, dc_block_na=0.01)], ids=str)
def test_a_relay_that_neither_apodises_nor_aberrates_needs_no_pupil(relay: Relay) -> None:
    assert nominal_pupil(_plan_of_relay(relay), 1, 0, torch.complex128, CPU) is None


@pytest.mark.parametrize("wavelength", [0, 1])
def test_defocus_is_a_small_change_of_distance(wavelength: int) -> None:
    shift_m, aperture = 20e-6, 0.03
    # −Δz·sin²θ/2 is a√3(2r² − 1) plus a constant, with r = sin θ / aperture.
    rms_m = -shift_m * aperture**2 / (4 * math.sqrt(3))
    plan = _plan_of_relay(Relay(iris_na=aperture, aberration_m=((4, rms_m),)))
    glass = nominal_pupil(plan, 1, wavelength, torch.complex128, CPU)
    assert glass is not None
    both = make_plan(plan.nominal, [9e-3, 9e-3 + shift_m])
    near, far = both.transfer(1, wavelength, 0), both.transfer(1, wavelength, 1)
    here, there = (transfer_function(step, plan.grid, torch.complex128, CPU) for step in (near, far))
    passes = here.abs() > 0
    ratio = (here * glass)[passes] / there[passes]
    constant = ratio.mean() / ratio.mean().abs()
    # The next term of the expansion, 2π/λ·Δz·sin⁴θ/8, is 2.8e-5 rad at 460 nm.
    assert float((ratio / constant - 1).abs().max()) <= 3e-5
    assert int(passes.sum()) > 20


def test_an_aberration_is_glass_so_its_phase_falls_as_one_over_wavelength_at_equal_direction() -> None:
    plan = _plan_of_relay(
        Relay(iris_na=IRIS, aberration_m=((1, 100e-9),)), wavelengths=["460 nm", "920 nm"], observer="mono"
    )
    short, long = (nominal_pupil(plan, 1, i, torch.complex128, CPU) for i in (0, 1))
    assert short is not None and long is not None
    assert float(short[0, 0].angle()) == pytest.approx(2 * math.pi * 100 / 460, abs=1e-12)
    assert float(long[0, 0].angle()) == pytest.approx(2 * math.pi * 100 / 920, abs=1e-12)


def test_tilt_moves_the_image_against_the_slope_of_the_path() -> None:
    shift = 3  # samples
    plan = _plan_of_relay(Relay(iris_na=0.02, aberration_m=((2, shift * 8e-6 * 0.02 / 2),)))
    glass = nominal_pupil(plan, 1, 0, torch.complex128, CPU)
    assert glass is not None
    kx = torch.arange(24).sub(12).roll(12)
    stop = support_mask(plan.stops(1, 0), kx)
    field = torch.rand(20, 24, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    spectrum = torch.fft.fft2(field.to(torch.complex128)) * stop
    moved, still = torch.fft.ifft2(spectrum * glass), torch.fft.ifft2(spectrum)
    torch.testing.assert_close(moved, still.roll(-shift, dims=1), rtol=0, atol=1e-13)


def test_apodisation_falls_to_one_over_e_at_its_aperture() -> None:
    λ, bins = 460e-9, 3
    aperture = bins * λ / (24 * 8e-6)
    glass = nominal_pupil(_plan_of_relay(Relay(apodisation_na=aperture)), 1, 0, torch.complex128, CPU)
    assert glass is not None
    assert float(glass[0, 0].real) == 1.0
    for index in (bins, -bins):
        assert complex(glass[0, index]) == pytest.approx(math.exp(-1), rel=1e-12)
