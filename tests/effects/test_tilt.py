"""A tilted wave falls elsewhere: by angle × focal length behind a lens, by angle × distance near by."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from holoview.captures.dataset import Captures
from holoview.model.bench_parts import Relay

Make, Predicted = Callable[..., Captures], Callable[..., torch.Tensor]
_ANGLE = 2e-3


def _centre(image: torch.Tensor) -> tuple[float, float]:
    """Centroid (y, x) in pixels from the middle."""
    weights = [image.sum(dim=1 - axis) / image.sum() for axis in (0, 1)]
    return tuple(float((w * (torch.arange(len(w)) - (len(w) - 1) / 2)).sum()) for w in weights)  # type: ignore[return-value]


def test_behind_a_lens_the_zero_order_moves(make_fourier: Make, predicted: Predicted) -> None:
    captures = make_fourier(1, levels=np.zeros((1, 1, 20, 28), np.uint8))
    image = predicted(captures, {"tilt": {"tilt_y": _ANGLE, "tilt_x": -_ANGLE}})[0]
    at = torch.tensor(np.unravel_index(int(image.argmax()), image.shape)) - torch.tensor([30, 40])
    assert at.tolist() == [20, -20]  # 0.1 m × 2 mrad in pixels of 10 µm


def test_near_by_the_shadow_moves(make_session: Make, predicted: Predicted) -> None:
    captures = make_session(1, modulators=1, levels=np.zeros((1, 1, 20, 28), np.uint8), relay2=Relay())
    before, after = (_centre(predicted(captures, e)[0]) for e in ({}, {"tilt": {"tilt_x": _ANGLE}}))
    assert after[1] - before[1] > 0.5  # 1.5 pixels less what leaves the picture
    assert after[0] == pytest.approx(before[0], abs=1e-9)
