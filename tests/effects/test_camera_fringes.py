"""Fringes are those of Airy's etalon to first order, as many as the wedge is waves thicker at the other edge."""

from __future__ import annotations

import math

import pytest
import torch

from holoview.model.effects.hook_contexts import CameraContext
from holoview.model.effects.registry import get_effect
from holoview.util.errors import UserError

SHAPE = (48, 64)


def _seen(laser: int = 0, wavelength_m: float = 500e-9, **values: float) -> torch.Tensor:
    effect = get_effect("camera_fringes")
    context = CameraContext(4e-6, SHAPE, wavelength_m, laser)
    return effect.image(torch.ones(SHAPE).double(), context, effect.parameter_values(values))


@pytest.mark.parametrize("wavelength", [450e-9, 600e-9])
def test_as_many_fringes_as_waves_of_the_wedge(wavelength: float) -> None:
    """Of whole numbers of fringes, the spectrum has one line, half as high as the fringes are deep."""
    seen = _seen(wavelength_m=wavelength, path_y=3 * wavelength, path_x=-9 * wavelength, cos1=0.06, sin1=0.08)
    spectrum = torch.fft.fft2(seen) / seen.numel()
    assert abs(spectrum[3, -9]) == pytest.approx(0.05, rel=1e-12)
    spectrum[3, -9] = spectrum[-3, 9] = spectrum[0, 0] = 0
    assert float(spectrum.abs().max()) < 1e-14


def test_a_weak_etalon_transmits_as_airy_says() -> None:
    """T = 1/(1 + F·sin²(δ/2)) is 1 − F/2 + F/2·cos δ to first order in F; what follows is F² at most."""
    finesse, path, thickness = 0.02, 4.3e-6, 0.17
    x = (torch.arange(SHAPE[1]).double() - (SHAPE[1] - 1) / 2) / (SHAPE[1] / 2)
    delta = 2 * math.pi * (path * x / 2) / 500e-9 + thickness
    airy = 1 / (1 + finesse * (delta / 2).sin() ** 2)
    depth = finesse / 2 / (1 - finesse / 2)
    found = _seen(path_x=path, cos1=depth * math.cos(thickness), sin1=depth * math.sin(thickness))[0]
    assert torch.allclose((1 - finesse / 2) * found, airy, rtol=0, atol=finesse**2)


def test_each_laser_has_a_phase_and_a_depth_of_its_own() -> None:
    """Of eight whole fringes, the mean square is half the depth's."""
    values = {"path_x": 4e-6, "cos1": 0.1, "sin2": 0.03}
    first, second, third = (_seen(laser, **values) for laser in range(3))
    assert float((first - 1).square().mean()) == pytest.approx(0.1**2 / 2)
    assert float((second - 1).square().mean()) == pytest.approx(0.03**2 / 2)
    assert torch.equal(third, torch.ones(SHAPE).double())


def test_a_wedge_the_other_way_round_is_the_same_fringes_with_the_other_sign_of_phase() -> None:
    """Which is why path_y has no negative values."""
    there = _seen(path_y=2e-6, path_x=5e-6, cos1=0.02, sin1=0.03)
    back = _seen(path_y=-2e-6, path_x=-5e-6, cos1=0.02, sin1=-0.03)
    assert torch.allclose(there, back, rtol=1e-14)


def test_a_session_of_more_lasers_than_it_has_numbers_for_is_refused() -> None:
    with pytest.raises(UserError, match="at most 8"):
        _seen(laser=8, cos1=0.1, path_x=4e-6)


def test_the_finding_states_depths_and_the_number_of_fringes() -> None:
    values = {"path_y": 5.5e-6, "path_x": -11e-6, "cos1": 0.03, "sin1": 0.04, "cos2": 0.02}
    text = get_effect("camera_fringes").format_finding(None, values)  # type: ignore[arg-type]
    assert "depth 0.02 … 0.05" in text and "10 (y) and 20 (x)" in text
