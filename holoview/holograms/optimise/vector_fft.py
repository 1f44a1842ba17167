"""FFTs of many lines at a time on the processor, compiled by numba: each line in a lane of the processor's vectors.

A library's FFT along columns has to collect every column first, which takes as long as the transform. Here `LANES`
lines are transformed side by side, one in each lane of a vector: neighbouring columns are read and written as rows lie
in memory, and products with a transfer function or intensities are formed of the same vectors before they are stored.

A block of lines is an array (position, part, lane), flat; the parts are real and imaginary.

    X_k = Σ_n x_n·exp(2πi·k·n/P)          (not normalised; a forward transform has X_−k in place of X_k)

`fft` factors P into radices and transforms by decimation in frequency with constant geometry (Pease, J. ACM 15, 252
(1968)): every stage reads positions p + j·P/r and writes r·p + j. Results lie in the order of reversed digits, which
`FftTables.order` lists; readers pick them by index.

numba knows no vectors. `_Vector` adds them, with loads, stores, sums and products as instructions of LLVM, which
chooses registers for the processor that it compiles for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import extending
from numpy.typing import NDArray

from holoview.util.packages import REORDERED, compiled

types: Any = numba.core.types
intrinsic: Any = extending.intrinsic
"""numba's decorator, untyped, of a function whose LLVM instructions are written by `generate`."""

LANES = 16
"""Lines that are transformed side by side: 64 bytes of float32, a cache line and the widest register."""
BLOCK = 2 * LANES
"""Numbers of a position of a block."""

_RADICES = (4, 2, 3, 5)


# --- vectors ---------------------------------------------------------------------------------------------------------


class _Vector(types.Type):
    """The numbers of all lanes."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Vector{LANES}({dtype})")


@extending.register_model(_Vector)
class _VectorModel(extending.models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        number = ir.FloatType() if kind.dtype == types.float32 else ir.DoubleType()
        super().__init__(manager, kind, ir.VectorType(number, LANES))


def _binary(instruction: str) -> Any:
    @intrinsic
    def operation(context: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, instruction)(*arguments, flags=REORDERED)

        return a(a, b), generate

    return operation


add, subtract, multiply = _binary("fadd"), _binary("fsub"), _binary("fmul")


def _indices(numbers: Any) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), list(numbers))


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any, width: int) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    vector = ir.VectorType(context.get_value_type(signature.args[0].dtype), width)
    return builder.bitcast(builder.gep(array.data, [arguments[1]]), vector.as_pointer())


def _loaded(builder: Any, pointer: Any) -> Any:
    value = builder.load(pointer)
    value.align = 4
    return value


def _store(context: Any, builder: Any, value: Any, pointer: Any) -> Any:
    builder.store(value, pointer).align = 4
    return context.get_dummy_value()


@intrinsic
def splat(context: Any, number: Any) -> Any:
    """The vector of equal numbers."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        nothing = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
        one = builder.insert_element(nothing, arguments[0], ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(one, nothing, _indices([0] * LANES))

    return _Vector(number)(number), generate


@intrinsic
def clipped(context: Any, vector: Any) -> Any:
    """The numbers, at least 0 and at most 1."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = arguments[0]
        low, high = (ir.Constant(value.type, [bound] * LANES) for bound in (0.0, 1.0))
        value = builder.select(builder.fcmp_ordered("<", value, low), low, value)
        return builder.select(builder.fcmp_ordered(">", value, high), high, value)

    return vector(vector), generate


@intrinsic
def load(context: Any, array: Any, index: Any) -> Any:
    """The numbers of a flat array from an index on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _loaded(builder, _pointer(context, builder, signature, arguments, LANES))

    return _Vector(array.dtype)(array, types.intp), generate


@intrinsic
def store(context: Any, array: Any, index: Any, vector: Any) -> Any:
    """Writes a vector to a flat array from an index on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _store(context, builder, arguments[2], _pointer(context, builder, signature, arguments, LANES))

    return types.void(array, types.intp, vector), generate


@intrinsic
def load_complex(context: Any, array: Any, index: Any) -> Any:
    """Real and imaginary parts of complex numbers, whose parts alternate from an index of a flat array on."""
    vector = _Vector(array.dtype)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pairs = _loaded(builder, _pointer(context, builder, signature, arguments, BLOCK))
        nothing = ir.Constant(pairs.type, ir.Undefined)
        parts = [builder.shuffle_vector(pairs, nothing, _indices(range(part, BLOCK, 2))) for part in (0, 1)]
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(vector, 2)(array, types.intp), generate


@intrinsic
def store_complex(context: Any, array: Any, index: Any, real: Any, imaginary: Any) -> Any:
    """Writes complex numbers, whose parts alternate, to a flat array from an index on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        alternating = [lane + part * LANES for lane in range(LANES) for part in (0, 1)]
        pairs = builder.shuffle_vector(arguments[2], arguments[3], _indices(alternating))
        return _store(context, builder, pairs, _pointer(context, builder, signature, arguments, BLOCK))

    return types.void(array, types.intp, real, imaginary), generate


@intrinsic
def turn(context: Any, source: Any, at: Any, stride: Any, target: Any, to: Any, target_stride: Any) -> Any:
    """Writes the columns of a square of numbers as rows. Row i begins at `at` + i·stride and at `to` + i·target_stride.

    Of rows of complex numbers, whose parts alternate, the columns are real and imaginary parts in turn.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = [_row(context, builder, signature, arguments, 0, row) for row in range(LANES)]
        _store_turned(context, builder, signature, arguments, 3, places)
        return context.get_dummy_value()

    return types.void(source, types.intp, types.intp, target, types.intp, types.intp), generate


@intrinsic
def turn_picked(context: Any, block: Any, picked: Any, first: Any, target: Any, to: Any, target_stride: Any) -> Any:
    """The same of `LANES`/2 complex numbers of a block, at the positions picked[first], picked[first + 1], …"""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        indices = context.make_array(signature.args[1])(context, builder, arguments[1])
        places, size = [], arguments[2].type
        for number in range(LANES // 2):
            at = builder.add(arguments[2], ir.Constant(size, number))
            position = builder.mul(builder.load(builder.gep(indices.data, [at])), ir.Constant(size, BLOCK))
            parts = [builder.add(position, ir.Constant(size, part * LANES)) for part in (0, 1)]
            places += [builder.gep(array.data, [part]) for part in parts]
        vector = ir.VectorType(context.get_value_type(signature.args[0].dtype), LANES)
        pointers = [builder.bitcast(place, vector.as_pointer()) for place in places]
        _store_turned(context, builder, signature, arguments, 3, pointers)
        return context.get_dummy_value()

    return types.void(block, picked, types.intp, target, types.intp, types.intp), generate


def _row(context: Any, builder: Any, signature: Any, arguments: Any, first: int, row: int) -> Any:
    """The pointer to a row of an array, whose first index and whose stride are the next arguments."""
    array = context.make_array(signature.args[first])(context, builder, arguments[first])
    offset = builder.mul(arguments[first + 2], ir.Constant(arguments[first + 2].type, row))
    vector = ir.VectorType(context.get_value_type(signature.args[first].dtype), LANES)
    return builder.bitcast(builder.gep(array.data, [builder.add(arguments[first + 1], offset)]), vector.as_pointer())


def _store_turned(context: Any, builder: Any, signature: Any, arguments: Any, first: int, places: list[Any]) -> None:
    columns = _exchanged(builder, [_loaded(builder, place) for place in places])
    for row, column in enumerate(columns):
        _store(context, builder, column, _row(context, builder, signature, arguments, first, row))


def _exchanged(builder: Any, vectors: list[Any]) -> list[Any]:
    """The transpose of a square: squares of half the side, a quarter, … beside its diagonal are exchanged."""
    vectors, half = list(vectors), LANES // 2
    while half:
        first = [lane if not lane & half else lane - half + LANES for lane in range(LANES)]
        second = [lane + half if not lane & half else lane + LANES for lane in range(LANES)]
        for i in (i for i in range(LANES) if not i & half):
            low, high = vectors[i], vectors[i + half]
            vectors[i] = builder.shuffle_vector(low, high, _indices(first))
            vectors[i + half] = builder.shuffle_vector(low, high, _indices(second))
        half //= 2
    return vectors


# --- the transform ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FftTables:
    """The tables that `fft` needs for a length P.

    radices: factors of P. roots: the factors between the stages, (number, real and imaginary part), flat. starts: index
    of each stage's first root. order: the index of each position of the result. places: the position of each index.
    """

    radices: NDArray[np.int64]
    roots: NDArray[np.floating]
    starts: NDArray[np.int64]
    order: NDArray[np.int64]
    places: NDArray[np.int64]

    @property
    def arguments(self) -> tuple[NDArray[Any], ...]:
        """The arguments of `fft` that follow from the plan."""
        return self.radices, self.roots, self.starts


def has_fft(length: int) -> bool:
    """Whether `fft` transforms lines of a length: its only factors are 2, 3 and 5."""
    return length > 1 and int(np.prod(_factors(length))) == length


def _factors(length: int) -> list[int]:
    factors = []
    for radix in _RADICES:
        while length % radix == 0:
            factors.append(radix)
            length //= radix
    return factors


@cache
def fft_plan(length: int, double: bool) -> FftTables:
    """The plan for a length for which `has_fft` is true, in double or in single precision."""
    radices, rest, weight = _factors(length), length, 1
    roots, order = [], np.zeros(radices, dtype=np.int64)
    for i, radix in enumerate(radices):
        turns = np.arange(rest // radix)[:, None] * np.arange(1, radix) / rest
        roots.append(np.exp(2j * np.pi * turns).view(np.float64).ravel())
        digit = np.arange(radix).reshape([-1 if j == i else 1 for j in range(len(radices))])
        order, weight, rest = order + weight * digit, weight * radix, rest // radix
    starts = np.cumsum([0, *(len(part) for part in roots)])
    places = np.argsort(order.ravel())
    numbers: NDArray[np.floating] = np.concatenate(roots).astype(np.float64 if double else np.float32)
    return FftTables(np.array(radices), numbers, starts, order.ravel(), places)


@compiled
def product(real: Any, imaginary: Any, u: Any, v: Any) -> Any:
    """Real and imaginary part of (real + i·imaginary)·(u + i·v)."""
    return subtract(multiply(real, u), multiply(imaginary, v)), add(multiply(real, v), multiply(imaginary, u))


@compiled
def store_product(block: Any, at: Any, real: Any, imaginary: Any, u: Any, v: Any) -> None:
    """Writes (real + i·imaginary)·(u + i·v) to a block."""
    real, imaginary = product(real, imaginary, u, v)
    store(block, at, real)
    store(block, at + LANES, imaginary)


@compiled
def _stage_2(source: Any, target: Any, stride: Any, roots: Any, group: Any) -> None:
    for root in range(stride // group):
        r, i = splat(roots[2 * root]), splat(roots[2 * root + 1])
        for p in range(root * group, (root + 1) * group):
            a, b, to = p * BLOCK, (p + stride) * BLOCK, 2 * p * BLOCK
            x0, y0, x1, y1 = load(source, a), load(source, a + LANES), load(source, b), load(source, b + LANES)
            store(target, to, add(x0, x1))
            store(target, to + LANES, add(y0, y1))
            store_product(target, to + BLOCK, subtract(x0, x1), subtract(y0, y1), r, i)


@compiled
def _stage_3(source: Any, target: Any, stride: Any, roots: Any, group: Any) -> None:
    half, sine = splat(roots.dtype.type(0.5)), splat(roots.dtype.type(0.75**0.5))
    for root in range(stride // group):
        w = roots[4 * root : 4 * root + 4]
        r1, i1, r2, i2 = splat(w[0]), splat(w[1]), splat(w[2]), splat(w[3])
        for p in range(root * group, (root + 1) * group):
            a, b, c, to = p * BLOCK, (p + stride) * BLOCK, (p + 2 * stride) * BLOCK, 3 * p * BLOCK
            x0, x1, x2 = load(source, a), load(source, b), load(source, c)
            y0, y1, y2 = load(source, a + LANES), load(source, b + LANES), load(source, c + LANES)
            x, y = add(x1, x2), add(y1, y2)
            u, v = subtract(x0, multiply(half, x)), subtract(y0, multiply(half, y))
            s, t = multiply(sine, subtract(x1, x2)), multiply(sine, subtract(y1, y2))
            store(target, to, add(x0, x))
            store(target, to + LANES, add(y0, y))
            store_product(target, to + BLOCK, subtract(u, t), add(v, s), r1, i1)
            store_product(target, to + 2 * BLOCK, add(u, t), subtract(v, s), r2, i2)


@compiled
def _stage_4(source: Any, target: Any, stride: Any, roots: Any, group: Any) -> None:
    for root in range(stride // group):
        w = roots[6 * root : 6 * root + 6]
        r1, i1, r2, i2, r3, i3 = splat(w[0]), splat(w[1]), splat(w[2]), splat(w[3]), splat(w[4]), splat(w[5])
        for p in range(root * group, (root + 1) * group):
            a, b, to = p * BLOCK, (p + stride) * BLOCK, 4 * p * BLOCK
            c, d = b + stride * BLOCK, b + 2 * stride * BLOCK
            x0, x1, x2, x3 = load(source, a), load(source, b), load(source, c), load(source, d)
            y0, y1 = load(source, a + LANES), load(source, b + LANES)
            y2, y3 = load(source, c + LANES), load(source, d + LANES)
            s, t, u, v = add(x0, x2), add(y0, y2), subtract(x0, x2), subtract(y0, y2)
            e, f, g, h = add(x1, x3), add(y1, y3), subtract(x1, x3), subtract(y1, y3)
            store(target, to, add(s, e))
            store(target, to + LANES, add(t, f))
            store_product(target, to + BLOCK, subtract(u, h), add(v, g), r1, i1)
            store_product(target, to + 2 * BLOCK, subtract(s, e), subtract(t, f), r2, i2)
            store_product(target, to + 3 * BLOCK, add(u, h), subtract(v, g), r3, i3)


@compiled
def _stage_5(source: Any, target: Any, stride: Any, roots: Any, group: Any) -> None:
    number = roots.dtype.type
    c1, s1 = splat(number(0.30901699437494742)), splat(number(0.95105651629515357))
    c2, s2 = splat(number(-0.80901699437494742)), splat(number(0.58778525229247313))
    for root in range(stride // group):
        w = roots[8 * root : 8 * root + 8]
        for p in range(root * group, (root + 1) * group):
            a, step, to = p * BLOCK, stride * BLOCK, 5 * p * BLOCK
            x0, y0 = load(source, a), load(source, a + LANES)
            x1, y1, x4, y4 = (
                load(source, a + step),
                load(source, a + step + LANES),
                load(source, a + 4 * step),
                load(source, a + 4 * step + LANES),
            )
            x2, y2, x3, y3 = (
                load(source, a + 2 * step),
                load(source, a + 2 * step + LANES),
                load(source, a + 3 * step),
                load(source, a + 3 * step + LANES),
            )
            p1, q1, m1, n1 = add(x1, x4), add(y1, y4), subtract(x1, x4), subtract(y1, y4)
            p2, q2, m2, n2 = add(x2, x3), add(y2, y3), subtract(x2, x3), subtract(y2, y3)
            store(target, to, add(x0, add(p1, p2)))
            store(target, to + LANES, add(y0, add(q1, q2)))
            u1, v1 = add(x0, add(multiply(c1, p1), multiply(c2, p2))), add(y0, add(multiply(c1, q1), multiply(c2, q2)))
            u2, v2 = add(x0, add(multiply(c2, p1), multiply(c1, p2))), add(y0, add(multiply(c2, q1), multiply(c1, q2)))
            g1, h1 = add(multiply(s1, m1), multiply(s2, m2)), add(multiply(s1, n1), multiply(s2, n2))
            g2, h2 = subtract(multiply(s2, m1), multiply(s1, m2)), subtract(multiply(s2, n1), multiply(s1, n2))
            store_product(target, to + BLOCK, subtract(u1, h1), add(v1, g1), splat(w[0]), splat(w[1]))
            store_product(target, to + 2 * BLOCK, subtract(u2, h2), add(v2, g2), splat(w[2]), splat(w[3]))
            store_product(target, to + 3 * BLOCK, add(u2, h2), subtract(v2, g2), splat(w[4]), splat(w[5]))
            store_product(target, to + 4 * BLOCK, add(u1, h1), subtract(v1, g1), splat(w[6]), splat(w[7]))


@compiled
def fft(block: Any, other: Any, radices: Any, roots: Any, starts: Any) -> Any:
    """The transform of a block; returns whichever of the two buffers holds it. Both are overwritten."""
    length, group = block.size // BLOCK, np.int64(1)  # the literal 1 would be a type of its own, compiled as well
    for stage in range(radices.size):
        radix = radices[stage]
        stride, factors = length // radix, roots[starts[stage] :]
        if radix == 4:
            _stage_4(block, other, stride, factors, group)
        elif radix == 2:
            _stage_2(block, other, stride, factors, group)
        elif radix == 3:
            _stage_3(block, other, stride, factors, group)
        else:
            _stage_5(block, other, stride, factors, group)
        block, other = other, block
        group *= radix
    return block
