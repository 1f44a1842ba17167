"""A modulator's wavefront is a sum of Zernike terms over the circle around it."""

from __future__ import annotations

import pytest
import torch

from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect
from holoview.light.numerics.surfaces import zernike


def test_defocus_is_a_bowl_over_the_circle_around_the_modulator() -> None:
    at, effect = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (30, 40), 1), get_effect("slm_flatness")
    path = effect.optical_path(torch.zeros(30, 40).double(), at, effect.parameter_values({"z4_1": 50e-9}))
    y, x = at.positions(path)
    rho2 = (y**2 + x**2) / (25 * 8e-6) ** 2  # the half diagonal of 30 × 40 pixels is 25
    torch.testing.assert_close(path, 50e-9 * 3**0.5 * (2 * rho2 - 1), rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("noll", range(4, 12))
def test_every_term_is_a_zernike_polynomial_over_the_circle(noll: int) -> None:
    at, effect = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (400, 400), 1), get_effect("slm_flatness")
    path = effect.optical_path(torch.zeros(400, 400).double(), at, effect.parameter_values({f"z{noll}_1": 50e-9}))
    y, x = at.positions(path)
    radius = torch.hypot(y, x) / (200 * 2**0.5 * 8e-6)
    inner = radius <= 2**-0.5  # the largest circle inside the modulator
    expected = 50e-9 * zernike(noll, radius, torch.atan2(y, x))
    torch.testing.assert_close(path[inner], expected[inner], rtol=1e-9, atol=1e-18)


def test_each_modulator_has_its_own_wavefront() -> None:
    effect = get_effect("slm_flatness")
    values = effect.parameter_values({"z4_2": 50e-9})
    flat = torch.zeros(8, 8).double()
    first, second = (
        effect.optical_path(flat, ModulatorContext(n, 520e-9, 780e-9, 8e-6, (8, 8), 2), values) for n in (0, 1)
    )
    assert torch.equal(first, flat) and bool(second.any())
