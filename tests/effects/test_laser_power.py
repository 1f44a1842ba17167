"""Light rises as a power of what was set."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import holoview as hv
from holoview.bench.captures.dataset import Captures

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_light_follows_the_power_law(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(2, power=np.array([1.0, 0.5]))
    change = predicted(captures, {"laser_power": {"exponent": 0.3}}) / predicted(captures)
    torch.testing.assert_close(change[0], torch.ones_like(change[0]))
    torch.testing.assert_close(change[1], torch.full_like(change[1], 0.5**0.3))


def test_a_laser_with_two_lines_follows_the_power_law_as_a_whole() -> None:
    """Lines share the light that the laser emits: (1 − s)·P^1.5 and s·P^1.5, not the powers of shares of P."""
    system = hv.load("holochrome-8").edit({"wavelengths": ["500 nm"], "amplitudes": [[0.25]]})
    effects = {"laser_power": {"exponent": 0.5}, "second_line": {"share": 0.3, "offset": "6 nm"}}
    plan = hv.make_plan(system.edit({"effects": effects}))
    assert plan.weights[0].tolist() == pytest.approx([0.7 * 0.125, 0.3 * 0.125])
