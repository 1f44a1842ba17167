"""What is blocked is the light of low frequencies, and no more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from holoview.captures.dataset import Captures
from holoview.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_light_straight_ahead_is_gone(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(1, levels=np.zeros((1, 1, 20, 28), np.uint8))
    plain, blocked = (predicted(captures, e)[0] for e in ({}, {"dc_block": {"radius": 1e-3}}))
    radius = torch.hypot((torch.arange(61) - 30.0)[:, None], (torch.arange(81) - 40.0)[None]) * 10e-6 / 0.1
    assert not bool(blocked[radius < 0.99e-3].any())
    assert torch.equal(blocked[radius > 1.01e-3], plain[radius > 1.01e-3])


def test_it_is_the_stop_of_relay_2(make_session: Make) -> None:
    effect, system = get_effect("dc_block"), make_session().nominal_system()
    assert effect.bench(system, effect.parameter_values({"radius": 2e-3})).relay2.dc_block_na == 2e-3
    assert effect.bench(system, effect.parameter_values({"radius": 1e-7})) == system
