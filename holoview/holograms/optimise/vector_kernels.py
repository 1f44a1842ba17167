"""The passes of an iteration over fields, compiled by numba around `vector_fft`: each reads and writes memory once.

Columns pass through a transform along y, with the operations before and after it, `LANES` neighbouring columns at a
time; rows through transforms along x, `LANES` rows at a time, which are transposed on the way. A block of lines stays
in the core's cache from its first operation to its last.

Arrays are flat, with the strides of their axes counted in real numbers. Rows end early enough that a vector that
begins before their end belongs to no other row (`optimise.beams.row_pitch`).

A transform is given as `Line.arguments`: the plan of the FFT, where the numbers of a line stand before it, and where
its results are found.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.optimise.vector_fft import (
    BLOCK,
    LANES,
    add,
    clipped,
    fft,
    fft_plan,
    load,
    load_complex,
    multiply,
    product,
    splat,
    store,
    store_complex,
    store_product,
    subtract,
    turn,
    turn_picked,
)
from holoview.light.numerics.fourier import PrunedAxis
from holoview.util.packages import compiled

_PARTS = LANES * LANES  # numbers of a square
_HALF = LANES // 2  # complex numbers of a row of a square
_SINE = tuple((-1) ** n / math.factorial(2 * n + 1) for n in range(11))  # Taylor series of sin(x)/x and cos(x) in x²
_COSINE = tuple((-1) ** n / math.factorial(2 * n) for n in range(12))


Line = tuple[Any, ...]
"""A transform along one axis as kernels take it: radices, roots and starts of the FFT's plan, the places of a line's
numbers in the block before it, and the places of the results behind it."""


def line_to_band(axis: PrunedAxis, *, forward: bool, double: bool) -> Line:
    """From the window to the band."""
    return _line(axis.padded, _window(axis), _band(axis), forward, double)


def line_to_window(axis: PrunedAxis, *, forward: bool, double: bool) -> Line:
    """From the band to the window."""
    return _line(axis.padded, _band(axis), _window(axis), forward, double)


def _line(length: int, places: NDArray[np.int64], results: NDArray[np.int64], forward: bool, double: bool) -> Line:
    plan = fft_plan(length, double)
    found = plan.places[(-results if forward else results) % length]
    return plan.radices, plan.roots, plan.starts, places, found


def plane_line(axis: PrunedAxis, *, double: bool) -> Line:
    """The transform of `move_columns` and `evaluate_rows`, both ways; the band begins at frequency 0.

    Radices, roots, starts; the window's places before a transform; the band's and the window's places after it.
    """
    assert axis.offset == axis.lowest == 0
    plan = fft_plan(axis.padded, double)
    samples = np.arange(axis.count)
    return plan.radices, plan.roots, plan.starts, samples, plan.places[: axis.frequencies], plan.places[: axis.count]


def _window(axis: PrunedAxis) -> NDArray[np.int64]:
    return axis.offset + np.arange(axis.count)


def _band(axis: PrunedAxis) -> NDArray[np.int64]:
    return (axis.lowest + np.arange(axis.frequencies)) % axis.padded


# --- between arrays and blocks ---------------------------------------------------------------------------------------


@compiled
def load_columns(block: Any, flat: Any, at: Any, stride: Any, places: Any) -> None:
    """`LANES` columns from index `at` on: row i to places[i], zero elsewhere."""
    if places.size * BLOCK < block.size:
        block[:] = 0
    for row in range(places.size):
        real, imaginary = load_complex(flat, at + row * stride)
        store(block, places[row] * BLOCK, real)
        store(block, places[row] * BLOCK + LANES, imaginary)


@compiled
def store_columns(block: Any, flat: Any, at: Any, stride: Any, results: Any, scale: Any, columns: Any) -> None:
    """The opposite, times a factor, of the first `columns` of them."""
    factor, line = splat(scale), np.empty(BLOCK, block.dtype)
    for row in range(results.size):
        real = multiply(load(block, results[row] * BLOCK), factor)
        imaginary = multiply(load(block, results[row] * BLOCK + LANES), factor)
        if columns >= LANES:
            store_complex(flat, at + row * stride, real, imaginary)
        else:
            store_complex(line, 0, real, imaginary)
            for i in range(2 * columns):
                flat[at + row * stride + i] = line[i]


@compiled
def load_rows(block: Any, flat: Any, at: Any, stride: Any, count: Any, places: Any, squares: Any) -> None:
    """`LANES` rows from index `at` on: number i of a row to places[i], zero elsewhere. Only `count` rows exist."""
    if places.size * BLOCK < block.size:
        block[:] = 0
    for start in range(0, places.size, _HALF):
        is_whole = count == LANES and start + _HALF <= places.size
        if is_whole and places[start + _HALF - 1] - places[start] == _HALF - 1:
            turn(flat, at + 2 * start, stride, block, places[start] * BLOCK, LANES)
            continue
        for lane in range(count):
            store(squares, lane * LANES, load(flat, at + lane * stride + 2 * start))
        turn(squares, 0, LANES, squares, _PARTS, LANES)
        for i in range(min(_HALF, places.size - start)):
            store(block, places[start + i] * BLOCK, load(squares, _PARTS + 2 * i * LANES))
            store(block, places[start + i] * BLOCK + LANES, load(squares, _PARTS + (2 * i + 1) * LANES))


@compiled
def store_rows(block: Any, flat: Any, at: Any, stride: Any, count: Any, results: Any, squares: Any) -> None:
    """The opposite, of the first `count` rows."""
    for first in range(0, results.size, _HALF):
        start = min(first, results.size - _HALF)  # the last numbers of a row are written twice
        if count == LANES:
            turn_picked(block, results, start, flat, at + 2 * start, stride)
            continue
        turn_picked(block, results, start, squares, 0, LANES)
        for lane in range(count):
            store(flat, at + lane * stride + 2 * start, load(squares, lane * LANES))


# --- columns ---------------------------------------------------------------------------------------------------------


@compiled
def transform_columns(
    source: Any, source_strides: Any, target: Any, target_strides: Any, beams: Any, columns: Any, line: Any, scale: Any
) -> None:
    """Transforms columns of fields (laser, source, row, column). beams: numbers of lasers and sources."""
    radices, roots, starts, places, results = line
    length = fft_length(radices)
    a, b = np.empty(length * BLOCK, source.dtype), np.empty(length * BLOCK, source.dtype)
    for laser in range(beams[0]):
        for beam in range(beams[1]):
            at = laser * source_strides[0] + beam * source_strides[1]
            to = laser * target_strides[0] + beam * target_strides[1]
            for column in range(0, columns, LANES):
                load_columns(a, source, at + 2 * column, source_strides[2], places)
                done = fft(a, b, radices, roots, starts)
                store_columns(done, target, to + 2 * column, target_strides[2], results, scale, columns - column)


@compiled
def fft_length(radices: Any) -> Any:
    """The length of the transform."""
    length = 1
    for radix in radices:
        length *= radix
    return length


@compiled
def move_columns(
    lines: Any,
    line_strides: Any,
    spectra: Any,
    adjoints: Any,
    strides: Any,
    before: Any,
    before_strides: Any,
    after: Any,
    after_strides: Any,
    rows: Any,
    does: Any,
    beams: Any,
    columns: Any,
    line: Any,
) -> None:
    """c_W += H_before·F⁻¹c, and then lines of F⁻¹(H_after·W): from a plane back, and on to the next plane.

    spectra, adjoints: W and c_W (laser, source, k, column), of equal strides. before, after: H (laser, row, column).
    rows (k,): those of H. does: whether to do the first part and the second. line: of `plane_line`.
    """
    radices, roots, starts, window, band, shown = line
    length = fft_length(radices)
    a, b = np.empty(length * BLOCK, lines.dtype), np.empty(length * BLOCK, lines.dtype)
    one = lines.dtype.type(1)
    for laser in range(beams[0]):
        for beam in range(beams[1]):
            at, to = laser * line_strides[0] + beam * line_strides[1], laser * strides[0] + beam * strides[1]
            for column in range(0, columns, LANES):
                if does[0]:
                    load_columns(a, lines, at + 2 * column, line_strides[2], window)
                    done = fft(a, b, radices, roots, starts)
                    h = laser * before_strides[0] + 2 * column
                    _add_products(done, band, before, h, before_strides[1], rows, adjoints, to + 2 * column, strides[2])
                if does[1]:
                    h = laser * after_strides[0] + 2 * column
                    _load_products(a, rows, spectra, to + 2 * column, strides[2], after, h, after_strides[1])
                    done = fft(a, b, radices, roots, starts)
                    store_columns(done, lines, at + 2 * column, line_strides[2], shown, one, LANES)


@compiled
def _add_products(
    block: Any, results: Any, factors: Any, h: Any, factor_stride: Any, rows: Any, sums: Any, at: Any, stride: Any
) -> None:
    for k in range(results.size):
        real, imaginary = load(block, results[k] * BLOCK), load(block, results[k] * BLOCK + LANES)
        u, v = load_complex(factors, h + rows[k] * factor_stride)
        x, y = load_complex(sums, at + k * stride)
        p, q = product(real, imaginary, u, v)
        store_complex(sums, at + k * stride, add(x, p), add(y, q))


@compiled
def _load_products(
    block: Any, rows: Any, values: Any, at: Any, stride: Any, factors: Any, h: Any, factor_stride: Any
) -> None:
    if rows.size * BLOCK < block.size:
        block[rows.size * BLOCK :] = 0
    for k in range(rows.size):
        real, imaginary = load_complex(values, at + k * stride)
        u, v = load_complex(factors, h + rows[k] * factor_stride)
        store_product(block, k * BLOCK, real, imaginary, u, v)


# --- rows of a plane -------------------------------------------------------------------------------------------------


@compiled
def _load_targets(target: Any, strides: Any, channels: Any, row: Any, count: Any, x: Any, squares: Any) -> None:
    """A square of each channel, whose lanes are rows, of which `count` exist."""
    for channel in range(channels):
        at = channel * strides[0] + row * strides[1] + x
        if count == LANES:
            turn(target, at, strides[1], squares, channel * _PARTS, LANES)
            continue
        for lane in range(count):
            store(squares, 3 * _PARTS + lane * LANES, load(target, at + lane * strides[1]))
        turn(squares, 3 * _PARTS, LANES, squares, channel * _PARTS, LANES)


@compiled
def _add_squares(sums: Any, at: Any, residuals: Any, line: Any, count: Any) -> None:
    """Adds the numbers of the first `count` lanes in double precision."""
    store(line, 0, residuals)
    for lane in range(count):
        sums[at + lane] += line[lane]


@compiled
def _compare_3(
    fields: Any, places: Any, weights: Any, squares: Any, slopes: Any, x: Any, count: Any, line: Any, sums: Any
) -> None:
    """Image, residuals and their norms in a square of samples of three channels from column x on.

    squares: targets, replaced by the image. slopes (x, channel, lane): where to write the residuals.
    """
    zero = splat(weights.dtype.type(0))
    residuals, errors = zero, zero
    for i in range(places.size):
        at, to, out = places[i] * BLOCK, i * LANES, 3 * (x + i) * LANES
        red, green, blue = zero, zero, zero
        for beam in range(fields.shape[0]):
            real, imaginary = load(fields[beam], at), load(fields[beam], at + LANES)
            power = add(multiply(real, real), multiply(imaginary, imaginary))
            red = add(red, multiply(splat(weights[beam, 0]), power))
            green = add(green, multiply(splat(weights[beam, 1]), power))
            blue = add(blue, multiply(splat(weights[beam, 2]), power))
        t0, t1, t2 = load(squares, to), load(squares, _PARTS + to), load(squares, 2 * _PARTS + to)
        r0, r1, r2 = subtract(red, t0), subtract(green, t1), subtract(blue, t2)
        residuals = add(residuals, add(multiply(r0, r0), add(multiply(r1, r1), multiply(r2, r2))))
        e0, e1 = subtract(clipped(red), clipped(t0)), subtract(clipped(green), clipped(t1))
        e2 = subtract(clipped(blue), clipped(t2))
        errors = add(errors, add(multiply(e0, e0), add(multiply(e1, e1), multiply(e2, e2))))
        store(squares, to, red)
        store(squares, _PARTS + to, green)
        store(squares, 2 * _PARTS + to, blue)
        store(slopes, out, r0)
        store(slopes, out + LANES, r1)
        store(slopes, out + 2 * LANES, r2)
    _add_squares(sums, 0, residuals, line, count)
    _add_squares(sums, LANES, errors, line, count)


@compiled
def _compare_1(
    fields: Any, places: Any, weights: Any, squares: Any, slopes: Any, x: Any, count: Any, line: Any, sums: Any
) -> None:
    """`_compare_3` for one channel."""
    zero = splat(weights.dtype.type(0))
    residuals, errors = zero, zero
    for i in range(places.size):
        at, to, image = places[i] * BLOCK, i * LANES, zero
        for beam in range(fields.shape[0]):
            real, imaginary = load(fields[beam], at), load(fields[beam], at + LANES)
            power = add(multiply(real, real), multiply(imaginary, imaginary))
            image = add(image, multiply(splat(weights[beam, 0]), power))
        t = load(squares, to)
        residual, error = subtract(image, t), subtract(clipped(image), clipped(t))
        residuals, errors = add(residuals, multiply(residual, residual)), add(errors, multiply(error, error))
        store(squares, to, image)
        store(slopes, (x + i) * LANES, residual)
    _add_squares(sums, 0, residuals, line, count)
    _add_squares(sums, LANES, errors, line, count)


@compiled
def _add_correlations(
    fields: Any, places: Any, squares: Any, count: Any, powers: Any, line: Any, products: Any
) -> None:
    """Adds Σ I_i·I_j, for j ≥ i, and Σ I_i·target_c in a square of samples to products (beam, beam and channel).

    powers: room for a square of each beam.
    """
    beams, zero = fields.shape[0], splat(powers.dtype.type(0))
    for beam in range(beams):
        for i in range(places.size):
            real, imaginary = load(fields[beam], places[i] * BLOCK), load(fields[beam], places[i] * BLOCK + LANES)
            power = add(multiply(real, real), multiply(imaginary, imaginary))
            store(powers, beam * _PARTS + i * LANES, power)
    for beam in range(beams):
        for other in range(beam, products.shape[1]):
            total = zero
            for i in range(places.size):
                power = load(powers, beam * _PARTS + i * LANES)
                if other < beams:
                    total = add(total, multiply(power, load(powers, other * _PARTS + i * LANES)))
                else:
                    total = add(total, multiply(power, load(squares, (other - beams) * _PARTS + i * LANES)))
            store(line, 0, total)
            for lane in range(count):
                products[beam, other] += line[lane]


@compiled
def _load_adjoint(block: Any, field: Any, places: Any, weights: Any, factor: Any, slopes: Any) -> None:
    """c_E = 2·g·conj(E) of a beam, g being its weights times the slopes of the channels."""
    if places.size * BLOCK < block.size:
        block[:] = 0
    factor = factor + factor
    first = splat(factor * weights[0])
    second, third = first, first
    if weights.size == 3:
        second, third = splat(factor * weights[1]), splat(factor * weights[2])
    zero = splat(weights.dtype.type(0))
    for x in range(places.size):
        at, to = places[x] * BLOCK, x * weights.size * LANES
        slope = multiply(first, load(slopes, to))
        if weights.size == 3:
            slope = add(slope, multiply(second, load(slopes, to + LANES)))
            slope = add(slope, multiply(third, load(slopes, to + 2 * LANES)))
        store(block, x * BLOCK, multiply(slope, load(field, at)))
        store(block, x * BLOCK + LANES, multiply(subtract(zero, slope), load(field, at + LANES)))


@compiled
def _store_picture(
    squares: Any, done: Any, picture: Any, strides: Any, channels: Any, row: Any, count: Any, x: Any
) -> None:
    """Writes the first `done` columns of squares of an image, whose lanes are rows."""
    for channel in range(channels):
        for lane in range(count):
            at = channel * strides[0] + (row + lane) * strides[1] + x
            for i in range(done):
                picture[at + i] = squares[channel * _PARTS + i * LANES + lane]


@compiled
def _drop_first(squares: Any, channels: Any, known: Any) -> None:
    """Moves the numbers of each channel to its front, over the first `known` of them."""
    for channel in range(channels):
        for i in range(channel * _PARTS, (channel + 1) * _PARTS - known):
            squares[i] = squares[i + known]


@compiled
def _root_of_sum(values: Any) -> Any:
    total = values[0]
    for value in values[1:]:
        total += value
    return math.sqrt(total)


@compiled
def evaluate_rows(
    lines: Any,
    strides: Any,
    rows: Any,
    beams: Any,
    line: Any,
    weights: Any,
    target: Any,
    target_strides: Any,
    factor: Any,
    picture: Any,
    picture_strides: Any,
    does: Any,
    norms: Any,
    products: Any,
) -> None:
    """From rows of lines to the image, to the norms of its residuals, and back to lines of c_E.

    lines (laser, source, row, k_x): replaced if does[0], the gradient, is wanted. rows: the first, and the one behind
    the last. weights (beam, channel), of 1 or 3 channels. target (channel, row, x). factor: of the residuals, for the
    gradient. picture (channel, row, x): where to write the image if does[1]. norms: of image − target, and of the same
    clipped to 0…1. products: where `_add_correlations` adds if does[2]. line: of `plane_line`.
    """
    radices, roots, starts, _, band, shown = line
    length, channels = fft_length(radices), weights.shape[1]
    fields = np.empty((beams[0] * beams[1], length * BLOCK), lines.dtype)
    a, b = np.empty(length * BLOCK, lines.dtype), np.empty(length * BLOCK, lines.dtype)
    slopes = np.empty(shown.size * channels * LANES, lines.dtype)
    squares, lane_values = np.zeros(4 * _PARTS, lines.dtype), np.empty(LANES, lines.dtype)
    powers = np.empty(len(fields) * _PARTS if does[2] else 0, lines.dtype)
    frequencies, sums = np.arange(band.size), np.zeros(2 * LANES, np.float64)
    for row in range(rows[0], rows[1], LANES):
        count = min(LANES, rows[1] - row)
        for beam in range(beams[0] * beams[1]):
            at = beam // beams[1] * strides[0] + beam % beams[1] * strides[1] + row * strides[2]
            first, second = (fields[beam], b) if radices.size % 2 == 0 else (b, fields[beam])
            load_rows(first, lines, at, strides[2], count, frequencies, squares)
            fft(first, second, radices, roots, starts)  # ends in `fields`
        for x in range(0, shown.size, LANES):
            start = min(x, shown.size - LANES)
            _load_targets(target, target_strides, channels, row, count, start, squares)
            if x > start:  # a square ends with the row: its last columns are new
                _drop_first(squares, channels, (x - start) * LANES)
            places = shown[x : x + LANES]
            if does[2]:
                _add_correlations(fields, places, squares, count, powers, lane_values, products)
            if channels == 3:
                _compare_3(fields, places, weights, squares, slopes, x, count, lane_values, sums)
            else:
                _compare_1(fields, places, weights, squares, slopes, x, count, lane_values, sums)
            if does[1]:
                _store_picture(squares, places.size, picture, picture_strides, channels, row, count, x)
        if not does[0]:
            continue
        for beam in range(beams[0] * beams[1]):
            _load_adjoint(a, fields[beam], shown, weights[beam], factor, slopes)
            at = beam // beams[1] * strides[0] + beam % beams[1] * strides[1] + row * strides[2]
            store_rows(fft(a, b, radices, roots, starts), lines, at, strides[2], count, band, squares)
    norms[0], norms[1] = _root_of_sum(sums[:LANES]), _root_of_sum(sums[LANES:])


# --- modulators ------------------------------------------------------------------------------------------------------


@compiled
def transform_rows(source: Any, source_strides: Any, target: Any, target_strides: Any, shape: Any, line: Any) -> None:
    """Transforms rows of fields (laser, source, row, x). shape: numbers of lasers, sources and rows."""
    radices, roots, starts, places, results = line
    length = fft_length(radices)
    a, b = np.empty(length * BLOCK, source.dtype), np.empty(length * BLOCK, source.dtype)
    squares = np.zeros(2 * _PARTS, source.dtype)
    for laser in range(shape[0]):
        for beam in range(shape[1]):
            for row in range(0, shape[2], LANES):
                count = min(LANES, shape[2] - row)
                at = laser * source_strides[0] + beam * source_strides[1] + row * source_strides[2]
                load_rows(a, source, at, source_strides[2], count, places, squares)
                done = fft(a, b, radices, roots, starts)
                at = laser * target_strides[0] + beam * target_strides[1] + row * target_strides[2]
                store_rows(done, target, at, target_strides[2], count, results, squares)


@compiled
def spread_columns(
    pixels: Any,
    pixel_strides: Any,
    factors: Any,
    factor_strides: Any,
    target: Any,
    target_strides: Any,
    does_transform: Any,
    beams: Any,
    widths: Any,
    pixel_line: Any,
    gap_line: Any,
    scale: Any,
) -> None:
    """V = B·H_gap·F[s·p₁] along y, and behind it lines of F⁻¹V if does_transform.

    pixels: lines (laser, source, y, k_x) of the first modulator's pixels. factors: B·H_gap (laser, k_y, tile, k_x).
    widths: numbers of columns of the pixels' spectrum and of V, which repeats it. target: V, or its lines.
    """
    radices, roots, starts, places, results = pixel_line
    gap_radices, gap_roots, gap_starts, gap_places, window = gap_line
    length, period = fft_length(gap_radices), fft_length(radices)
    a, b = np.empty(period * BLOCK, pixels.dtype), np.empty(period * BLOCK, pixels.dtype)
    c, d = np.empty(length * BLOCK, pixels.dtype), np.empty(length * BLOCK, pixels.dtype)
    natural, one = np.arange(gap_places.size), pixels.dtype.type(1)
    for laser in range(beams[0]):
        for beam in range(beams[1]):
            at = laser * pixel_strides[0] + beam * pixel_strides[1]
            for column in range(0, widths[0], LANES):
                load_columns(a, pixels, at + 2 * column, pixel_strides[2], places)
                spectrum = fft(a, b, radices, roots, starts)
                for tile in range(0, widths[1], widths[0]):
                    columns = min(widths[0], widths[1] - tile) - column
                    if columns <= 0:
                        continue
                    h = laser * factor_strides[0] + tile // widths[0] * factor_strides[2] + 2 * column
                    to = laser * target_strides[0] + beam * target_strides[1] + 2 * (tile + column)
                    spots = gap_places if does_transform else natural
                    _multiply_tile(spectrum, results, period, factors, h, factor_strides[1], c, spots)
                    if does_transform:
                        done = fft(c, d, gap_radices, gap_roots, gap_starts)
                        store_columns(done, target, to, target_strides[2], window, scale, columns)
                    else:
                        store_columns(c, target, to, target_strides[2], natural, one, columns)


@compiled
def _multiply_tile(
    spectrum: Any, results: Any, period: Any, factors: Any, h: Any, stride: Any, block: Any, places: Any
) -> None:
    """Factors times the spectrum of pixels, repeated after `period` entries, into a block that is zero elsewhere."""
    if places.size * BLOCK < block.size:
        block[:] = 0
    for k in range(places.size):
        at, to = results[k % period] * BLOCK, places[k] * BLOCK
        real, imaginary = load(spectrum, at), load(spectrum, at + LANES)
        u, v = load_complex(factors, h + k * stride)
        store_product(block, to, real, imaginary, u, v)


@compiled
def gather_columns(
    source: Any,
    source_strides: Any,
    does_transform: Any,
    factors: Any,
    factor_strides: Any,
    pixels: Any,
    pixel_strides: Any,
    beams: Any,
    widths: Any,
    gap_line: Any,
    pixel_line: Any,
    scale: Any,
) -> None:
    """The transpose of `spread_columns`: lines of F[B·H_gap·c_V] from c_V, or from lines of c_V that it transforms.

    gap_line: to the band. pixel_line: from the pixels' band to their rows.
    """
    gap_radices, gap_roots, gap_starts, window, band = gap_line
    radices, roots, starts, places, results = pixel_line
    length, period = fft_length(gap_radices), fft_length(radices)
    a, b = np.empty(period * BLOCK, source.dtype), np.empty(period * BLOCK, source.dtype)
    c, d = np.empty(length * BLOCK, source.dtype), np.empty(length * BLOCK, source.dtype)
    natural, one = np.arange(band.size), source.dtype.type(1)
    for laser in range(beams[0]):
        for beam in range(beams[1]):
            for column in range(0, widths[0], LANES):
                a[:] = 0
                for tile in range(0, widths[1], widths[0]):
                    if min(widths[0], widths[1] - tile) <= column:
                        continue
                    at = laser * source_strides[0] + beam * source_strides[1] + 2 * (tile + column)
                    h = laser * factor_strides[0] + tile // widths[0] * factor_strides[2] + 2 * column
                    if does_transform:
                        load_columns(c, source, at, source_strides[2], window)
                        done = fft(c, d, gap_radices, gap_roots, gap_starts)
                        _fold_tile(done, band, factors, h, factor_strides[1], scale, a, places, period)
                    else:
                        load_columns(c, source, at, source_strides[2], natural)
                        _fold_tile(c, natural, factors, h, factor_strides[1], one, a, places, period)
                done = fft(a, b, radices, roots, starts)
                to = laser * pixel_strides[0] + beam * pixel_strides[1] + 2 * column
                store_columns(done, pixels, to, pixel_strides[2], results, one, widths[0] - column)


@compiled
def _fold_tile(
    block: Any, band: Any, factors: Any, h: Any, stride: Any, scale: Any, folded: Any, places: Any, period: Any
) -> None:
    """Adds factors times a block's numbers to the entries of the pixels' spectrum that they repeat."""
    factor = splat(scale)
    for k in range(band.size):
        at, to = band[k] * BLOCK, places[k % period] * BLOCK
        real, imaginary = multiply(factor, load(block, at)), multiply(factor, load(block, at + LANES))
        u, v = load_complex(factors, h + k * stride)
        x, y = product(real, imaginary, u, v)
        store(folded, to, add(load(folded, to), x))
        store(folded, to + LANES, add(load(folded, to + LANES), y))


@compiled
def write_phasors(
    paths: Any, first: Any, strides: Any, frames: Any, per_metre: Any, pixels: Any, pixel_strides: Any, shape: Any
) -> None:
    """exp(2πi·path/λ) of one modulator's pixels (laser, y, x); its paths (frame, modulator, y, x) begin at `first`.

    frames, per_metre: of each laser, its frame and 1/λ. Turns are reduced in the precision of the paths. Half the angle
    is within ±π/2, where the Taylor series of sine and cosine are right to 1e-18 and doubling it gives the result.
    """
    number = pixels.dtype.type
    for laser in range(shape[0]):
        for row in range(shape[1]):
            at = first + frames[laser] * strides[0] + row * strides[2]
            to = laser * pixel_strides[0] + row * pixel_strides[1]
            path, line = paths[at : at + shape[2]], pixels[to : to + 2 * shape[2]]
            for x in range(shape[2]):
                turns = path[x] * per_metre[laser]
                half = number(turns - np.rint(turns)) * number(math.pi)
                square = half * half
                sine, cosine = number(_SINE[-1]), number(_COSINE[-1])
                for i in range(len(_SINE) - 2, -1, -1):
                    sine = sine * square + number(_SINE[i])
                for i in range(len(_COSINE) - 2, -1, -1):
                    cosine = cosine * square + number(_COSINE[i])
                sine *= half
                line[2 * x] = cosine * cosine - sine * sine
                line[2 * x + 1] = number(2) * sine * cosine


@compiled
def _load_pixels(
    block: Any, pixels: Any, at: Any, stride: Any, row: Any, count: Any, upsample: Any, size: Any, squares: Any
) -> None:
    """The pixels under `LANES` rows of samples from `row` on, of which `count` exist: (x, part, lane)."""
    for start in range(0, size, _HALF):
        for lane in range(count):
            store(squares, lane * LANES, load(pixels, at + (row + lane) // upsample * stride + 2 * start))
        turn(squares, 0, LANES, block, start * BLOCK, LANES)


@compiled
def modulate_rows(
    gap: Any,
    gap_strides: Any,
    lines: Any,
    strides: Any,
    pixels: Any,
    pixel_strides: Any,
    upsample: Any,
    shape: Any,
    gap_line: Any,
    last_line: Any,
    scale: Any,
) -> None:
    """Lines of F w along x, w = [F⁻¹V]·p₂, from lines of V in the gap (laser, source, row, k_x).

    pixels: p₂ (laser, y, x). shape: numbers of lasers, sources and rows. scale: of F⁻¹.
    """
    radices, roots, starts, places, window = gap_line
    last_radices, last_roots, last_starts, _, results = last_line
    length, factor = fft_length(radices), splat(scale)
    size = window.size // upsample
    a, b = np.empty(length * BLOCK, gap.dtype), np.empty(length * BLOCK, gap.dtype)
    c, phasors = np.empty(length * BLOCK, gap.dtype), np.empty((size + LANES) * BLOCK, gap.dtype)
    squares = np.zeros(2 * _PARTS, gap.dtype)
    for laser in range(shape[0]):
        for row in range(0, shape[2], LANES):
            count = min(LANES, shape[2] - row)
            at = laser * pixel_strides[0]
            _load_pixels(phasors, pixels, at, pixel_strides[1], row, count, upsample, size, squares)
            for beam in range(shape[1]):
                at = laser * gap_strides[0] + beam * gap_strides[1] + row * gap_strides[2]
                load_rows(a, gap, at, gap_strides[2], count, places, squares)
                done = fft(a, b, radices, roots, starts)
                other = b if done is a else a
                if window.size < length:
                    c[:] = 0
                for x in range(window.size):
                    place, pixel, to = window[x] * BLOCK, x // upsample * BLOCK, x * BLOCK
                    real, imaginary = multiply(factor, load(done, place)), multiply(factor, load(done, place + LANES))
                    u, v = load(phasors, pixel), load(phasors, pixel + LANES)
                    store_product(c, to, real, imaginary, u, v)
                done = fft(c, other, last_radices, last_roots, last_starts)
                at = laser * strides[0] + beam * strides[1] + row * strides[2]
                store_rows(done, lines, at, strides[2], count, results, squares)


@compiled
def backpropagate_rows(
    gap: Any,
    gap_strides: Any,
    lines: Any,
    strides: Any,
    pixels: Any,
    pixel_strides: Any,
    upsample: Any,
    shape: Any,
    gap_line: Any,
    last_line: Any,
    back_line: Any,
    scale: Any,
    products: Any,
    product_strides: Any,
) -> None:
    """The transpose of `modulate_rows`: lines in the gap become those of c_V, from lines of c_W.

    products (laser, source, y, x): where to write c_w·w of each pixel, w being the light behind modulator 2. Lines: V
    to the window, c_W to the window, and back to the gap's band. scale: of the first and the last.
    """
    radices, roots, starts, places, window = gap_line
    last_radices, last_roots, last_starts, last_places, last_window = last_line
    band, length = back_line[4], fft_length(radices)
    size = window.size // upsample
    a, b = np.empty(length * BLOCK, gap.dtype), np.empty(length * BLOCK, gap.dtype)
    c, d = np.empty(length * BLOCK, gap.dtype), np.empty(length * BLOCK, gap.dtype)
    phasors, sums = np.empty((size + LANES) * BLOCK, gap.dtype), np.empty((size + LANES) * BLOCK, gap.dtype)
    squares = np.zeros(2 * _PARTS, gap.dtype)
    for laser in range(shape[0]):
        for row in range(0, shape[2], LANES):
            count = min(LANES, shape[2] - row)
            at = laser * pixel_strides[0]
            _load_pixels(phasors, pixels, at, pixel_strides[1], row, count, upsample, size, squares)
            for beam in range(shape[1]):
                at = laser * gap_strides[0] + beam * gap_strides[1] + row * gap_strides[2]
                to = laser * strides[0] + beam * strides[1] + row * strides[2]
                load_rows(a, gap, at, gap_strides[2], count, places, squares)
                field = fft(a, b, radices, roots, starts)
                free = b if field is a else a
                load_rows(c, lines, to, strides[2], count, last_places, squares)
                adjoint = fft(c, d, last_radices, last_roots, last_starts)
                other = d if adjoint is c else c
                if window.size < length:
                    free[:] = 0
                _meet_pixels(field, window, adjoint, last_window, phasors, upsample, scale, free, sums)
                done = fft(free, other, radices, roots, starts)
                store_rows(done, gap, at, gap_strides[2], count, band, squares)
                at = laser * product_strides[0] + beam * product_strides[1]
                _add_pixel_rows(sums, products, at, product_strides[2], row, count, upsample, size, squares)


@compiled
def _meet_pixels(
    field: Any,
    window: Any,
    adjoint: Any,
    last_window: Any,
    phasors: Any,
    upsample: Any,
    scale: Any,
    back: Any,
    sums: Any,
) -> None:
    """Where the field and c_w meet at modulator 2: c_w·p₂ of each sample to `back`, Σ c_w·w of each pixel to `sums`."""
    factor, zero = splat(scale), splat(phasors.dtype.type(0))
    for pixel in range(window.size // upsample):
        u, v = load(phasors, pixel * BLOCK), load(phasors, pixel * BLOCK + LANES)
        p, q = zero, zero
        for x in range(pixel * upsample, (pixel + 1) * upsample):
            at, last, to = window[x] * BLOCK, last_window[x] * BLOCK, x * BLOCK
            e, f = load(field, at), load(field, at + LANES)
            g, h = multiply(factor, load(adjoint, last)), multiply(factor, load(adjoint, last + LANES))
            met = product(e, f, g, h)
            p, q = add(p, met[0]), add(q, met[1])
            store_product(back, to, g, h, u, v)
        store_product(sums, pixel * BLOCK, p, q, u, v)


@compiled
def _add_pixel_rows(
    block: Any, flat: Any, at: Any, stride: Any, row: Any, rows: Any, upsample: Any, size: Any, squares: Any
) -> None:
    """Sums of the first `rows` lanes of a block of pixels (x, part, lane) in the rows of pixels in which they lie."""
    for start in range(0, size, _HALF):
        turn(block, start * BLOCK, LANES, squares, 0, LANES)
        for lane in range(rows):
            to = at + (row + lane) // upsample * stride + 2 * start
            total = load(squares, lane * LANES)
            if (row + lane) % upsample > 0:
                total = add(load(flat, to), total)
            store(flat, to, total)
