"""The signal is a power of the light."""

from __future__ import annotations

from collections.abc import Callable

import torch

from holoview.bench.captures.dataset import Captures

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]


def test_the_signal_is_a_power_of_light(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1)
    found = predicted(captures, {"camera_gamma": {"exponent": -0.2}})
    torch.testing.assert_close(found, predicted(captures).clamp_min(1e-12) ** 0.8)
