"""Conventions of sampled grids and their Fourier transforms, defined once.

The centre of a grid of N samples lies at index (N − 1)/2. Frequencies are in the order of `numpy.fft.fftfreq`: zero
first, never shifted. Lengths that both executors can transform are 2^a·3^b·5^c.

Operations by tensor methods, which need no import of torch: rectangular regions of images, linear interpolation in
tables of equidistant knots, powers with finite gradients.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import torch
    from torch import Tensor

AREA = 0
"""In place of the number of points that a camera pixel averages: it averages its area."""


def is_fast_length(n: int) -> bool:
    """Whether n = 2^a·3^b·5^c, a length that the FFT in shaders can transform."""
    if n < 1:
        return False
    for prime in (2, 3, 5):
        while n % prime == 0:
            n //= prime
    return n == 1


def next_fast_length(at_least: int, multiple_of: int = 1) -> int:
    """The smallest n = 2^a·3^b·5^c with n ≥ `at_least` that is divisible by `multiple_of`.

    Raises ValueError unless `multiple_of` is such a product itself.
    """
    if not is_fast_length(multiple_of):
        raise ValueError(f"multiple_of = {multiple_of}: expected a product of 2, 3 and 5")
    n = -(-max(at_least, 1) // multiple_of)
    while not is_fast_length(n):
        n += 1
    return n * multiple_of


def ceil_div(value: int, divisor: int) -> int:
    """⌈value / divisor⌉ for a positive divisor."""
    return -(-value // divisor)


def round_up(value: int, multiple: int) -> int:
    """The smallest multiple of `multiple` that is not less than `value`."""
    return ceil_div(value, multiple) * multiple


def positions(n: int, spacing: float) -> NDArray[np.float64]:
    """Positions of n samples `spacing` apart, shape (n,), counted from the grid's centre; in the unit of `spacing`."""
    return (np.arange(n, dtype=np.float64) - (n - 1) / 2) * spacing


def frequency_indices(n: int) -> NDArray[np.int64]:
    """The signed frequency index of each FFT bin, shape (n,): 0, 1, …, −2, −1, which is `fftfreq(n)·n`."""
    return np.rint(np.fft.fftfreq(n) * n).astype(np.int64)


@lru_cache(maxsize=256)  # edits of a bench ask for the same pixels again and again
def pixel_spectrum(padded: int, upsample: int, slope: float) -> NDArray[np.complex128]:
    """The spectrum of one pixel along an axis, (padded,): Σ_j exp(2πi·j·(slope − k/padded)), j < upsample.

    padded: length of the FFT of samples. upsample: samples of the pixel. slope: of the phase, turns a sample.

    The FFT of an upsampled pattern is the FFT of its pixels, repeated `upsample` times, times this spectrum. The array
    can't be written to.
    """
    turns = slope - np.arange(padded) / padded
    spectrum: NDArray[np.complex128] = np.exp(2j * math.pi * np.outer(np.arange(upsample), turns)).sum(axis=0)
    spectrum.setflags(write=False)
    return spectrum


def taper(n: int, share: float) -> NDArray[np.float64]:
    """1 in the middle, falling to 0 over this share of the n samples at each end as a squared sine."""
    edge = max(2, round(share * n))
    rise = np.sin(np.pi / 2 * (np.arange(edge) + 0.5) / edge) ** 2
    window = np.ones(n)
    window[:edge], window[n - edge :] = rise, rise[::-1]
    return window


# --- operations by tensor methods -------------------------------------------------------------------------------------


Region = tuple[int, int, int, int]
"""x, y, width, height in samples; x counts along the last axis, and (0, 0) is the first sample."""


def region_slices(region: Region) -> tuple[slice, slice]:
    """The region as slices of the axes (y, x)."""
    x, y, width, height = region
    return slice(y, y + height), slice(x, x + width)


def central_region(shape: tuple[int, ...]) -> Region:
    """The central half of an image of (rows, columns), as (x, y, w, h); at least a sample."""
    rows, columns = shape[0], shape[1]
    return columns // 4, rows // 4, max(columns // 2, 1), max(rows // 2, 1)


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


def first_of_part(
    whole: tuple[int, int], part: tuple[int, int], centre_m: tuple[float, float], pitch_m: float
) -> tuple[int, int]:
    """Row and column of the first pixel of a part. whole, part: (rows, columns); centre_m: (y, x) of the part's."""
    y, x = ((n - own) // 2 + round(c / pitch_m) for n, own, c in zip(whole, part, centre_m, strict=True))
    return y, x
