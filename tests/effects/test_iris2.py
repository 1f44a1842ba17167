"""A wider iris is a bench with a wider iris; one off the centre lets another disc of directions through."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import pytest
import torch

from holoview.captures.dataset import Captures
from holoview.model.effects.hook_contexts import RelayContext
from holoview.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_it_changes_the_radius(make_session: Make, predicted: Predicted) -> None:
    captures = make_session()
    narrower = dataclasses.replace(captures, iris2_na=0.8 * 0.03)
    found = predicted(captures, {"iris2": {"radius_error": 0.8 * 0.03 / 0.03 - 1}})
    torch.testing.assert_close(found, predicted(narrower), rtol=1e-9, atol=1e-12)


def test_off_the_centre_another_disc_passes(make_session: Make) -> None:
    effect = get_effect("iris2")
    values = effect.parameter_values({"radius_error": 0.1, "decentre_y": 0.5, "decentre_x": -0.25})
    sine = torch.linspace(-0.06, 0.06, 1201).double()
    at = RelayContext(1, 520e-9, sine[:, None], sine[None], 0.03)
    passes = effect.pupil(torch.ones(1201, 1201).double(), at, values)
    area = float(passes.sum()) * 1e-4**2
    assert area == pytest.approx(torch.pi * 0.033**2, rel=2e-3)
    centre = [float((passes.sum(dim=1 - axis) * sine).sum() / passes.sum()) for axis in (0, 1)]
    assert centre == pytest.approx([0.015, -0.0075], abs=1e-5)
    around = effect.bench(make_session().nominal_system(), values).relay2.iris_na
    assert around == pytest.approx(0.03 * (1.1 + (0.5**2 + 0.25**2) ** 0.5))


def test_it_says_how_wide_it_is(make_session: Make) -> None:
    said = get_effect("iris2").format_finding(make_session().nominal_system(), {"radius_error": -0.2})
    assert said == "The iris of relay 2 has an aperture of 0.024, not 0.03."
