"""A grating whose phase ripples has the mean of its zero orders."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.special import j0

from holoview.captures.dataset import Captures, SlmSpec
from holoview.model.effects.registry import get_effect

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
