"""Illumination: plane waves whose phase rises with position as their direction says."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.model.bench_parts import Modulator, Sampling, Source
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.numerics.fft_grid import positions
from holoview.optics.bench import pixel_wave, plane_wave

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
