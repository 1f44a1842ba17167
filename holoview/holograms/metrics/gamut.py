"""Chromaticities and the area that a set of lasers spans.

    x = X/(X + Y + Z),  y = Y/(X + Y + Z)        CIE 15:2018

Mixtures of lights lie inside the convex hull of their chromaticities, whose area is the usual measure of a gamut. It
overstates greens, because the (x, y) diagram isn't perceptually uniform.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.util.errors import UserError

SRGB_AREA = 0.11205
"""Area of the triangle of sRGB's primaries, for comparison."""


def chromaticity(xyz: ArrayLike) -> NDArray[np.float64]:
    """Chromaticities (…, 2) of XYZ (…, 3); NaN where X + Y + Z isn't positive."""
    values = np.asarray(xyz, dtype=np.float64)
    total = values.sum(axis=-1, keepdims=True)
    undefined = np.full((*values.shape[:-1], 2), np.nan)
    xy: NDArray[np.float64] = np.divide(values[..., :2], total, out=undefined, where=total > 0)
    return xy


def gamut_area(xy: ArrayLike) -> float:
    """Area of the convex hull of chromaticities (n, 2); 0 if they lie on a line or in a point.

    Raises UserError for another shape or chromaticities that aren't finite.
    """
    points = np.asarray(xy, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise UserError("chromaticities", f"shape {points.shape}", expected="finite values of shape (n, 2)")
    corners = convex_hull(points)
    return _polygon_area(corners) if len(corners) > 2 else 0.0


def convex_hull(xy: ArrayLike) -> NDArray[np.float64]:
    """Corners (m, 2) of the convex hull of points (n, 2), counter-clockwise; the ends of a line, or a single point."""
    ordered = sorted({(float(x), float(y)) for x, y in np.asarray(xy, dtype=np.float64)})
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)
    return np.array(_half_hull(ordered) + _half_hull(ordered[::-1]))


def _half_hull(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """One side of the hull of sorted points, without its last point (Andrew's monotone chain, 1979)."""
    hull: list[tuple[float, float]] = []
    for x, y in ordered:
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
                break
            hull.pop()
        hull.append((x, y))
    return hull[:-1]


def _polygon_area(corners: NDArray[np.float64]) -> float:
    """Area of a polygon (n, 2) by the shoelace formula."""
    x, y = corners.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
