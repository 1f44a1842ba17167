"""A point becomes a Gaussian of that variance; its light stays."""

from __future__ import annotations

import pytest
import torch

from holoview.light.model.effects.hook_contexts import CameraContext
from holoview.light.model.effects.registry import get_effect

TAILS = 5e-4
"""Light beyond the picture's 20 pixels each way: samples of so narrow a Gaussian ring."""


@pytest.mark.parametrize("sigma", [0.3, 0.8, 2.5])
def test_a_point_spreads_by_the_variance(sigma: float) -> None:
    image = torch.zeros(41, 41).double()
    image[20, 20] = 5.0
    effect = get_effect("camera_blur")
    found = effect.image(image, CameraContext(4e-6, (41, 41)), effect.parameter_values({"sigma": sigma}))
    x = (torch.arange(41) - 20).double()
    assert float(found.sum()) == pytest.approx(5.0, rel=TAILS)
    assert float((found.sum(dim=0) * x**2).sum() / 5) == pytest.approx(sigma**2, abs=20**2 * TAILS)
