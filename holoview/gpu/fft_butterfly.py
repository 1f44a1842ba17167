"""Generates WGSL of small discrete Fourier transforms whose values stay in registers.

The code is straight-line: each complex value is a `let` of type vec2f (real, imaginary). A length is factorised into 2,
3, 4 and 5, which have formulas of their own; the twiddle factors between them are constants, evaluated in float64.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Literal

Sign = Literal[-1, 1]
ZERO = "0"
"""The name of a value that is known to be 0: sums with it and products of it need no code."""
_EXACT = 1e-12


class WgslEmitter:
    """Collects WGSL statements in `lines` and generates names for the values that they define."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._count = 0
        self._twiddle_names: dict[tuple[str, int, int], list[str]] = {}

    def let(self, expression: str) -> str:
        """Emit `let name = expression;` and return the name."""
        name = f"t{self._count}"
        self._count += 1
        self.lines.append(f"let {name} = {expression};")
        return name

    def add(self, a: str, b: str) -> str:
        """a + b"""
        if ZERO in (a, b):
            return b if a == ZERO else a
        return self.let(f"{a} + {b}")

    def subtract(self, a: str, b: str) -> str:
        """a − b"""
        if ZERO in (a, b):
            return a if b == ZERO else self.let(f"-{b}")
        return self.let(f"{a} - {b}")

    def combine(self, *terms: tuple[float, str]) -> str:
        """The sum of factor·name over the terms."""
        needed = [(factor, name) for factor, name in terms if name != ZERO]
        if not needed:
            return ZERO
        products = [name if abs(factor) == 1.0 else f"{wgsl_float(abs(factor))} * {name}" for factor, name in needed]
        signs = [" - " if factor < 0 else " + " for factor, _ in needed]
        first = "-" if needed[0][0] < 0 else ""
        return self.let(first + products[0] + "".join(map(str.__add__, signs[1:], products[1:])))

    def times_i(self, a: str, sign: Sign) -> str:
        """±i·a"""
        if a == ZERO:
            return ZERO
        return self.let(f"vec2f(-{a}.y, {a}.x)" if sign > 0 else f"vec2f({a}.y, -{a}.x)")

    def times_constant(self, a: str, constant: complex) -> str:
        """a times a constant of modulus 1; multiples of an eighth of a turn need no complex product."""
        real, imaginary = constant.real, constant.imag
        if a == ZERO:
            return ZERO
        if abs(imaginary) < _EXACT:
            return a if real > 0 else self.let(f"-{a}")
        if abs(real) < _EXACT:
            return self.times_i(a, 1 if imaginary > 0 else -1)
        if abs(abs(real) - abs(imaginary)) < _EXACT:
            rotated = self.times_i(a, 1 if imaginary > 0 else -1)
            return self.let(f"({rotated} {'+' if real > 0 else '-'} {a}) * {wgsl_float(abs(real))}")
        return self.let(f"cmul({a}, vec2f({wgsl_float(real)}, {wgsl_float(imaginary)}))")

    def twiddles(self, index: str, count: int, period: int) -> list[str]:
        """Names of w⁰ … w^(count−1), w = exp(−2πi·index/period) with a WGSL u32 `index`; the name of w⁰ = 1 is empty.

        w, w², w⁴, … are evaluated directly, the others as products of two of them. Successive multiplication by w would
        lose a decimal digit. Equal arguments give the names of the first call.
        """
        if (index, count, period) in self._twiddle_names:
            return self._twiddle_names[index, count, period]
        powers = self._twiddle_names[index, count, period] = [""]
        for k in range(1, count):
            highest = 1 << (k.bit_length() - 1)
            if k == highest:
                # index·k is an integer below 2^13, which f32 holds exactly, so that the angle is rounded only once
                powers.append(self.let(f"cis(f32({index} * {k}u) * {wgsl_float(-1 / period)})"))
            else:
                powers.append(self.let(f"cmul({powers[highest]}, {powers[k - highest]})"))
        return powers

    def times_twiddles(self, values: Sequence[str], twiddles: Sequence[str], *, conjugate: bool) -> list[str]:
        """values[k] times twiddles[k] or its conjugate; an empty name stands for 1."""
        product = "cmul_conj" if conjugate else "cmul"
        return [
            self.let(f"{product}({value}, {twiddle})") if twiddle and value != ZERO else value
            for value, twiddle in zip(values, twiddles, strict=True)
        ]


def wgsl_float(value: float) -> str:
    """A WGSL float literal with more digits than f32 holds."""
    text = f"{value:.12g}"
    return text if set(text) & set(".e") else f"{text}.0"


def scattered(values: Sequence[str], places: Sequence[int], count: int) -> list[str]:
    """`count` names: those of `values` at their `places`, and ZERO elsewhere."""
    out = [ZERO] * count
    for place, value in zip(places, values, strict=True):
        out[place] = value
    return out


def emit_dft(code: WgslEmitter, values: Sequence[str], sign: Sign) -> list[str]:
    """Emit X[k] = Σ_j x[j]·exp(sign·2πi·jk/n) for the n named values x; return the names of X[0] … X[n−1]."""
    n = len(values)
    if n == 1 or all(value == ZERO for value in values):
        return list(values)
    if n in _SMALL_DFTS:
        return _SMALL_DFTS[n](code, values, sign)
    # Cooley and Tukey with the factors nearest to √n, which leave the fewest twiddle factors
    first = max(factor for factor in range(2, math.isqrt(n) + 1) if n % factor == 0)
    second = n // first
    columns = []
    for j in range(second):
        column = emit_dft(code, [values[second * i + j] for i in range(first)], sign)
        twiddles = [cmath.exp(sign * 2j * math.pi * k * j / n) for k in range(first)]
        columns.append([code.times_constant(v, w) for v, w in zip(column, twiddles, strict=True)])
    rows = [emit_dft(code, [column[k] for column in columns], sign) for k in range(first)]
    return [rows[k % first][k // first] for k in range(n)]


def _dft2(code: WgslEmitter, x: Sequence[str], sign: Sign) -> list[str]:
    return [code.add(x[0], x[1]), code.subtract(x[0], x[1])]


def _dft3(code: WgslEmitter, x: Sequence[str], sign: Sign) -> list[str]:
    total, difference = code.add(x[1], x[2]), code.subtract(x[1], x[2])
    middle = code.combine((1.0, x[0]), (-0.5, total))
    rotated = code.combine((math.sqrt(3) / 2, code.times_i(difference, sign)))
    return [code.add(x[0], total), code.add(middle, rotated), code.subtract(middle, rotated)]


def _dft4(code: WgslEmitter, x: Sequence[str], sign: Sign) -> list[str]:
    even, odd = code.add(x[0], x[2]), code.add(x[1], x[3])
    even_difference = code.subtract(x[0], x[2])
    odd_difference = code.times_i(code.subtract(x[1], x[3]), sign)
    return [
        code.add(even, odd),
        code.add(even_difference, odd_difference),
        code.subtract(even, odd),
        code.subtract(even_difference, odd_difference),
    ]


def _dft5(code: WgslEmitter, x: Sequence[str], sign: Sign) -> list[str]:
    c1, s1 = (f(2 * math.pi / 5) for f in (math.cos, math.sin))
    c2, s2 = (f(4 * math.pi / 5) for f in (math.cos, math.sin))
    outer, inner = code.add(x[1], x[4]), code.add(x[2], x[3])
    outer_difference, inner_difference = code.subtract(x[1], x[4]), code.subtract(x[2], x[3])
    a = code.combine((1.0, x[0]), (c1, outer), (c2, inner))
    b = code.combine((1.0, x[0]), (c2, outer), (c1, inner))
    p = code.times_i(code.combine((s1, outer_difference), (s2, inner_difference)), sign)
    q = code.times_i(code.combine((s2, outer_difference), (-s1, inner_difference)), sign)
    total = code.combine((1.0, x[0]), (1.0, outer), (1.0, inner))
    return [total, code.add(a, p), code.add(b, q), code.subtract(b, q), code.subtract(a, p)]


_SMALL_DFTS = {2: _dft2, 3: _dft3, 4: _dft4, 5: _dft5}
