"""Conventions of sampled grids and their Fourier transforms, defined once.

The centre of a grid of N samples lies at index (N − 1)/2. Frequencies are in the order of `numpy.fft.fftfreq`: zero
first, never shifted. Lengths that both executors can transform are 2^a·3^b·5^c.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


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


def positions(n: int, spacing: float) -> NDArray[np.float64]:
    """Positions of n samples `spacing` apart, shape (n,), counted from the grid's centre; in the unit of `spacing`."""
    return (np.arange(n, dtype=np.float64) - (n - 1) / 2) * spacing


def frequency_indices(n: int) -> NDArray[np.int64]:
    """The signed frequency index of each FFT bin, shape (n,): 0, 1, …, −2, −1, which is `fftfreq(n)·n`."""
    return np.rint(np.fft.fftfreq(n) * n).astype(np.int64)
