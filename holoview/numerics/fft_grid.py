"""Coordinates and FFT conventions, defined once.

Frequencies are `fftfreq`: zero first, no shifted copies. The centre of a grid of N samples is at index (N − 1)/2 in
position. Sizes that both executors can transform are 2^a·3^b·5^c.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def is_fast_length(n: int) -> bool:
    """Whether n = 2^a·3^b·5^c, the lengths that the shader FFT can transform."""
    if n < 1:
        return False
    for prime in (2, 3, 5):
        while n % prime == 0:
            n //= prime
    return n == 1


def next_fast_length(at_least: int, multiple_of: int = 1) -> int:
    """The smallest n = 2^a·3^b·5^c that is at least `at_least` and divisible by `multiple_of` (also such a number)."""
    if not is_fast_length(multiple_of):
        raise ValueError(f"multiple_of = {multiple_of}: expected a product of 2, 3 and 5")
    n = -(-max(at_least, 1) // multiple_of)
    while not is_fast_length(n):
        n += 1
    return n * multiple_of


def positions(n: int, pitch_m: float) -> NDArray[np.float64]:
    """Sample positions (m), shape (n,), centred on (n − 1)/2."""
    return (np.arange(n, dtype=np.float64) - (n - 1) / 2) * pitch_m


def frequency_indices(n: int) -> NDArray[np.int64]:
    """Signed frequency index of each FFT bin, shape (n,): 0, 1, …, −2, −1 (as `fftfreq(n) * n`)."""
    return np.rint(np.fft.fftfreq(n) * n).astype(np.int64)
