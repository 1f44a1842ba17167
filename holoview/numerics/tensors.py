"""Small operations by tensor methods, without importing torch, which takes seconds.

Rectangular regions of images; linear interpolation in tables of equidistant knots; powers with finite gradients.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch
    from torch import Tensor


Region = tuple[int, int, int, int]
"""x, y, width, height in samples; x counts along the last axis, and (0, 0) is the first sample."""


def region_slices(region: Region) -> tuple[slice, slice]:
    """The region as slices of the axes (y, x)."""
    x, y, width, height = region
    return slice(y, y + height), slice(x, x + width)


def zero_outside(images: torch.Tensor, rows: slice, columns: slice) -> None:
    """Sets the samples (…, y, x) outside two slices, each with a start and a stop, to zero in place."""
    images[..., : rows.start, :].zero_()
    images[..., rows.stop :, :].zero_()
    images[..., rows, : columns.start].zero_()
    images[..., rows, columns.stop :].zero_()


def knot_interval(values: Tensor, intervals: int) -> tuple[Tensor, Tensor]:
    """Where values in 0…1 lie between the equidistant knots 0, 1/intervals, …, 1; values outside are clamped.

    Returns the index of the knot below (int64) and the fraction of the interval above it, in 0…1, each of the shape of
    `values`: a table t is linearly interpolated by t[index]·(1 − fraction) + t[index + 1]·fraction.
    """
    position = (values * intervals).clamp(0, intervals)
    below = position.floor().clamp_max(intervals - 1)
    return below.long(), position - below


def power_law(values: Tensor, exponent: float) -> Tensor:
    """values^exponent for values ≥ 0 and an exponent > 0, of the same shape; an exponent of 1 changes no bit.

    At 0 the derivative counts as 0: for exponents below 1 it is infinite there, and a product with 0 wouldn't be a
    number.
    """
    if exponent == 1.0:
        return values
    is_zero = values <= 0
    return (values.masked_fill(is_zero, 1.0) ** exponent).masked_fill(is_zero, 0.0)
