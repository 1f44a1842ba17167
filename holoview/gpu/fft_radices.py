"""Factorises the length of an FFT into the radices of its passes, and gives the order of the resulting spectrum.

An in-place forward pass of radix r over blocks of M points replaces each block by r sub-blocks of M/r points; sub-block
k contains the frequencies f ≡ k (mod r). After passes of radices r₁, r₂, …, the position whose mixed-radix digits are
d₁ d₂ d₃ … (most significant first) holds the frequency d₁ + r₁·(d₂ + r₂·(d₃ + …)): the order is digit-reversed.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from holoview.numerics.fft_grid import frequency_indices, is_fast_length, next_fast_length
from holoview.util.errors import UserError

MAX_RADIX = 32
MAX_LENGTH = 8192


@cache
def radices(n: int) -> tuple[int, ...]:
    """The radices of the passes over n points, largest first: the smallest number of factors, then the smallest sum.

    Few passes need little memory bandwidth; similar radices need few registers. A single point needs no pass.
    Raises UserError unless n = 2^a·3^b·5^c ≤ 8192; its remedy names the next possible size.
    """
    if n > MAX_LENGTH:
        raise UserError("FFT size", f"{n} points a side", expected=f"at most {MAX_LENGTH}", remedy="lower the size")
    if not is_fast_length(n):
        remedy = f"the next good size is {next_fast_length(n)}"
        raise UserError("FFT size", f"{n} points a side", expected="a product of 2, 3 and 5", remedy=remedy)
    return min(_factorisations(n, MAX_RADIX), key=lambda factors: (len(factors), sum(factors)))


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


def frequency_order(n: int) -> NDArray[np.int32]:
    """Signed frequency index at each position of the spectrum of n points, shape (n,)."""
    rest, block, weight = np.arange(n), n, 1
    frequency = np.zeros(n, np.int64)
    for radix in radices(n):
        block //= radix
        frequency += weight * (rest // block)
        rest %= block
        weight *= radix
    return frequency_indices(n)[frequency].astype(np.int32)


def frequency_wgsl(name: str, n: int) -> str:
    """WGSL of a function `name(position: u32) -> i32` with the values of `frequency_order`."""
    lines, block, weight = [], n, 1
    for radix in radices(n):
        block //= radix
        lines.append(f"    frequency += {weight}u * ((position / {block}u) % {radix}u);")
        weight *= radix
    half = math.ceil(n / 2)
    return "\n".join(
        [
            f"// Signed frequency index at a position of the spectrum of {n} points, whose digits are reversed.",
            f"fn {name}(position: u32) -> i32 {{",
            "    var frequency = 0u;",
            *lines,
            f"    return select(i32(frequency), i32(frequency) - {n}, frequency >= {half}u);",
            "}",
            "",
        ]
    )
