"""Brightness falls by the stated share at the edges' middles, and not in the centre."""

from __future__ import annotations

import pytest
import torch

from holoview.model.effects.hook_contexts import CameraContext
from holoview.model.effects.registry import get_effect


def test_the_edges_lose_their_share() -> None:
    effect = get_effect("vignetting")
    found = effect.image(
        torch.ones(201, 301).double(),
        CameraContext(4e-6, (201, 301)),
        effect.parameter_values({"fall_y": 0.2, "fall_x": 0.4}),
    )
    assert float(found[100, 150]) == 1.0
    assert float(found[0, 150]) == pytest.approx(0.8, abs=0.003)
    assert float(found[100, -1]) == pytest.approx(0.6, abs=0.003)
