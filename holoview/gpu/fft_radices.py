"""Factorises the length of an FFT into the radices of its passes, and gives the order of the resulting spectrum.

An in-place forward pass of radix r over blocks of M points replaces each block by r sub-blocks of M/r points; sub-block
k contains the frequencies f ≡ k (mod r). After passes of radices r₁, r₂, …, the position whose mixed-radix digits are
d₁ d₂ d₃ … (most significant first) holds the frequency d₁ + r₁·(d₂ + r₂·(d₃ + …)): the order is digit-reversed.
"""

from __future__ import annotations

from functools import cache

from holoview.numerics.fft_grid import is_fast_length, next_fast_length
from holoview.util.errors import UserError

MAX_RADIX = 32
MAX_LENGTH = 8192


@cache
def radices(n: int, last_multiple_of: int = 1) -> tuple[int, ...]:
    """The radices of the passes over n points, largest first: the smallest number of factors, then the smallest sum.

    last_multiple_of: a divisor, up to 32, of n; the last radix is a multiple of it.

    Few passes need little memory bandwidth; similar radices need few registers. A single point needs no pass.
    Raises UserError unless n = 2^a·3^b·5^c ≤ 8192; its remedy names the next possible size.
    """
    if n > MAX_LENGTH:
        raise UserError("FFT size", f"{n} points a side", expected=f"at most {MAX_LENGTH}", remedy="lower the size")
    if not is_fast_length(n):
        remedy = f"the next good size is {next_fast_length(n)}"
        raise UserError("FFT size", f"{n} points a side", expected="a product of 2, 3 and 5", remedy=remedy)
    possible = (
        (*factors[:i], *factors[i + 1 :], last)
        for factors in _factorisations(n, MAX_RADIX)
        for i, last in enumerate(factors)
        if last % last_multiple_of == 0 and last not in factors[i + 1 :]
    )
    return min(possible, key=lambda factors: (len(factors), sum(factors), factors[-1]), default=())


def _factorisations(n: int, largest: int) -> list[tuple[int, ...]]:
    """All ways to write n as a product of factors from 2 to `largest`, each in descending order."""
    if n == 1:
        return [()]
    return [
        (first, *rest)
        for first in range(min(n, largest), 1, -1)
        if n % first == 0
        for rest in _factorisations(n // first, first)
    ]
