"""Signed distance functions on bundles of points: negative inside, and never longer than the way to the surface.

A point bundle is three float32 arrays (x, y, z) of one shape, in the solid's own coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Vec = tuple[Array, Array, Array]
Distance = Callable[[Vec], Array]


def sphere(radius: float) -> Distance:
    """A ball about the origin."""
    return lambda p: np.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2) - np.float32(radius)


def rounded_box(half: tuple[float, float, float], rounding: float) -> Distance:
    """A box of half-sizes `half` (rounding included) about the origin."""
    inner = [h - rounding for h in half]

    def distance(p: Vec) -> Array:
        q = [np.abs(c) - np.float32(h) for c, h in zip(p, inner, strict=True)]
        outside = np.sqrt(sum(np.maximum(c, 0) ** 2 for c in q))
        inside = np.minimum(np.maximum(np.maximum(q[0], q[1]), q[2]), 0)
        return np.asarray(outside + inside - np.float32(rounding), dtype=np.float32)

    return distance


def torus(major: float, minor: float) -> Distance:
    """A ring lying flat about the y axis."""
    return lambda p: np.hypot(np.hypot(p[0], p[2]) - np.float32(major), p[1]) - np.float32(minor)


def rod(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Distance:
    """A capsule between two points."""
    axis = [e - s for s, e in zip(start, end, strict=True)]
    square = sum(a * a for a in axis)

    def distance(p: Vec) -> Array:
        q = [c - np.float32(s) for c, s in zip(p, start, strict=True)]
        along = np.clip(sum(c * np.float32(a / square) for c, a in zip(q, axis, strict=True)), 0, 1)
        return np.sqrt(sum((c - along * np.float32(a)) ** 2 for c, a in zip(q, axis, strict=True))) - np.float32(radius)

    return distance


def union(*parts: Distance) -> Distance:
    """All parts together."""

    def distance(p: Vec) -> Array:
        nearest = parts[0](p)
        for part in parts[1:]:
            nearest = np.minimum(nearest, part(p))
        return nearest

    return distance


def dimpled(body: Distance, dents: Sequence[tuple[float, float, float]], radius: float) -> Distance:
    """`body` with balls of `radius` taken out at `dents`."""

    def distance(p: Vec) -> Array:
        result = body(p)
        for x, y, z in dents:
            ball = np.sqrt((p[0] - np.float32(x)) ** 2 + (p[1] - np.float32(y)) ** 2 + (p[2] - np.float32(z)) ** 2)
            result = np.maximum(result, np.float32(radius) - ball)
        return result

    return distance


def lathe(profile: Sequence[tuple[float, float]], cells: int = 320) -> Distance:
    """The solid turned from a profile of (radius, height) points, from the foot's axis to the top's axis.

    A smooth curve (Catmull–Rom) runs through the points; a point given twice is a sharp corner. The exact distance to
    the profile is put in a table once, because a turned solid only needs (radius, height).
    """
    outline = _smooth_curve(np.asarray(profile, dtype=np.float64))
    margin = 0.05
    width = float(outline[:, 0].max()) + margin
    low, high = float(outline[:, 1].min()) - margin, float(outline[:, 1].max()) + margin
    step = max(width, high - low) / cells
    radii = np.arange(int(width / step) + 2, dtype=np.float64) * step
    heights = low + np.arange(int((high - low) / step) + 2, dtype=np.float64) * step
    table = _rounded(_polygon_distance(np.concatenate([outline, outline[::-1] * (-1, 1)]), radii, heights))

    def distance(p: Vec) -> Array:
        radius = np.hypot(p[0], p[2])
        column = np.asarray(radius / np.float32(step), dtype=np.float32)
        column = np.clip(column, 0, np.float32(len(radii) - 1.001))
        row = np.asarray((p[1] - np.float32(low)) / np.float32(step), dtype=np.float32)
        row = np.clip(row, 0, np.float32(len(heights) - 1.001))
        beyond = np.hypot(radius - column * np.float32(step), p[1] - row * np.float32(step) - np.float32(low))
        inside = _bilinear(table, row, column)
        outside = beyond > np.float32(1e-5)  # the profile keeps `margin` away from the table's edges
        return np.where(outside, np.maximum(inside - beyond, beyond + np.float32(0.9 * margin)), inside)

    return distance


def _smooth_curve(points: NDArray[np.float64], pieces: int = 12) -> NDArray[np.float64]:
    padded = np.concatenate([points[:1], points, points[-1:]])
    u = (np.arange(pieces) / pieces)[:, None]
    curve = []
    for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        if np.allclose(b, c):
            continue
        curve.append(b + u * ((c - a) / 2 + u * ((a - 2.5 * b + 2 * c - d / 2) + u * ((3 * (b - c) + d - a) / 2))))
    return np.concatenate([*curve, points[-1:]])


def _polygon_distance(corners: NDArray[np.float64], radii: NDArray[np.float64], heights: NDArray[np.float64]) -> Array:
    """Signed distance (height, radius) to a closed polygon; inside by the even–odd rule."""
    x, y = np.meshgrid(radii, heights)
    nearest = np.full(x.shape, np.inf)
    inside = np.zeros(x.shape, dtype=bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        ex, ey = bx - ax, by - ay
        along = np.clip(((x - ax) * ex + (y - ay) * ey) / max(ex * ex + ey * ey, 1e-12), 0, 1)
        nearest = np.minimum(nearest, (x - ax - along * ex) ** 2 + (y - ay - along * ey) ** 2)
        if ey != 0:
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (ex / ey))
    return np.asarray(np.where(inside, -1, 1) * np.sqrt(nearest), dtype=np.float32)


def _rounded(table: Array, passes: int = 8) -> Array:
    """The table smoothed over a few cells: the polygon's facets go, and sharp corners become small bevels."""
    for _ in range(passes):
        for axis in (0, 1):
            padded = np.pad(
                table, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode="reflect", reflect_type="odd"
            )
            if axis == 1:
                padded[:, 0] = table[:, 1]
            size = table.shape[axis]
            before, after = padded.take(range(size), axis), padded.take(range(2, size + 2), axis)
            table = (before + 2 * table + after) / np.float32(4)
    return table


def _bilinear(table: Array, row: Array, column: Array) -> Array:
    i, j = row.astype(np.int32), column.astype(np.int32)
    u, v = row - i, column - j
    flat, width = table.reshape(-1), table.shape[1]
    at = i * width + j
    upper = flat[at] * (1 - v) + flat[at + 1] * v
    lower = flat[at + width] * (1 - v) + flat[at + width + 1] * v
    return np.asarray(upper * (1 - u) + lower * u, dtype=np.float32)
