"""Fringes over a modulator have the period of their wedge at each wavelength, its own depth, and a wavefront."""

from __future__ import annotations

import math

import pytest
import torch

import holoview as hv
from holoview.model.effects.hook_contexts import ModulatorContext
from holoview.model.effects.registry import get_effect
from holoview.model.plan import make_plan
from holoview.optics.torch_effects import SampledTransmissions
from holoview.util.errors import UserError

SHAPE = (30, 40)


def _transmission(wavelength_m: float, laser: int = 0, **values: float) -> torch.Tensor:
    effect = get_effect("slm1_fringes")
    at = ModulatorContext(0, wavelength_m, 780e-9, 8e-6, SHAPE, 2, laser)
    return effect.transmission(torch.ones(SHAPE, dtype=torch.complex128), at, effect.parameter_values(values))


@pytest.mark.parametrize("wavelength_m", [450e-9, 600e-9])
def test_it_is_the_sum_of_two_beams_whose_round_trips_differ_by_the_path(wavelength_m: float) -> None:
    cos, sin, path_y, path_x = 0.06, -0.04, 2e-6, -5e-6
    found = _transmission(wavelength_m, cos1=cos, sin1=sin, path_y=path_y, path_x=path_x)
    y, x = torch.arange(30).double()[:, None] - 14.5, torch.arange(40).double() - 19.5
    longer_m = path_y * y / 30 + path_x * x / 40  # `path` from edge to edge
    second = 0.5 * complex(cos, sin) * torch.exp(2j * math.pi * longer_m / wavelength_m)
    torch.testing.assert_close(found, 1 + second, rtol=1e-12, atol=1e-14)


def test_the_light_has_fringes_of_the_stated_depth() -> None:
    """A fringe of 20 pixels, whose extremes are missed by half a pixel."""
    light = _transmission(500e-9, cos1=0.02, path_x=2 * 500e-9).abs().square()
    assert float(light.max() - light.min()) / 2 == pytest.approx(0.02 * math.cos(math.pi / 20), rel=1e-9)


def test_each_laser_has_its_own_depth_and_nine_are_refused() -> None:
    assert torch.equal(_transmission(450e-9, 1, cos1=0.1, path_y=1e-6), torch.ones(SHAPE, dtype=torch.complex128))
    with pytest.raises(UserError, match=r"slm1_fringes.*more than 8"):
        _transmission(450e-9, 8, cos1=0.1)


def test_lasers_are_counted_from_the_shortest_wavelength_also_where_each_has_several_lines() -> None:
    system = hv.load("holochrome-8").edit(
        {"wavelengths": ["620 nm", "460 nm", "530 nm"], "amplitudes": "white", "effects.second_line.share": 0.3}
    )
    plan = make_plan(system)
    numbers = SampledTransmissions(plan, torch.zeros(system.drive_shape))
    assert [numbers.context(0, k).laser for k in range(6)] == [2, 2, 0, 0, 1, 1]
