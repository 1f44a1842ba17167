"""Generates WGSL of one FFT pass: load r values into registers, transform them, store them at the same positions.

A pass needs neither barriers nor workgroup memory, so that it runs on every driver. It accesses memory only through the
hooks `load(position: vec3u) -> vec2f` and `store(position: vec3u, value: vec2f)` with the position (x, y, field).
`line_fft` describes all hooks and combines several passes in one shader. Below the pass stand the small
DFTs in registers of which it consists, and the radices into which a length is factorised.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal

from holoview.light.gpu.shader import WgslStruct
from holoview.light.gpu.spectrum_order import Direction, LineTransform, covered_digits
from holoview.light.numerics.sampling import ceil_div, is_fast_length, next_fast_length
from holoview.util.errors import UserError

Axis = Literal["x", "y"]

LINE_RANGE = WgslStruct("LineRange", [("first", "u32"), ("count", "u32")])
"""Lines to transform, at `@group(0) @binding(0)`: rows in a transform along x, columns in one along y."""
COMMON_DECLARATIONS = f"""//#include "lib/complex.wgsl"

{LINE_RANGE.wgsl}
@group(0) @binding(0) var<uniform> lines: LineRange;

// First point of an invocation, to which constants are added for the others, in a subgroup; otherwise 0.
var<private> lane_point: u32;
"""
"""The beginning of every generated transform shader."""


@dataclass(frozen=True)
class PassShape:
    """Geometry of a pass over lines of `length` points: DFTs of `radix` values within blocks of `block` points.

    The first forward pass, which is the last inverse one, has block = length. The block of each further forward pass is
    the preceding block divided by the preceding radix. The last forward pass has block = radix.

    points, frequencies: the digits (see `spectrum_order`) of the values that are needed before and after the forward
    DFT. The inverse DFT takes the frequencies and gives the points.
    spread: factor of the positions of values between passes, so that each pass of a transform and of a longer one that
    follows it works in place.
    """

    length: int
    block: int
    radix: int
    points: tuple[int, ...]
    frequencies: tuple[int, ...]
    spread: int = 1

    def __post_init__(self) -> None:
        if self.length % self.block or self.block % self.radix:
            raise ValueError(f"{self}: expected a radix that divides the block, and a block that divides the length")

    @property
    def invocations_per_line(self) -> int:
        """Invocations (DFTs) for each line."""
        return self.length // self.radix

    @property
    def stride(self) -> int:
        """Points from one value of a DFT to the next."""
        return self.block // self.radix

    def point_positions(self) -> list[str]:
        """WGSL positions of the points along the line."""
        return [self._position(k) for k in self.points]

    def frequency_positions(self) -> list[str]:
        """WGSL positions along the line of the frequencies, or of the values between two passes."""
        if len(self.frequencies) == self.radix:
            return [self._position(k) for k in self.frequencies]
        return [f"item * {len(self.frequencies)}u + {k}u" for k in range(len(self.frequencies))]

    def between_passes(self, along: str) -> str:
        """WGSL position of a value between passes."""
        return along if self.spread == 1 else f"({along}) * {self.spread}u"

    def _position(self, k: int) -> str:
        start = f"item * {self.radix}u" if self.stride == 1 else f"(item / {self.stride}u) * {self.block}u + offset"
        return f"{start} + {k * self.stride}u"


PassSteps = tuple[tuple[PassShape, Direction], ...]
"""The steps of one pass: one step, or the end of a transform and the beginning of the next."""


def pass_shapes(length: int, factors: tuple[int, ...], step: LineTransform) -> list[PassShape]:
    """The forward passes over lines of `length` points, in order; an inverse transform takes them in reverse order.

    A single point has one pass of radix 1, which only calls the hooks.
    """
    shapes, block = [], length
    for radix in factors or (1,):
        is_first, is_last = block == length, block == radix
        points = covered_digits(length, radix, step.points if is_first else None)
        frequencies = covered_digits(length, radix, step.band if is_last else None)
        shapes.append(PassShape(length, block, radix, points, frequencies, step.repeats))
        block //= radix
    return shapes


def merge_passes(length: int, factors: tuple[int, ...], steps: Sequence[LineTransform]) -> list[PassSteps]:
    """The passes of all steps in order. The last pass of a step and the first of the next are merged into one.

    factors: the radices of `length`; the last one has to be a multiple of each step's `repeats`.
    """
    merged: list[PassSteps] = []
    for step in steps:
        own = (*factors[:-1], factors[-1] // step.repeats) if step.repeats > 1 else factors
        shapes = pass_shapes(length // step.repeats, own, step)
        for number, shape in enumerate(shapes if step.direction == "forward" else shapes[::-1]):
            if number == 0 and merged:
                merged[-1] = (*merged[-1], (shape, step.direction))
            else:
                merged.append(((shape, step.direction),))
    return merged


@lru_cache(maxsize=256)
def generate_pass_shader(
    axis: Axis,
    steps: PassSteps,
    *,
    is_first: bool = True,
    is_last: bool = True,
    begin: bool = True,
    invocations: int = 64,
    is_rough: bool = False,
) -> str:
    """The WGSL of a pass along `axis` with the entry point `main`, to be linked after the hooks that it calls.

    steps: one or two. Between two, values stay in registers and go through the hook `middle`.
    is_first, is_last: of the passes of a transform; others call `load_work` and `store_work`. begin: whether to call
    the hook `begin`. invocations: of a workgroup. is_rough: as of `WgslEmitter`.
    Dispatch `workgroup_grid(pass_workgroups(steps, invocations, lines), device)` workgroups along x and y, and fields
    along z.
    """
    code = WgslEmitter(is_rough=is_rough)
    if begin:
        code.lines.append("begin(across, field);")

    def position(along: str) -> str:
        return f"vec3u({along}, across, field)" if axis == "x" else f"vec3u(across, {along}, field)"

    def load(along: str) -> str:
        return f"load({position(along)})" if is_first else f"load_work({position(steps[0][0].between_passes(along))})"

    for along, value in emit_pass(code, steps, load, position):
        work = position(steps[-1][0].between_passes(along))
        code.lines.append(f"store({position(along)}, {value});" if is_last else f"store_work({work}, {value});")
    return _prologue(axis, steps, invocations) + "".join(f"    {line}\n" for line in code.lines) + "}\n"


def emit_pass(
    code: WgslEmitter, steps: PassSteps, load: Callable[[str], str], position: Callable[[str], str]
) -> list[tuple[str, str]]:
    """Emit a pass and return pairs of the position along the line and the name of the value to be stored there.

    load: the WGSL that loads the value at a position along the line. position: the same position, as the hook `middle`
    takes it. The WGSL variables `item`, the number of the DFT in its line, and `offset`, of its first value in its
    block, have to be in scope.
    """
    shape, direction = steps[0]
    ends = shape.point_positions(), shape.frequency_positions()
    values = [code.let(load(along)) for along in ends[direction == "inverse"]]
    for number, (shape, direction) in enumerate(steps):
        if number:
            values = _between(code, steps, values, position)
        code.lines.append(f"// {direction} transform of {shape.radix} values")
        values = _emit_step(code, shape, direction, values)
    ends = shape.point_positions(), shape.frequency_positions()
    return list(zip(ends[direction == "forward"], values, strict=True))


def _between(code: WgslEmitter, steps: PassSteps, values: list[str], position: Callable[[str], str]) -> list[str]:
    """The values of the first step as the second takes them, after the hook `middle`."""
    (before, _), (after, direction) = steps
    kept = (before.points, before.frequencies)[direction == "inverse"]
    by_digit = dict(zip(kept, values, strict=True))
    wanted = (after.points, after.frequencies)[direction == "inverse"]
    along = (after.point_positions(), after.frequency_positions())[direction == "inverse"]
    pairs = [(by_digit[digit % before.radix], place) for digit, place in zip(wanted, along, strict=True)]
    return [code.let(f"middle({position(place)}, {value})") for value, place in pairs]


def pass_workgroups(steps: PassSteps, invocations: int, lines: int) -> int:
    """Number of workgroups, of so many invocations, for `lines` lines."""
    return ceil_div(steps[0][0].invocations_per_line * lines, invocations)


def _prologue(axis: Axis, steps: PassSteps, invocations: int) -> str:
    """The beginning of the shader up to the number of a DFT; neighbouring invocations are neighbours in x."""
    shape = steps[0][0]
    if axis == "x":
        split = (
            f"let item = flat % {shape.invocations_per_line}u;\n    let line = flat / {shape.invocations_per_line}u;"
        )
    else:
        split = "let item = flat / lines.count;\n    let line = flat % lines.count;"
    directions = " and ".join(direction for _, direction in steps)
    return f"""{COMMON_DECLARATIONS}
// {directions} pass along {axis}: {shape.length} points, blocks of {shape.block}, radix {shape.radix}
@compute @workgroup_size({invocations})
fn main(
    @builtin(workgroup_id) workgroup: vec3u,
    @builtin(num_workgroups) workgroups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {{
    let flat = (workgroup.y * workgroups.x + workgroup.x) * {invocations}u + local;
    if (flat >= {shape.invocations_per_line}u * lines.count) {{
        return;
    }}
    {split}
    let field = workgroup.z;
    let across = lines.first + line;
    let offset = item % {shape.stride}u;
"""


def _emit_step(code: WgslEmitter, shape: PassShape, direction: Direction, values: list[str]) -> list[str]:
    """Forward: DFT, then twiddle factors. Inverse: conjugate twiddle factors, then inverse DFT."""
    twiddles = [""] * shape.radix
    if shape.block != shape.radix:  # else offset is always 0
        code.lines.append(f"// twiddle factors: multiples of offset / {shape.block} turns")
        twiddles = code.twiddles("offset", shape.radix, shape.block)
    if direction == "inverse":
        values = code.times_twiddles(values, [twiddles[k] for k in shape.frequencies], conjugate=True)
        found = emit_dft(code, scattered(values, shape.frequencies, shape.radix), 1)
        return [found[k] for k in shape.points]
    found = emit_dft(code, scattered(values, shape.points, shape.radix), -1)
    return code.times_twiddles(
        [found[k] for k in shape.frequencies], [twiddles[k] for k in shape.frequencies], conjugate=False
    )


# --- small DFTs in registers ------------------------------------------------------------------------------------------

# The code is straight-line: each complex value is a `let` of type vec2f (real, imaginary). A length is factorised into
# 2, 3, 4 and 5, which have formulas of their own; the twiddle factors between them are constants, evaluated in float64.


Sign = Literal[-1, 1]
ZERO = "0"
"""The name of a value that is known to be 0: sums with it and products of it need no code."""
_EXACT = 1e-12


class WgslEmitter:
    """Collects WGSL statements in `lines` and generates names for the values that they define.

    is_rough: whether twiddle factors may lose a decimal digit, for fewer instructions.
    """

    def __init__(self, *, is_rough: bool = False) -> None:
        self.lines: list[str] = []
        self._is_rough = is_rough
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
        lose a decimal digit; where that may be, w alone is evaluated, and w², w⁴, … are squares. Equal arguments give
        the names of the first call.
        """
        if (index, count, period) in self._twiddle_names:
            return self._twiddle_names[index, count, period]
        powers = self._twiddle_names[index, count, period] = [""]
        for k in range(1, count):
            highest = 1 << (k.bit_length() - 1)
            if k == highest and self._is_rough and k > 1:
                powers.append(self.let(f"cmul({powers[k // 2]}, {powers[k // 2]})"))
            elif k == highest:
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
    """`count` names: each of `values` at its place, and ZERO elsewhere."""
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


# Factorises the length of an FFT into the radices of its passes, and gives the order of the resulting spectrum.
#
# An in-place forward pass of radix r over blocks of M points replaces each block by r sub-blocks of M/r points;
# sub-block k contains the frequencies f ≡ k (mod r). After passes of radices r₁, r₂, …, the position whose mixed-radix
# digits are d₁ d₂ d₃ … (most significant first) holds the frequency d₁ + r₁·(d₂ + r₂·(d₃ + …)): the order is
# digit-reversed.


MAX_RADIX = 32
MAX_LENGTH = 8192


@cache
def radices(n: int, last_multiple_of: int = 1, largest: int = MAX_RADIX) -> tuple[int, ...]:
    """The radices of the passes over n points, largest first: the smallest number of factors, then the smallest sum.

    last_multiple_of: a divisor, up to `largest`, of n; the last radix is a multiple of it. largest: up to 32.

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
        for factors in _factorisations(n, largest)
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
