"""The quantity of real numbers: amplitude, phase, intensity, a bilevel pattern, or a camera's picture of an
interference.

Names state it, or else the values show it: phases are spread evenly over their range, because whole periods are
removed, or alternate from sample to sample (double-phase patterns), while pictures of a camera have a peak and are
smooth over the distance of two pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

TURN = 2 * math.pi
_BINS = 16
_EVEN = 0.15
"""Largest distance from an even distribution (half the sum of absolute differences) of values that are phases.

Speckle's amplitudes and intensities (Rayleigh's and exponential distributions over their range) have 0.48 and more, a
camera's sinusoidal fringes of full contrast 0.21."""

_ALTERNATING = 0.2
"""Least share of a chessboard's pattern in double-phase patterns, which take φ + acos(a) and φ − acos(a) in turn.

It is below 0.02 in eleven public recordings, off-axis ones with fringes of two pixels among them."""

MOST_SAMPLE = 1024
"""Rows and columns of the middle of an array by which its values are judged."""


@dataclass(frozen=True)
class Judgement:
    """quantity: as in `ReadRequest`, or "recording". reason: in words."""

    quantity: str
    reason: str


def judge(sample: NDArray[Any]) -> Judgement:
    """What real numbers (…, y, x) are by their values."""
    values = sample.astype(np.float64)
    low, high = float(values.min()), float(values.max())
    if sample.dtype.kind == "b" or (high > low and bool(((values == low) | (values == high)).all())):
        return Judgement("bilevel", "it has two values only")
    if low < 0:
        if sample.dtype.kind == "f" and -math.pi - 1e-3 <= low < -3 and 3 < high <= math.pi + 1e-3:
            return Judgement("phase", "its values reach from −π to π")
        return Judgement("recording", "it is real and has negative values, as pictures without their background")
    if sample.dtype.kind == "f" and 6.2 < high <= TURN + 1e-3:
        return Judgement("phase", "its values reach from 0 to 2π")
    full = _full_scale(sample.dtype, high)
    if unevenness(values, full) < _EVEN:
        return Judgement("phase", "its values are spread evenly over the whole range, as phases are")
    if alternation(values) > _ALTERNATING:
        return Judgement("phase", "its values alternate from sample to sample, as double-phase patterns do")
    return Judgement("recording", "its values have a peak, as a camera's picture")


def unevenness(values: NDArray[np.float64], full: float) -> float:
    """How far the distribution of values from 0 to `full` is from an even one: 0 even, towards 1 in one place."""
    counts, _ = np.histogram(values, _BINS, (0, full))
    shares = counts / max(values.size, 1)
    return float(0.5 * np.abs(shares - 1 / _BINS).sum())


def alternation(values: NDArray[np.float64]) -> float:
    """The mean of (…, y, x) with the signs of a chessboard, in standard deviations: of N random values 1/√N or so."""
    deviation = float(values.std())
    signs = (-1.0) ** np.add.outer(np.arange(values.shape[-2]), np.arange(values.shape[-1]))
    return float(abs((values * signs).mean(axis=(-2, -1))).max()) / deviation if deviation > 0 else 0.0


def _full_scale(dtype: np.dtype[Any], high: float) -> float:
    """The value that stands for the top of the range: 255 in 16-bit files that use 8 bits."""
    if dtype.kind in "iu":
        return full_scale(dtype, high)
    return 1.0 if high <= 1 else max(high, 1e-300)


def full_scale(dtype: np.dtype[Any], high: float) -> float:
    """The greatest value of an integer type, or 255, 1023, 4095 … where only so many bits of it are used."""
    bits = 8 * dtype.itemsize - (dtype.kind == "i")
    used = next((b for b in (8, 10, 12, 14, bits) if high < 2**b and b <= bits), bits)
    return float(2**used - 1)


def phase_levels(dtype: np.dtype[Any], low: float, high: float) -> tuple[float, str]:
    """The number that stands for 2π, and why."""
    if dtype.kind in "iu":
        full = full_scale(dtype, high)
        return full, f"values up to {high:g}: {full:g} stands for 2π (programs differ: {full:g} or {full + 1:g})"
    if low >= 0 and high <= 1.0001:
        return 1.0, "values from 0 to 1: 1 stands for 2π"
    if low >= 0 and 7 < high <= 255.5:
        return 255.0, f"values up to {high:g}: 255 stands for 2π"
    return TURN, "radians"
