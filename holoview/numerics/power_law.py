"""Powers of numbers from 0 on, with gradients that stay finite; by tensor methods, without importing torch."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # torch takes seconds to import, and effects are registered without it
    from torch import Tensor


def power_law(values: Tensor, exponent: float) -> Tensor:
    """values^exponent for values ≥ 0 and an exponent > 0, of the same shape; an exponent of 1 changes no bit.

    At 0 the derivative counts as 0: for exponents below 1 it is infinite there, and a product with 0 wouldn't be a
    number.
    """
    if exponent == 1.0:
        return values
    is_zero = values <= 0
    return (values.masked_fill(is_zero, 1.0) ** exponent).masked_fill(is_zero, 0.0)
