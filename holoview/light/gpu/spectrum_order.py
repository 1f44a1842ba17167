"""Which frequencies of a line are stored, and in which order.

A transform of n points ends with small transforms of r values, which differ in the highest digit of the frequency only:
f = digit·n/r + rest. If only a band of frequencies is wanted, the digits that no frequency of the band has are neither
computed nor stored. In the same way a transform begins with small transforms over the highest digit of the point, and
points that are zero needn't be loaded. The stored frequencies contain the band; there may be up to n/r more on either
side.

Two orders exist. In natural order a digit's n/r frequencies follow each other. In digit-reversed order (see
`fft_codegen`) the stored digits of a rest follow each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from holoview.light.numerics.sampling import frequency_indices

Range = tuple[int, int]
"""The lowest and the highest of successive indices; a negative index i of n points or frequencies stands for i + n."""


def covered_digits(n: int, radix: int, indices: Range | None) -> tuple[int, ...]:
    """The digits j, ascending, for which an index of the range modulo n is in j·n/radix … (j + 1)·n/radix − 1.

    All digits if `indices` is None.
    """
    if indices is None or indices[1] - indices[0] + 1 >= n:
        return tuple(range(radix))
    share = n // radix
    first, last = indices[0] // share, indices[1] // share
    return tuple(sorted({digit % radix for digit in range(first, last + 1)}))


@dataclass(frozen=True)
class SpectrumOrder:
    """The stored frequencies of a line of n = Π `radices` points, in order of position.

    radices: of the passes; in natural order n/r and r. digits: the stored ones, at most two runs of successive digits.
    """

    radices: tuple[int, ...]
    digits: tuple[int, ...]
    is_natural: bool = False

    @classmethod
    def natural(cls, n: int, lanes: int, band: Range | None) -> SpectrumOrder:
        """The frequencies of a transform that ends with small ones of `lanes` values, in natural order."""
        return cls((n // lanes, lanes), covered_digits(n, lanes, band), is_natural=True)

    @classmethod
    def reversed_order(cls, radices: tuple[int, ...], band: Range | None) -> SpectrumOrder:
        """The frequencies of passes of these radices, in digit-reversed order."""
        n = math.prod(radices)
        return cls(radices, covered_digits(n, radices[-1] if radices else 1, band))

    @property
    def length(self) -> int:
        """Number of points, n."""
        return math.prod(self.radices)

    @property
    def count(self) -> int:
        """Number of stored frequencies."""
        return len(self.digits) * self._share

    @property
    def _share(self) -> int:
        """Frequencies of each digit, n/r."""
        return self.length // self._radix

    @property
    def _radix(self) -> int:
        return self.radices[-1] if self.radices else 1

    def frequencies(self) -> NDArray[np.int32]:
        """Signed frequency index at each position, shape (count,)."""
        positions, kept = np.arange(self.count), len(self.digits)
        number = positions // self._share if self.is_natural else positions % kept
        rest = positions % self._share if self.is_natural else self._reversed_rest(positions // kept)
        frequency = np.array(self.digits)[number] * self._share + rest
        return frequency_indices(self.length)[frequency].astype(np.int32)

    def _reversed_rest(self, rest: NDArray[np.int64]) -> NDArray[np.int64]:
        block, weight, frequency = self._share, 1, np.zeros_like(rest)
        for radix in self.radices[:-1]:
            block //= radix
            frequency += weight * (rest // block)
            rest = rest % block
            weight *= radix
        return frequency

    def frequency_wgsl(self, name: str) -> str:
        """WGSL of a function `name(position: u32) -> i32` with the values of `frequencies`."""
        n, share, kept = self.length, self._share, len(self.digits)
        lines = [f"let number = position {'/' if self.is_natural else '%'} {share if self.is_natural else kept}u;"]
        lines.append(f"let rest = position {'%' if self.is_natural else '/'} {share if self.is_natural else kept}u;")
        first, gap, run = self._runs()
        lines.append(f"let digit = number + {first}u" + (f" + select(0u, {gap}u, number >= {run}u);" if gap else ";"))
        lines.append(f"var frequency = digit * {share}u" + (" + rest;" if self.is_natural else ";"))
        block, weight = share, 1
        for radix in () if self.is_natural else self.radices[:-1]:
            block //= radix
            lines.append(f"frequency += {weight}u * ((rest / {block}u) % {radix}u);")
            weight *= radix
        lines.append(f"return select(i32(frequency), i32(frequency) - {n}, frequency >= {math.ceil(n / 2)}u);")
        return _function(
            f"// Signed frequency index at a position of a spectrum.\nfn {name}(position: u32) -> i32", lines
        )

    def position_wgsl(self, name: str) -> str:
        """WGSL of a function `name(frequency: i32) -> u32`: the position of a stored frequency.

        It may be any k + i·n that is at least −64·n.
        """
        n, share = self.length, self._share
        lines = [f"let wrapped = u32(frequency + {64 * n}) % {n}u;", f"let digit = wrapped / {share}u;"]
        first, gap, run = self._runs()
        missing = f" - select(0u, {gap}u, digit >= {first + run + gap}u)" if gap else ""
        lines += [f"let number = digit - {first}u{missing};", f"var rest = wrapped % {share}u;"]
        if self.is_natural:
            return _function(f"fn {name}(frequency: i32) -> u32", [*lines, f"return number * {share}u + rest;"])
        lines.append("var block = 0u;")
        for radix in self.radices[:-1]:
            lines += [f"block = block * {radix}u + rest % {radix}u;", f"rest /= {radix}u;"]
        lines.append(f"return block * {len(self.digits)}u + number;")
        return _function(f"// Position of a frequency.\nfn {name}(frequency: i32) -> u32", lines)

    def _runs(self) -> tuple[int, int, int]:
        """The first digit, the digits missing between the first run and the second, the length of the first run."""
        first = self.digits[0]
        run = next((i for i, digit in enumerate(self.digits) if digit != first + i), len(self.digits))
        return first, self.digits[run] - first - run if run < len(self.digits) else 0, run


def _function(head: str, lines: list[str]) -> str:
    return "\n".join([f"{head} {{", *(f"    {line}" for line in lines), "}", ""])


Direction = Literal["forward", "inverse"]


@dataclass(frozen=True)
class LineTransform:
    """A transform of lines of n points.

    points: the points that may differ from 0 in a forward transform, or that an inverse one has to compute; None means
    all. band: the frequencies that a forward transform has to compute, or that may differ from 0 in an inverse one.
    repeats: a forward transform followed by an inverse one may have n/repeats points. Its spectrum is then repeated to
    n frequencies, which is the spectrum of these points with repeats − 1 zeros after each.
    """

    direction: Direction
    points: Range | None = None
    band: Range | None = None
    repeats: int = 1
