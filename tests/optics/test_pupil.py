"""The pupil: defocus against a change of distance, aberrations that scale with the wavelength, apodisation."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from holoview.model.bench_parts import Modulator, Relay, Sampling
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optics.propagate import nominal_pupil, support_mask, transfer_function

CPU = torch.device("cpu")
IRIS = 0.05


def _plan(relay: Relay, **changes: Any) -> Plan:
    modulator = Modulator(pitch_m=8e-6, shape=(20, 24), stroke_m=825e-9)
    sampling = Sampling(upsample=1, propagation="periodic")
    base = System([460e-9, 638e-9], [[1.0, 1.0]], (modulator,), relay2=relay, sampling=sampling)
    return make_plan(base.edit(changes))


@pytest.mark.parametrize("relay", [Relay(), Relay(iris_na=IRIS), Relay(iris_na=IRIS, dc_block_na=0.01)], ids=str)
def test_a_relay_that_neither_apodises_nor_aberrates_needs_no_pupil(relay: Relay) -> None:
    assert nominal_pupil(_plan(relay), 1, 0, torch.complex128, CPU) is None


@pytest.mark.parametrize("wavelength", [0, 1])
def test_defocus_is_a_small_change_of_distance(wavelength: int) -> None:
    shift_m, aperture = 20e-6, 0.03
    # −Δz·sin²θ/2 is a√3(2r² − 1) plus a constant, with r = sin θ / aperture.
    rms_m = -shift_m * aperture**2 / (4 * math.sqrt(3))
    plan = _plan(Relay(iris_na=aperture, aberration_m=((4, rms_m),)))
    glass = nominal_pupil(plan, 1, wavelength, torch.complex128, CPU)
    assert glass is not None
    near, far = plan.transfer(1, wavelength, 9e-3), plan.transfer(1, wavelength, 9e-3 + shift_m)
    here, there = (transfer_function(step, plan.grid, torch.complex128, CPU) for step in (near, far))
    passes = here.abs() > 0
    ratio = (here * glass)[passes] / there[passes]
    constant = ratio.mean() / ratio.mean().abs()
    # The next term of the expansion, 2π/λ·Δz·sin⁴θ/8, is 2.8e-5 rad at 460 nm.
    assert float((ratio / constant - 1).abs().max()) <= 3e-5
    assert int(passes.sum()) > 20


def test_an_aberration_is_glass_so_its_phase_falls_as_one_over_wavelength_at_equal_direction() -> None:
    plan = _plan(Relay(iris_na=IRIS, aberration_m=((1, 100e-9),)), wavelengths=["460 nm", "920 nm"], observer="mono")
    short, long = (nominal_pupil(plan, 1, i, torch.complex128, CPU) for i in (0, 1))
    assert short is not None and long is not None
    assert float(short[0, 0].angle()) == pytest.approx(2 * math.pi * 100 / 460, abs=1e-12)
    assert float(long[0, 0].angle()) == pytest.approx(2 * math.pi * 100 / 920, abs=1e-12)


def test_tilt_moves_the_image_against_the_slope_of_the_path() -> None:
    shift = 3  # samples
    plan = _plan(Relay(iris_na=0.02, aberration_m=((2, shift * 8e-6 * 0.02 / 2),)))
    glass = nominal_pupil(plan, 1, 0, torch.complex128, CPU)
    assert glass is not None
    kx = torch.arange(24).sub(12).roll(12)
    stop = support_mask(plan.transfer(1, 0, 0.0), kx)
    field = torch.rand(20, 24, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    spectrum = torch.fft.fft2(field.to(torch.complex128)) * stop
    moved, still = torch.fft.ifft2(spectrum * glass), torch.fft.ifft2(spectrum)
    torch.testing.assert_close(moved, still.roll(-shift, dims=1), rtol=0, atol=1e-13)


def test_apodisation_falls_to_one_over_e_at_its_aperture() -> None:
    λ, bins = 460e-9, 3
    aperture = bins * λ / (24 * 8e-6)
    glass = nominal_pupil(_plan(Relay(apodisation_na=aperture)), 1, 0, torch.complex128, CPU)
    assert glass is not None
    assert float(glass[0, 0].real) == 1.0
    for index in (bins, -bins):
        assert complex(glass[0, index]) == pytest.approx(math.exp(-1), rel=1e-12)
