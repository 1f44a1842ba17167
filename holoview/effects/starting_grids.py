"""Square grids of starting points for searches over two parameters."""

from __future__ import annotations

import math


def square_grid(first: str, second: str, reach: float, step: float) -> list[dict[str, float]]:
    """Points {parameter: value} of a square grid, −reach … reach in each, without (0, 0), sorted by distance to it."""
    count = round(reach / step)
    steps = [(i, j) for i in range(-count, count + 1) for j in range(-count, count + 1) if (i, j) != (0, 0)]
    steps.sort(key=lambda pair: pair[0] ** 2 + pair[1] ** 2)
    return [{first: i * step, second: j * step} for i, j in steps]


def half_circle(first: str, second: str, radius: float, count: int) -> list[dict[str, float]]:
    """Points {parameter: value} on the half of a circle where `first` isn't negative, equally spaced from +`second`."""
    angles = [math.pi * k / count for k in range(count)]
    return [{first: radius * math.sin(a), second: radius * math.cos(a)} for a in angles]
