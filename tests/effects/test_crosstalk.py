"""A line of path spreads by the variance of the Gaussian; the total stays."""

from __future__ import annotations

import pytest
import torch

from holoview.model.effects.hook_contexts import ModulatorContext
from holoview.model.effects.registry import get_effect


@pytest.mark.parametrize("sigma", [0.3, 0.45, 1.2])
def test_a_pixel_spreads_by_the_variance_of_the_blur(sigma: float) -> None:
    at, effect = ModulatorContext(0, 520e-9, 780e-9, 8e-6, (1, 41), 4), get_effect("crosstalk")
    line = torch.zeros(1, 41).double()
    line[0, 20] = 1e-7
    found = effect.optical_path(line, at, effect.parameter_values({"sigma": sigma}))[0] / 1e-7
    x = (torch.arange(164) - 81.5).double()
    assert float(found.sum()) == pytest.approx(4.0, rel=1e-9)
    spread = float((found * x**2).sum() / found.sum())
    assert spread == pytest.approx((4**2 - 1) / 12 + (4 * sigma) ** 2, rel=1e-5)  # of four samples, and of the blur


def test_an_equal_path_stays_equal() -> None:
    at, effect = ModulatorContext(1, 520e-9, 780e-9, 8e-6, (6, 8), 2), get_effect("crosstalk")
    found = effect.optical_path(torch.full((6, 8), 3e-7).double(), at, effect.parameter_values({"sigma": 0.7}))
    torch.testing.assert_close(found, torch.full((12, 16), 3e-7).double(), rtol=1e-12, atol=0)
