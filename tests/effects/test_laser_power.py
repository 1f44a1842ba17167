"""Light rises as a power of what was set."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from holoview.captures.dataset import Captures

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_light_follows_the_power_law(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(2, power=np.array([1.0, 0.5]))
    change = predicted(captures, {"laser_power": {"exponent": 0.3}}) / predicted(captures)
    torch.testing.assert_close(change[0], torch.ones_like(change[0]))
    torch.testing.assert_close(change[1], torch.full_like(change[1], 0.5**0.3))
