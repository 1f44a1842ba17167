"""The exponent of the response grows by `slope` for each 100 nm below 550 nm, for each modulator."""

from __future__ import annotations

import pytest
import torch

import holoview as hv
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect

SHARE = torch.linspace(0, 1, 16, dtype=torch.float64)[None]


def _response(wavelength_m: float, number: int = 0, **values: float) -> torch.Tensor:
    effect = get_effect("lut_dispersion")
    at = ModulatorContext(number, wavelength_m, 780e-9, 8e-6, (1, 16), 2)
    return effect.stroke_response(SHARE, at, effect.parameter_values(values))


@pytest.mark.parametrize(("wavelength_m", "exponent"), [(450e-9, 1.4), (500e-9, 1.25), (550e-9, 1.1), (650e-9, 0.8)])
def test_the_exponent_depends_on_the_wavelength(wavelength_m: float, exponent: float) -> None:
    torch.testing.assert_close(_response(wavelength_m, slope1=0.3, offset1=0.1), SHARE**exponent)


def test_full_drive_gives_the_full_stroke_at_every_wavelength() -> None:
    for wavelength_m in (400e-9, 520e-9, 700e-9):
        found = _response(wavelength_m, slope1=0.6)[0]
        assert found[0] == 0.0 and found[-1] == 1.0 and bool((found.diff() >= 0).all())


def test_each_modulator_has_its_own() -> None:
    assert torch.equal(_response(450e-9, 1, slope1=0.3), SHARE)
    assert torch.equal(_response(550e-9, 0, slope1=0.3), SHARE)


def test_it_is_told_in_words() -> None:
    text = get_effect("lut_dispersion").format_finding(hv.load("holochrome-8"), {"slope1": 1.0, "slope2": 1.0})
    assert "0.25 of the stroke at 450 nm and 0.97 at 650 nm" in text  # ½² and ½^0.05
