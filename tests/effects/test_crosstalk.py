"""A line of path spreads by the variance of the Gaussian; the total stays."""

from __future__ import annotations

import pytest
import torch

from holoview.effects.places import Surface
from holoview.effects.registry import effect


@pytest.mark.parametrize("sigma", [0.3, 0.45, 1.2])
def test_a_pixel_spreads_by_the_variance_of_the_blur(sigma: float) -> None:
    at, one = Surface(0, 520e-9, 780e-9, 8e-6, (1, 41), 4), effect("crosstalk")
    line = torch.zeros(1, 41).double()
    line[0, 20] = 1e-7
    found = one.path(line, at, one.values({"sigma": sigma}))[0] / 1e-7
    x = (torch.arange(164) - 81.5).double()
    assert float(found.sum()) == pytest.approx(4.0, rel=1e-9)
    spread = float((found * x**2).sum() / found.sum())
    assert spread == pytest.approx((4**2 - 1) / 12 + (4 * sigma) ** 2, rel=1e-5)  # of four samples, and of the blur


def test_an_equal_path_stays_equal() -> None:
    at, one = Surface(1, 520e-9, 780e-9, 8e-6, (6, 8), 2), effect("crosstalk")
    found = one.path(torch.full((6, 8), 3e-7).double(), at, one.values({"sigma": 0.7}))
    torch.testing.assert_close(found, torch.full((12, 16), 3e-7).double(), rtol=1e-12, atol=0)
