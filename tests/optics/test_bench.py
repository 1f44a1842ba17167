"""Illumination: plane waves whose phase rises with position as their direction says; spectra of pixels."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.light.model.bench_parts import Modulator, Sampling, Source
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.numerics.sampling import positions
from holoview.light.optics.bench import PixelAxis, illuminated, pixel_wave, plane_wave, spectrum_of_pixels

CPU = torch.device("cpu")


def _plan(source: Source, upsample: int = 2) -> Plan:
    modulator, sampling = Modulator(pitch_m=8e-6, shape=(5, 8), stroke_m=825e-9), Sampling(upsample=upsample)
    return make_plan(System([460e-9, 638e-9], [[1.0, 1.0]], (modulator,), source=source, sampling=sampling))


def test_light_at_normal_incidence_is_one_everywhere() -> None:
    field = plane_wave(_plan(Source()), 0, 0, torch.complex128, CPU)
    assert torch.equal(field, torch.ones(10, 16, dtype=torch.complex128))


def test_oblique_light_has_the_phase_of_its_direction_about_the_grids_centre() -> None:
    plan = _plan(Source(directions_rad=[[0, 0], [0.02, -0.05]], tilts_rad=[[0, 0], [0.001, 0.002]]))
    y, x = (positions(n, plan.grid.pitch_m) for n in plan.grid.shape)
    for wavelength, (λ, tilt) in enumerate([(460e-9, (0, 0)), (638e-9, (0.001, 0.002))]):
        sines = np.sin([0.02 + tilt[0], -0.05 + tilt[1]])
        expected = np.exp(2j * np.pi / λ * (sines[0] * y[:, None] + sines[1] * x))
        field = plane_wave(plan, wavelength, 1, torch.complex128, CPU).numpy()
        np.testing.assert_allclose(field, expected, atol=1e-12)


def test_every_source_is_equally_strong_in_single_precision_too() -> None:
    plan = _plan(Source(directions_rad=[[0.3, -0.4]]))
    field = plane_wave(plan, 0, 0, torch.complex64, CPU)
    assert field.dtype == torch.complex64
    assert float((field.abs() - 1).abs().max()) <= 2e-7  # two roundings of float32
    exact = plane_wave(plan, 0, 0, torch.complex128, CPU)
    assert float((field - exact).abs().max()) <= 2e-7  # the phase itself is formed in float64


@pytest.mark.parametrize("upsample", [1, 2, 3])
def test_a_pixel_sees_the_wave_at_its_first_sample(upsample: int) -> None:
    plan = _plan(Source(directions_rad=[[0.3, -0.4]]), upsample)
    for wavelength in (0, 1):
        whole = plane_wave(plan, wavelength, 0, torch.complex128, CPU)
        pixels = pixel_wave(plan, wavelength, 0, torch.complex128, CPU)
        assert torch.equal(pixels, whole[::upsample, ::upsample])
        assert tuple(pixels.shape) == (5, 8)


@pytest.mark.parametrize("upsample", [1, 2, 3])
@pytest.mark.parametrize("first_pixel", [0, 2])
def test_the_spectrum_of_pixels_is_that_of_their_samples(upsample: int, first_pixel: int) -> None:
    plan = _plan(Source(tilts_rad=[[0.001, 0.002], [0.003, 0.001]]), upsample)
    grid, pixels = plan.grid, torch.from_numpy(np.random.default_rng(1).random((5, 8))).to(torch.complex128)
    frequencies, first_sample = [torch.arange(-5, 5), torch.arange(-8, 4)], first_pixel * upsample
    light = illuminated(plan, 1, 0, pixels)
    axes = [
        PixelAxis.at(grid, axis, float(plan.slopes[0, 1, axis]), k, torch.complex128, first_sample)
        for axis, k in enumerate(frequencies)
    ]
    samples = illuminated(plan, 1, 0, upsample_nearest(pixels, upsample))
    padded = torch.zeros(grid.padded, dtype=torch.complex128)
    padded[first_sample:, first_sample:][: samples.shape[0], : samples.shape[1]] = samples
    whole = torch.fft.fft2(padded)[frequencies[0]][:, frequencies[1]]
    torch.testing.assert_close(spectrum_of_pixels(light, axes), whole, rtol=0, atol=1e-13 * float(whole.abs().max()))
