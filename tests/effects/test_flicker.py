"""A grating whose phase ripples has the mean of its zero orders."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.special import j0

import holoview as hv
from holoview.bench.captures.dataset import Captures, SlmSpec
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.effects.registry import get_effect
from holoview.light.model.validity import LIMITS

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_moments_have_the_mean_and_variance_of_a_sine() -> None:
    effect = get_effect("flicker")
    weights, factors = np.array(effect.exposure_samples(effect.parameter_values({"depth": 0.1}))).T
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ factors == pytest.approx(1.0)
    assert weights @ (factors - 1) ** 2 == pytest.approx(0.01)


def test_the_zero_order_is_averaged_over_a_cycle(make_fourier: Make, predicted: Predicted) -> None:
    levels = np.zeros((1, 1, 20, 28), np.uint8)
    levels[..., ::2] = 1
    captures = make_fourier(1, levels=levels, slms=(SlmSpec(8e-6, 2, 260e-9),))
    depth = 0.2
    found = float(predicted(captures, {"flicker": {"depth": depth}})[0, 30, 40]) / (20 * 28)
    # ⟨cos²(π/2·(1 + √2·d·cos φ))⟩ = (1 − J₀(√2·π·d))/2
    assert found == pytest.approx(float(1 - j0(2**0.5 * np.pi * depth)) / 2, rel=1e-6)


@pytest.mark.parametrize("depth", [0.05, 0.2, 0.5])
def test_the_interference_of_two_pixels_averages_to_a_bessel_function(depth: float) -> None:
    """⟨exp(i·a·cos φ)⟩ = J₀(a), for all pairs of pixels of modulators with full drives of 4 wavelengths together."""
    effect = get_effect("flicker")
    weights, factors = np.array(effect.exposure_samples(effect.parameter_values({"depth": depth}))).T
    waves = np.linspace(0, 4, 200)
    means = np.exp(2j * np.pi * waves[:, None] * (factors - 1)) @ weights
    expected = j0(2 * np.pi * waves * 2**0.5 * depth)
    assert np.abs(means - expected).max() < 1e-4


@pytest.mark.parametrize("depth", [0.1, 0.5])
def test_two_modulators_are_the_mean_of_many_moments(make_session: Make, depth: float) -> None:
    """Of 2 × 825 nm at 450 nm, 3.7 wavelengths together; 6 samples at a depth of 0.5 were off by 6 %."""
    levels = np.random.default_rng(5).integers(0, 16, (1, 2, 20, 28), dtype=np.uint8)
    slms = (SlmSpec(8e-6, 16, 825e-9),) * 2
    captures = make_session(1, levels=levels, slms=slms, wavelength_m=np.array([450e-9]))
    predictor = Predictor(captures, double_precision=True)
    found = predictor([0], {"flicker": {"depth": depth}}).signal[0]
    total, count = torch.zeros_like(found), 200
    for k in range(count):
        factor = 2**0.5 * depth * np.cos(np.pi * (k + 0.5) / count)
        total += predictor([0], {"stroke": {"stroke_error": float(factor)}}).signal[0] / count
    assert float((found - total).norm() / total.norm()) < 1e-5


def test_strokes_beyond_the_samples_are_told() -> None:
    """Full drives of 8 wavelengths together, at 15 moments of half a cycle: the ends turn by half of them."""
    wide = {"modulators.0.stroke": "1.84 um", "modulators.1.stroke": "1.84 um", "effects.flicker.depth": 0.5}
    phase = get_effect("flicker").sample_phase(hv.load("holochrome-8").edit(wide), {"depth": 0.5})
    assert phase == pytest.approx(np.pi / 15 * 2**0.5 * 0.5 * np.pi * 8)
    notes = hv.make_plan(hv.load("holochrome-8").edit({"shape": [8, 8], "effects.flicker.depth": 0.5}))
    assert LIMITS["samples of lines and sources"].measure(notes).value < np.pi
