"""Fringes over a modulator or the picture have the period of their wedge at each wavelength, and their own depth."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.hook_contexts import CameraContext, ModulatorContext
from holoview.light.model.effects.registry import ActiveEffects, get_effect
from holoview.light.model.plan import make_plan
from holoview.light.optics.torch_effects import SampledTransmissions
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
    with pytest.raises(UserError, match=r"^effects\.slm1_fringes: wavelengths: more than 8"):
        ActiveEffects({"slm1_fringes": {"cos1": 0.1}}).cache_key("transmission", laser=8)


def test_lasers_are_counted_from_the_shortest_wavelength_also_where_each_has_several_lines() -> None:
    system = hv.load("holochrome-8").edit(
        {"wavelengths": ["620 nm", "460 nm", "530 nm"], "amplitudes": "white", "effects.second_line.share": 0.3}
    )
    plan = make_plan(system)
    numbers = SampledTransmissions(plan, torch.zeros(system.drive_shape))
    assert [numbers.context(0, k).laser for k in range(6)] == [2, 2, 0, 0, 1, 1]


Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
FRINGES = {"path_x": 4e-6, "cos1": 0.2}


def test_without_a_gap_fringes_on_either_modulator_are_the_same(make_session: Make, predicted: Predicted) -> None:
    """Nor with a stop between: then transmissions multiply."""
    captures = make_session(1, gap_m=0.0, relay1=Relay())
    one, two = (predicted(captures, {f"slm{n}_fringes": FRINGES}) for n in (1, 2))
    torch.testing.assert_close(one, two, rtol=1e-9, atol=1e-12)


def test_it_is_told_in_words() -> None:
    text = get_effect("slm2_fringes").format_finding(hv.load("holochrome-8"), {"path_x": 5.5e-6, "cos1": 0.1})
    assert "depth 0.1 lie over modulator 2; 0 (y) and 10 (x)" in text


CAMERA_SHAPE = (48, 64)


def _seen(laser: int = 0, wavelength_m: float = 500e-9, **values: float) -> torch.Tensor:
    effect = get_effect("camera_fringes")
    context = CameraContext(4e-6, CAMERA_SHAPE, wavelength_m, laser)
    return effect.image(torch.ones(CAMERA_SHAPE).double(), context, effect.parameter_values(values))


@pytest.mark.parametrize("wavelength", [450e-9, 600e-9])
def test_as_many_fringes_as_waves_of_the_wedge(wavelength: float) -> None:
    """Of whole numbers of fringes, the spectrum has one line, half as high as the fringes are deep."""
    seen = _seen(wavelength_m=wavelength, path_y=3 * wavelength, path_x=-9 * wavelength, cos1=0.06, sin1=0.08)
    spectrum = torch.fft.fft2(seen) / seen.numel()
    assert abs(spectrum[3, -9]) == pytest.approx(0.05, rel=1e-12)
    spectrum[3, -9] = spectrum[-3, 9] = spectrum[0, 0] = 0
    assert float(spectrum.abs().max()) < 1e-14


@pytest.mark.parametrize("wavelength", [450e-9, 600e-9])
def test_achromatic_fringes_are_as_many_at_every_wavelength_as_at_550_nm(wavelength: float) -> None:
    path = {"path_y": 3 * 550e-9, "path_x": -9 * 550e-9}
    seen = _seen(wavelength_m=wavelength, **path, cos1=0.06, sin1=0.08, achromatic=1.0)
    assert torch.allclose(seen, _seen(wavelength_m=550e-9, **path, cos1=0.06, sin1=0.08), rtol=1e-14)


def test_a_weak_etalon_transmits_as_airy_says() -> None:
    """T = 1/(1 + F·sin²(δ/2)) is 1 − F/2 + F/2·cos δ to first order in F; what follows is F² at most."""
    finesse, path, thickness = 0.02, 4.3e-6, 0.17
    x = (torch.arange(CAMERA_SHAPE[1]).double() - (CAMERA_SHAPE[1] - 1) / 2) / (CAMERA_SHAPE[1] / 2)
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
    assert torch.equal(third, torch.ones(CAMERA_SHAPE).double())


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
    assert "depth 0.02 … 0.05" in text and "10 (y) and 20 (x)" in text and "wedge" in text
    text = get_effect("camera_fringes").format_finding(None, {**values, "achromatic": 1.0})  # type: ignore[arg-type]
    assert "at every wavelength" in text and "moiré" in text
