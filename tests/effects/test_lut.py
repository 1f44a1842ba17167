"""The response is drive^gamma through free knots that never fall."""

from __future__ import annotations

import pytest
import torch

from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect

SHARE = torch.linspace(0, 1, 16, dtype=torch.float64)[None]


def _response(number: int = 0, **values: float) -> torch.Tensor:
    effect = get_effect("lut")
    at = ModulatorContext(number, 520e-9, 780e-9, 8e-6, (1, 16), 2)
    return effect.stroke_response(SHARE, at, effect.parameter_values(values))[0]


def test_gamma_bends_the_response_of_its_own_modulator() -> None:
    torch.testing.assert_close(_response(gamma1=2.0), SHARE[0] ** 2)
    assert torch.equal(_response(1, gamma1=2.0), SHARE[0])


def test_a_knot_moves_its_level_alone() -> None:
    found = _response(level1_04=0.05)
    assert float(found[4]) == pytest.approx(4 / 15 + 0.05)
    assert torch.equal(torch.cat([found[:4], found[5:]]), torch.cat([SHARE[0, :4], SHARE[0, 5:]]))


def test_between_knots_the_correction_is_linear() -> None:
    effect = get_effect("lut")
    at = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (1, 1), 2)
    halfway = torch.tensor([[4.5 / 15]], dtype=torch.float64)
    assert float(effect.stroke_response(halfway, at, effect.parameter_values({"level1_04": 0.06}))) == pytest.approx(
        4.5 / 15 + 0.03
    )


def test_levels_never_fall() -> None:
    found = _response(level1_04=0.3, level1_09=-0.4)
    assert bool((found.diff() >= 0).all())


def test_a_wrong_middle_is_told_in_words() -> None:
    import holoview as hv

    assert "0.25 and 0.50" in get_effect("lut").format_finding(hv.load("holochrome-8"), {"gamma1": 2.0})
