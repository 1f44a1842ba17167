"""A grating that sends nothing into the zero order does so with the share that isn't modulated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures, SlmSpec
from holoview.light.model.effects.hook_contexts import ModulatorContext
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_zero_order_has_the_amplitude_that_isnt_modulated(make_fourier: Make, predicted: Predicted) -> None:
    levels = np.zeros((1, 1, 20, 28), np.uint8)
    levels[..., ::2] = 1
    captures = make_fourier(1, levels=levels, slms=(SlmSpec(8e-6, 2, 260e-9),))  # 0 and half a wave
    values = {"share": 0.3, "quadrature": 0.1}
    dark, light = (float(predicted(captures, e)[0, 30, 40]) for e in ({}, {"undiffracted": values}))
    assert dark == pytest.approx(0.0, abs=1e-20)
    assert light == pytest.approx((0.3**2 + 0.1**2) * 20 * 28, rel=1e-6)


def test_the_first_modulator_may_leave_more_than_the_second() -> None:
    effect = get_effect("undiffracted")
    v = effect.parameter_values({"share": 0.2, "difference": 0.05})
    light = torch.full((2, 2), 1j, dtype=torch.complex128)
    for number, amount in ((0, 0.25), (1, 0.15)):
        at = ModulatorContext(number, 520e-9, 780e-9, 8e-6, (2, 2), 2)
        torch.testing.assert_close(effect.transmission(light, at, v), (1 - amount) * light + amount)
