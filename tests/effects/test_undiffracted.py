"""A grating that sends nothing into the zero order does so with the share that isn't modulated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.captures.session import Captures, Panel

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_zero_order_has_the_amplitude_that_isnt_modulated(make_fourier: Make, predicted: Predicted) -> None:
    levels = np.zeros((1, 1, 20, 28), np.uint8)
    levels[..., ::2] = 1
    captures = make_fourier(1, levels=levels, panels=(Panel(8e-6, 2, 260e-9),))  # 0 and half a wave
    values = {"share": 0.3, "quadrature": 0.1}
    dark, light = (float(predicted(captures, e)[0, 30, 40]) for e in ({}, {"undiffracted": values}))
    assert dark == pytest.approx(0.0, abs=1e-20)
    assert light == pytest.approx((0.3**2 + 0.1**2) * 20 * 28, rel=1e-6)
