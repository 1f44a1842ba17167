"""WGSL of a small discrete Fourier transform whose values all stay in registers.

Straight-line code: each complex value is a `let` of type vec2f. A length splits into factors 2, 3, 4 and 5, which have
kernels of their own; the constants between them are evaluated here, in float64.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Literal

Sign = Literal[-1, 1]
_EXACT = 1e-12


class WgslEmitter:
    """Collects WGSL statements and names the values they define."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._count = 0

    def let(self, expression: str) -> str:
        """Define a value and return its name."""
        name = f"t{self._count}"
        self._count += 1
        self.lines.append(f"let {name} = {expression};")
        return name

    def add(self, a: str, b: str) -> str:
        """a + b"""
        return self.let(f"{a} + {b}")

    def subtract(self, a: str, b: str) -> str:
        """a − b"""
        return self.let(f"{a} - {b}")

    def times_i(self, a: str, sign: Sign) -> str:
        """±i·a"""
        return self.let(f"vec2f(-{a}.y, {a}.x)" if sign > 0 else f"vec2f({a}.y, -{a}.x)")

    def times_constant(self, a: str, constant: complex) -> str:
        """a times a unit complex constant; multiples of an eighth of a turn need no full product."""
        real, imaginary = constant.real, constant.imag
        if abs(imaginary) < _EXACT:
            return a if real > 0 else self.let(f"-{a}")
        if abs(real) < _EXACT:
            return self.times_i(a, 1 if imaginary > 0 else -1)
        if abs(abs(real) - abs(imaginary)) < _EXACT:
            turned = self.times_i(a, 1 if imaginary > 0 else -1)
            return self.let(f"({turned} {'+' if real > 0 else '-'} {a}) * {wgsl_float(abs(real))}")
        return self.let(f"cmul({a}, vec2f({wgsl_float(real)}, {wgsl_float(imaginary)}))")


def wgsl_float(value: float) -> str:
    """A WGSL float with more digits than f32 holds."""
    text = f"{value:.12g}"
    return text if set(text) & set(".e") else f"{text}.0"


def emit_dft(code: WgslEmitter, values: Sequence[str], sign: Sign) -> list[str]:
    """Emit X[k] = Σ x[j]·exp(sign·2πi·jk/n) over the n named values; returns the names of X in natural order."""
    n = len(values)
    if n == 1:
        return list(values)
    if n in _KERNELS:
        return _KERNELS[n](code, values, sign)
    first = max(factor for factor in range(2, math.isqrt(n) + 1) if n % factor == 0)  # even factors turn the fewest
    second = n // first
    columns = []
    for j in range(second):
        column = emit_dft(code, [values[second * i + j] for i in range(first)], sign)
        turned = [cmath.exp(sign * 2j * math.pi * k * j / n) for k in range(first)]
        columns.append([code.times_constant(v, w) for v, w in zip(column, turned, strict=True)])
    rows = [emit_dft(code, [column[k] for column in columns], sign) for k in range(first)]
    return [rows[k % first][k // first] for k in range(n)]


def _dft2(code: WgslEmitter, x: Sequence[str], sign: Sign) -> list[str]:
    return [code.add(x[0], x[1]), code.subtract(x[0], x[1])]


def _dft3(code: WgslEmitter, x: Sequence[str], sign: Sign) -> list[str]:
    total, difference = code.add(x[1], x[2]), code.subtract(x[1], x[2])
    middle = code.let(f"{x[0]} - 0.5 * {total}")
    turned = code.let(f"{wgsl_float(math.sqrt(3) / 2)} * {code.times_i(difference, sign)}")
    return [code.add(x[0], total), code.add(middle, turned), code.subtract(middle, turned)]


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
    c1, s1 = (wgsl_float(f(2 * math.pi / 5)) for f in (math.cos, math.sin))
    c2, s2 = (wgsl_float(f(4 * math.pi / 5)) for f in (math.cos, math.sin))
    outer, inner = code.add(x[1], x[4]), code.add(x[2], x[3])
    outer_difference, inner_difference = code.subtract(x[1], x[4]), code.subtract(x[2], x[3])
    a = code.let(f"{x[0]} + {c1} * {outer} + {c2} * {inner}")
    b = code.let(f"{x[0]} + {c2} * {outer} + {c1} * {inner}")
    p = code.times_i(code.let(f"{s1} * {outer_difference} + {s2} * {inner_difference}"), sign)
    q = code.times_i(code.let(f"{s2} * {outer_difference} - {s1} * {inner_difference}"), sign)
    total = code.let(f"{x[0]} + {outer} + {inner}")
    return [total, code.add(a, p), code.add(b, q), code.subtract(b, q), code.subtract(a, p)]


_KERNELS = {2: _dft2, 3: _dft3, 4: _dft4, 5: _dft5}
