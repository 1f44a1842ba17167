"""Linear interpolation in a table whose knots are equidistant; by tensor methods, without importing torch."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # torch takes seconds to import, and effects are registered without it
    from torch import Tensor


def knot_interval(values: Tensor, intervals: int) -> tuple[Tensor, Tensor]:
    """Where values in 0…1 lie between the equidistant knots 0, 1/intervals, …, 1; values outside are clamped.

    Returns the index of the knot below (int64) and the fraction of the interval above it, in 0…1, each of the shape of
    `values`: a table t is linearly interpolated by t[index]·(1 − fraction) + t[index + 1]·fraction.
    """
    position = (values * intervals).clamp(0, intervals)
    below = position.floor().clamp_max(intervals - 1)
    return below.long(), position - below
