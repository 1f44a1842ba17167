"""The passes of a chain of elements over one beam, compiled by numba around `vector_fft`, as `vector_kernels` has them.

A relay and its adjoint are the same passes: the adjoint of C·F⁻¹·H·F·Z, with the window's zeros Z and its cut C, is
that of the conjugate of H. A field (y, x) or its lines are flat, with the numbers from a row to the next beside them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from holoview.holograms.optimise.vector_fft import (
    BLOCK,
    LANES,
    add,
    fft,
    load,
    load_complex,
    multiply,
    splat,
    store_complex,
    store_product,
)
from holoview.holograms.optimise.vector_kernels import (
    fft_length,
    load_columns,
    load_rows,
    store_columns,
    store_rows,
)
from holoview.util.packages import compiled


@compiled
def filter_columns(
    source: Any,
    stride: Any,
    factors: Any,
    factor_stride: Any,
    scales: Any,
    target: Any,
    target_stride: Any,
    columns: Any,
    before: Any,
    behind: Any,
    does: Any,
) -> None:
    """Columns of lines (row, k_x) transformed to the band, times H, and transformed back.

    factors: H (k_y, k_x), whose real and imaginary part are scaled by the two `scales`. columns: the first, and the one
    behind the last. before, behind: lines to the band, and from it. does: whether to transform before and behind; where
    it doesn't behind, the products are added to the target (k_y, k_x).
    """
    radices, roots, starts, places, results = before
    back_radices, back_roots, back_starts, band, window = behind
    length, one = fft_length(radices), source.dtype.type(1)
    a, b = np.empty(length * BLOCK, source.dtype), np.empty(length * BLOCK, source.dtype)
    c, d = np.empty(length * BLOCK, source.dtype), np.empty(length * BLOCK, source.dtype)
    natural = np.arange(results.size)
    for column in range(columns[0], columns[1], LANES):
        at, to = 2 * column, 2 * column
        if does[0]:
            load_columns(a, source, at, stride, places)
            done, found = fft(a, b, radices, roots, starts), results
        else:
            load_columns(a, source, at, stride, natural)
            done, found = a, natural
        if does[1]:
            _filter(done, found, factors, at, factor_stride, scales, c, band)
            shown = fft(c, d, back_radices, back_roots, back_starts)
            store_columns(shown, target, to, target_stride, window, one, columns[1] - column)
        else:
            _filter(done, found, factors, at, factor_stride, scales, c, natural)
            _add_columns(c, target, to, target_stride, results.size, columns[1] - column)


@compiled
def _filter(block: Any, found: Any, factors: Any, at: Any, stride: Any, scales: Any, target: Any, places: Any) -> None:
    """Numbers of a block times factors, into a block that is zero elsewhere."""
    if places.size * BLOCK < target.size:
        target[:] = 0
    real_scale, imaginary_scale = splat(scales[0]), splat(scales[1])
    for k in range(found.size):
        real, imaginary = load(block, found[k] * BLOCK), load(block, found[k] * BLOCK + LANES)
        u, v = load_complex(factors, at + k * stride)
        u, v = multiply(u, real_scale), multiply(v, imaginary_scale)
        store_product(target, places[k] * BLOCK, real, imaginary, u, v)


@compiled
def _add_columns(block: Any, flat: Any, at: Any, stride: Any, count: Any, columns: Any) -> None:
    """Adds the first `columns` lanes of a block of `count` positions to a flat array."""
    line = np.empty(BLOCK, block.dtype)
    for row in range(count):
        real, imaginary = load(block, row * BLOCK), load(block, row * BLOCK + LANES)
        if columns >= LANES:
            x, y = load_complex(flat, at + row * stride)
            store_complex(flat, at + row * stride, add(x, real), add(y, imaginary))
        else:
            store_complex(line, 0, real, imaginary)
            for i in range(2 * columns):
                flat[at + row * stride + i] += line[i]


@compiled
def show_rows(
    lines: Any,
    stride: Any,
    fields: Any,
    field_stride: Any,
    intensity: Any,
    shown_stride: Any,
    adds: Any,
    rows: Any,
    line: Any,
) -> None:
    """Rows of lines transformed to the fields E (y, x), and their intensity |E|², which is added to that there if adds.

    rows: the first, and the one behind the last.
    """
    radices, roots, starts, places, window = line
    length = fft_length(radices)
    a, b = np.empty(length * BLOCK, lines.dtype), np.empty(length * BLOCK, lines.dtype)
    squares = np.zeros(2 * LANES * LANES, lines.dtype)
    for row in range(rows[0], rows[1], LANES):
        count = min(LANES, rows[1] - row)
        load_rows(a, lines, row * stride, stride, count, places, squares)
        done = fft(a, b, radices, roots, starts)
        store_rows(done, fields, row * field_stride, field_stride, count, window, squares)
        for y in range(row, row + count):
            field = fields[y * field_stride : y * field_stride + 2 * window.size]
            shown = intensity[y * shown_stride : y * shown_stride + window.size]
            if not adds:
                shown[:] = 0
            for x in range(window.size):
                shown[x] += field[2 * x] * field[2 * x] + field[2 * x + 1] * field[2 * x + 1]


@compiled
def slope_rows(
    fields: Any, field_stride: Any, slopes: Any, slope_stride: Any, lines: Any, stride: Any, rows: Any, line: Any
) -> None:
    """The adjoint of `show_rows`: lines of 2·g·E, with the slopes g = ∂L/∂|E|²."""
    radices, roots, starts, places, band = line
    length, width = fft_length(radices), 2 * places.size + BLOCK
    a, b = np.empty(length * BLOCK, lines.dtype), np.empty(length * BLOCK, lines.dtype)
    squares, sloped = np.zeros(2 * LANES * LANES, lines.dtype), np.zeros(LANES * width, lines.dtype)
    for row in range(rows[0], rows[1], LANES):
        count = min(LANES, rows[1] - row)
        for lane in range(count):
            at, to = (row + lane) * field_stride, (row + lane) * slope_stride
            field, slope = fields[at : at + 2 * places.size], slopes[to : to + places.size]
            own = sloped[lane * width : (lane + 1) * width]
            for x in range(places.size):
                twice = slope[x] + slope[x]
                own[2 * x] = twice * field[2 * x]
                own[2 * x + 1] = twice * field[2 * x + 1]
        load_rows(a, sloped, 0, width, count, places, squares)
        store_rows(fft(a, b, radices, roots, starts), lines, row * stride, stride, count, band, squares)


@compiled
def power_behind(spectrum: Any, stride: Any, passed: Any, passed_stride: Any, powers: Any, shape: Any) -> None:
    """|passed·W|² (k_y, k_x) of a spectrum W behind stops that let real amplitudes pass."""
    for row in range(shape[0]):
        own = spectrum[row * stride : row * stride + 2 * shape[1]]
        amplitude = passed[row * passed_stride : row * passed_stride + shape[1]]
        for k in range(shape[1]):
            real, imaginary = own[2 * k] * amplitude[k], own[2 * k + 1] * amplitude[k]
            powers[row * shape[1] + k] = real * real + imaginary * imaginary


# --- where an element stands -----------------------------------------------------------------------------------------


@compiled
def _spread(pixels: Any, at: Any, count: Any, size: Any, start: Any, line: Any, conjugates: Any) -> None:
    """A row of pixels, or of their conjugates, at the samples of the field."""
    for x in range(count):
        real, imaginary = pixels[at + 2 * x], pixels[at + 2 * x + 1]
        if conjugates:
            imaginary = -imaginary
        for i in range(start + x * size, start + (x + 1) * size):
            line[2 * i] = real
            line[2 * i + 1] = imaginary


@compiled
def modulate(
    field: Any,
    stride: Any,
    pixels: Any,
    pixel_stride: Any,
    place: Any,
    target: Any,
    target_stride: Any,
    shape: Any,
    conjugates: Any,
) -> None:
    """A field (y, x) times the transmission of pixels, 0 beside them; times its conjugate, which is the adjoint for the
    field, if conjugates.

    place: rows and columns of pixels, samples of one along an axis, and the first sample (y, x). shape: of the field.
    """
    rows, columns, size, top, left = place
    line = np.zeros(2 * shape[1], field.dtype)
    for y in range(shape[0]):
        to = target[y * target_stride : y * target_stride + 2 * shape[1]]
        if y < top or y >= top + rows * size:
            to[:] = 0
            continue
        if (y - top) % size == 0:
            _spread(pixels, (y - top) // size * pixel_stride, columns, size, left, line, conjugates)
        own = field[y * stride : y * stride + 2 * shape[1]]
        for x in range(shape[1]):
            a, b, u, v = own[2 * x], own[2 * x + 1], line[2 * x], line[2 * x + 1]
            to[2 * x] = a * u - b * v
            to[2 * x + 1] = a * v + b * u


@compiled
def return_to_pixels(
    slopes: Any, stride: Any, field: Any, field_stride: Any, place: Any, pixels: Any, pixel_stride: Any
) -> None:
    """The adjoint of `modulate` for the transmission: Σ g·conj(field) over the samples of each pixel."""
    rows, columns, size, top, left = place
    for row in range(rows):
        to = pixels[row * pixel_stride : row * pixel_stride + 2 * columns]
        to[:] = 0
        for y in range(top + row * size, top + (row + 1) * size):
            own = slopes[y * stride + 2 * left :]
            light = field[y * field_stride + 2 * left :]
            for x in range(columns):
                real, imaginary = to[2 * x], to[2 * x + 1]
                for i in range(x * size, (x + 1) * size):
                    a, b, u, v = own[2 * i], own[2 * i + 1], light[2 * i], light[2 * i + 1]
                    real += a * u + b * v
                    imaginary += b * u - a * v
                to[2 * x], to[2 * x + 1] = real, imaginary
