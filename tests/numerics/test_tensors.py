"""Tables with equidistant knots are interpolated as numpy does, and their gradient is the slope between knots."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.light.numerics.sampling import knot_interval, power_law

TABLE = torch.tensor([0.0, 0.1, 0.5, 0.6, 1.0]).double()


def _interpolated(values: torch.Tensor) -> torch.Tensor:
    index, fraction = knot_interval(values, len(TABLE) - 1)
    return TABLE[index] * (1 - fraction) + TABLE[index + 1] * fraction


def test_interpolation_is_that_of_numpy_and_clamped() -> None:
    values = torch.linspace(-0.2, 1.2, 57, dtype=torch.float64)
    expected = np.interp(values.numpy(), np.linspace(0, 1, len(TABLE)), TABLE.numpy())
    assert _interpolated(values).numpy() == pytest.approx(expected, abs=1e-12)


def test_gradients_are_slopes() -> None:
    values = torch.tensor([0.3, 0.9], dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(_interpolated(values).sum(), values)
    assert gradient.tolist() == pytest.approx([1.6, 1.6])


@pytest.mark.parametrize("exponent", [0.3, 1.0, 2.2])
def test_values_and_slopes_are_those_of_a_power_and_finite_at_zero(exponent: float) -> None:
    values = torch.tensor([0.0, 0.2, 1.0], dtype=torch.float64, requires_grad=True)
    found = power_law(values, exponent)
    torch.testing.assert_close(found, values.detach() ** exponent)
    found.sum().backward()
    slope = values.grad
    assert slope is not None and bool(slope.isfinite().all())
    torch.testing.assert_close(slope[1:], exponent * values.detach()[1:] ** (exponent - 1))
