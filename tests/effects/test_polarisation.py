"""Unmodulated light adds in intensity to the modulated light, without interference."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures, SlmSpec
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_picture_is_the_mean_of_modulated_and_unmodulated_light(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    dark = make_session(1, levels=np.zeros_like(captures.levels))
    found = predicted(captures, {"polarisation": {"share": 0.2}})
    torch.testing.assert_close(found, 0.8 * predicted(captures) + 0.2 * predicted(dark), rtol=1e-12, atol=0)


def test_a_zero_order_has_that_share_of_the_power(make_fourier: Make, predicted: Predicted) -> None:
    levels = np.zeros((1, 1, 20, 28), np.uint8)
    levels[..., ::2] = 1
    captures = make_fourier(1, levels=levels, slms=(SlmSpec(8e-6, 2, 260e-9),))  # 0 and half a wave: no zero order
    found = float(predicted(captures, {"polarisation": {"share": 0.15}})[0, 30, 40])
    assert found == pytest.approx(0.15 * 20 * 28, rel=1e-6)


def test_unlike_an_unmodulated_amplitude_it_has_no_interference_term(make_session: Make, predicted: Predicted) -> None:
    """Half the light: a share s of the power and an amplitude √s differ by the product of both fields."""
    captures = make_session(1)
    plain = predicted(captures)
    across, along = (
        predicted(captures, {name: {"share": s}}) for name, s in (("polarisation", 0.01), ("undiffracted", 0.1))
    )
    assert float((along - plain).norm()) > 3 * float((across - plain).norm())


def test_the_share_is_told_as_an_angle_too() -> None:
    text = get_effect("polarisation").format_finding(hv.load("holochrome-8"), {"share": 0.25})
    assert "30.0°" in text
