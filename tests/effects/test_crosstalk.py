"""A line of path spreads by the variance of the Gaussian; the total stays."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import pytest
import torch
from scipy.ndimage import gaussian_filter

import holoview as hv
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect

Make = Callable[..., Captures]


@pytest.mark.parametrize("sigma", [0.3, 0.45, 1.2])
def test_a_pixel_spreads_by_the_variance_of_the_blur(sigma: float) -> None:
    at, effect = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (1, 41), 4), get_effect("crosstalk")
    line = torch.zeros(1, 41).double()
    line[0, 20] = 1e-7
    found = effect.optical_path(line, at, effect.parameter_values({"sigma": sigma}))[0] / 1e-7
    x = (torch.arange(164) - 81.5).double()
    assert float(found.sum()) == pytest.approx(4.0, rel=1e-9)
    spread = float((found * x**2).sum() / found.sum())
    assert spread == pytest.approx((4**2 - 1) / 12 + (4 * sigma) ** 2, rel=1e-5)  # of four samples, and of the blur


@pytest.mark.parametrize("sigma", [0.3, 0.8, 1.5])
def test_between_whole_pixels_each_is_a_mean_of_its_neighbours(make_session: Make, sigma: float) -> None:
    """As scipy weighs them, cut off as late; pixels stay uniform, so that captures are those of the mean patterns."""
    at, effect = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (12, 15), 2), get_effect("crosstalk")
    share = torch.rand(12, 15, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    coupling = {"coupling": math.exp(-1 / (2 * sigma**2))}
    found = effect.stroke_response(share, at, effect.parameter_values(coupling))
    expected = gaussian_filter(share.numpy(), sigma, mode="nearest", truncate=6.0)
    assert found.numpy() == pytest.approx(expected, abs=1e-7)  # either cuts weights of 1e-8
    path = effect.optical_path(found, at, effect.parameter_values(coupling))
    assert torch.equal(path, found)
    captures = make_session(1)
    plain, coupled = (Predictor(captures)([0], {"crosstalk": v}).signal for v in ({}, coupling))
    assert not torch.equal(plain, coupled)


def test_both_blurs_are_told_apart_in_words() -> None:
    say = partial(get_effect("crosstalk").format_finding, hv.load("holochrome-8"))
    assert "a blur of 0.5 px across their edges (" in say({"sigma": 0.5})
    assert "neighbours: the nearest ones count 0.4 times as much as" in say({"coupling": 0.4})
    assert "edges (standard deviation), and the nearest" in say({"sigma": 0.5, "coupling": 0.4})


def test_an_equal_path_stays_equal() -> None:
    at, effect = ModulatorContext(1, 520e-9, 780e-9, 8e-6, (6, 8), 2), get_effect("crosstalk")
    found = effect.optical_path(torch.full((6, 8), 3e-7).double(), at, effect.parameter_values({"sigma": 0.7}))
    torch.testing.assert_close(found, torch.full((12, 16), 3e-7).double(), rtol=1e-12, atol=0)
