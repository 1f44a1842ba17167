"""What is blocked is the light of low frequencies, and no more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Captures
from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.registry import get_effect

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_light_straight_ahead_is_gone(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(1, levels=np.zeros((1, 1, 20, 28), np.uint8))
    plain, blocked = (predicted(captures, e)[0] for e in ({}, {"dc_block": {"radius": 1e-3}}))
    radius = torch.hypot((torch.arange(61) - 30.0)[:, None], (torch.arange(81) - 40.0)[None]) * 10e-6 / 0.1
    assert not bool(blocked[radius < 0.99e-3].any())
    assert torch.equal(blocked[radius > 1.01e-3], plain[radius > 1.01e-3])


def test_it_is_the_stop_of_relay_2(make_session: Make) -> None:
    effect, system = get_effect("dc_block"), make_session().nominal_system()
    assert effect.actual_system(system, effect.parameter_values({"radius": 2e-3})).relay2.dc_block_na == 2e-3
    assert effect.actual_system(system, effect.parameter_values({"radius": 1e-7})) == system


@pytest.mark.parametrize(
    ("relay", "farthest"),
    [
        (Relay(iris_na=0.02), 0.02),
        (Relay(square=0.02), 0.02 * 2**0.5),
        (Relay(square="first order at 450 nm"), 450e-9 / 16e-6 * 2**0.5),
        (Relay(square="first order"), np.inf),  # no aperture of its own: wavelengths that are all covered are dark
        (Relay(square="first order", iris_na=0.02), 0.02),
        (Relay(iris_na=0.02, centre_na=(0.0, 0.005)), 0.025),
        (Relay(square=0.02, centre_na=(0.01, 0.0)), np.hypot(0.03, 0.02)),
    ],
    ids=lambda value: "" if isinstance(value, float) else None,
)
def test_it_leaves_light_at_the_edge_of_the_other_stops(make_session: Make, relay: Relay, farthest: float) -> None:
    captures = make_session(wavelength_m=np.array([450e-9, 600e-9]), relay2=relay)
    effect = get_effect("dc_block")
    blocked = effect.actual_system(captures.nominal_system(), effect.parameter_values({"radius": 0.05}))
    assert blocked.relay2.dc_block_na == pytest.approx(min(0.05, 0.99 * farthest))
