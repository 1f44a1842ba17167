"""Edges of one sign are smeared: by direct sums of normal distributions, and as real gratings show."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect

λ = 1550e-9


def _path(pixels_m: NDArray[np.float64], upsample: int, **values: float) -> NDArray[np.float64]:
    """The samples of a path of pixels (y, x)."""
    at, effect = ModulatorContext(0, λ, 3.5e-6, 17e-6, pixels_m.shape, upsample), get_effect("fringing")
    return effect.optical_path(torch.from_numpy(pixels_m), at, effect.parameter_values(values)).numpy()


@pytest.mark.parametrize(("name", "transposed"), [("width_x", False), ("width_y", True)])
@pytest.mark.parametrize("width", [0.4, -0.7])
def test_each_edge_of_a_sign_is_the_integral_of_a_gaussian(name: str, transposed: bool, width: float) -> None:
    """At 2·10⁴ points, edge by edge; their mean over a sample of ⅓ pixel is the sample's. The farthest tails that are
    left out hold Q(4.5) = 3·10⁻⁶ of a step."""
    upsample, points = 3, 400
    pixels = np.array([0.2, 1.1, 0.3, 0.9, 0.9, 0.1, 0.5, 0.4, 1.0, 0.3, 0.3, 0.8]) * 1e-6
    x = (np.arange(len(pixels) * upsample * points) + 0.5) / (upsample * points)
    expected = np.full(len(x), pixels[0])
    for edge, step in enumerate(np.diff(pixels), start=1):
        sigma = abs(width) * math.exp(-abs(step) / 0.5e-6) if step * width < 0 else 0.0
        expected += step * (norm.cdf((x - edge) / sigma) if sigma else x > edge)
    expected = expected.reshape(-1, points).mean(axis=1)
    given = np.tile(pixels, (3, 1))
    found = _path(given.T if transposed else given, upsample, **{name: width, "step": 0.5e-6})
    lines = found.T if transposed else found
    for line in lines:
        np.testing.assert_allclose(line, expected, rtol=0, atol=2e-5 * 1e-6)


def _first_order(period: int, step_rad: NDArray[np.float64], order: int, upsample: int = 16) -> NDArray[np.float64]:
    """Share of the light in an order of binary gratings whose step is one of these."""
    repeats = 8
    seen = []
    for step in step_rad:
        pixels = np.tile(np.repeat([0.0, step / (2 * np.pi) * λ], period // 2), repeats)[None]
        path = _path(pixels, upsample, width_x=0.82, step=0.86e-6)[0].reshape(repeats, -1)[repeats // 2]
        seen.append(abs(np.fft.fft(np.exp(2j * np.pi * path / λ))[order]) ** 2 / len(path) ** 2)
    return np.array(seen)


@pytest.mark.parametrize(("period", "measured"), [(4, 1.78), (8, 1.30), (16, 1.12)])
def test_the_first_order_is_brighter_at_3π_than_at_π_as_measured(period: int, measured: float) -> None:
    """Maxima of a real modulator's first order (binary gratings, 1550 nm), read to about 1 %; the model's two numbers
    leave 1 %."""
    near, far = (_first_order(period, np.linspace(a, b, 15) * np.pi, 1).max() for a, b in ((0.7, 1.5), (2.5, 3.4)))
    assert far / near == pytest.approx(measured, rel=0.025)


def test_a_blur_that_knows_no_step_makes_3π_darker() -> None:
    """The same gratings with `crosstalk`: the sign that real modulators don't show."""
    at, effect = ModulatorContext(0, λ, 3.5e-6, 17e-6, (1, 64), 16), get_effect("crosstalk")
    peaks = []
    for turns in (0.5, 1.5):
        pixels = torch.tile(torch.tensor([0.0, 0.0, turns * λ, turns * λ]).double(), (16,))[None]
        path = effect.optical_path(pixels, at, effect.parameter_values({"sigma": 0.3})).numpy()[0].reshape(16, -1)[8]
        peaks.append(abs(np.fft.fft(np.exp(2j * np.pi * path / λ))[1]) / len(path))
    assert peaks[1] < 0.9 * peaks[0]


def test_the_other_order_gains_what_this_one_loses() -> None:
    """The orders are unlike where edges are; turned in sign, the width exchanges them."""
    step = np.array([np.pi])
    plus, minus = _first_order(8, step, 1), _first_order(8, step, -1)
    assert plus < 0.9 * 4 / np.pi**2 < minus
    mirrored = np.tile(np.repeat([0.5 * λ, 0.0], 4), 8)[None]
    path = _path(mirrored, 16, width_x=-0.82)[0].reshape(8, -1)[4]
    turned = abs(np.fft.fft(np.exp(2j * np.pi * path / λ))[1]) ** 2 / len(path) ** 2
    assert turned == pytest.approx(minus[0], rel=1e-9)


@pytest.mark.long
def test_an_equal_path_stays_equal_and_gradients_flow() -> None:
    at, effect = ModulatorContext(1, 520e-9, 780e-9, 8e-6, (6, 8), 2), get_effect("fringing")
    v = effect.parameter_values({"width_y": 0.7, "width_x": -2.0})
    equal = torch.full((6, 8), 3e-7).double()
    torch.testing.assert_close(effect.optical_path(equal, at, v), torch.full((12, 16), 3e-7).double())
    pixels = torch.rand(6, 8, generator=torch.Generator().manual_seed(1)).double().requires_grad_()
    assert torch.autograd.gradcheck(lambda share: effect.optical_path(share * 1e-6, at, v) * 1e6, pixels)
