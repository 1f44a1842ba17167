"""Powers as they are, with gradients that are finite at zero."""

from __future__ import annotations

import pytest
import torch

from holoview.numerics.tensors import power_law


@pytest.mark.parametrize("exponent", [0.3, 1.0, 2.2])
def test_values_and_slopes_are_those_of_a_power_and_finite_at_zero(exponent: float) -> None:
    values = torch.tensor([0.0, 0.2, 1.0], dtype=torch.float64, requires_grad=True)
    found = power_law(values, exponent)
    torch.testing.assert_close(found, values.detach() ** exponent)
    found.sum().backward()
    slope = values.grad
    assert slope is not None and bool(slope.isfinite().all())
    torch.testing.assert_close(slope[1:], exponent * values.detach()[1:] ** (exponent - 1))
