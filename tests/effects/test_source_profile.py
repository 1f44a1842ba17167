"""In the modulator's own plane, intensity is the square of the Gaussian."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_waist_and_centre_are_those_of_a_gaussian(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1, modulators=1, distance_m=np.zeros(1), relay2=Relay())
    half, waist, centre = 14 * 8e-6, 100e-6, 30e-6
    values = {"fall": (half / waist) ** 2, "slope_x": 2 * half * centre / waist**2}
    image = predicted(captures, {"source_profile": values})[0]
    y, x = ((torch.arange(2 * n) // 2 - (n - 1) / 2).double() * 8e-6 for n in (20, 28))  # of pixels, which are squares
    expected = torch.exp(-2 * (y[:, None] ** 2 + (x[None] - centre) ** 2) / waist**2)
    torch.testing.assert_close(image / image.max(), expected / expected.max(), rtol=1e-6, atol=1e-9)


def test_it_says_waist_and_centre(make_session: Make) -> None:
    said = get_effect("source_profile").format_finding(make_session().nominal_system(), {"fall": 1.0, "slope_x": 0.5})
    assert "waist 0.112 mm" in said and "x = 28 um" in said


def test_only_the_first_modulator_is_illuminated(make_session: Make, predicted: Predicted) -> None:
    """Light from the edges misses the camera more often: the share is larger by 0.07, and of 12 patterns ± 0.004."""
    captures = make_session(12)
    dimmed = predicted(captures, {"source_profile": {"fall": 1.0}}).sum() / predicted(captures).sum()
    share = torch.exp(-2 * ((torch.arange(20) - 9.5)[:, None] ** 2 + (torch.arange(28) - 13.5) ** 2) / 14**2).mean()
    assert float(dimmed) == pytest.approx(float(share), abs=0.1)


def test_unmodulated_light_is_lit_by_the_same_source(make_session: Make, predicted: Predicted) -> None:
    """Where the source is dark, what a modulator leaves unmodulated is dark too: e^(−2·6.25·1.5) at its corners."""
    captures = make_session(1, modulators=1, distance_m=np.zeros(1), relay2=Relay())
    source = {"source_profile": {"fall": 6.25}}
    lit, leaking = (predicted(captures, source | more)[0] for more in ({}, {"undiffracted": {"share": 0.5}}))
    dark = lit < 1e-3 * lit.max()
    assert dark.any()
    assert float(leaking[dark].max()) < 1e-2 * float(leaking.max())
