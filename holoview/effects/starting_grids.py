"""Starting points of a search in two directions."""

from __future__ import annotations


def square_grid(first: str, second: str, reach: float, step: float) -> list[dict[str, float]]:
    """Points of a square grid of two parameters, −reach … reach each, without the middle; the nearest to it first."""
    count = round(reach / step)
    steps = [(i, j) for i in range(-count, count + 1) for j in range(-count, count + 1) if (i, j) != (0, 0)]
    steps.sort(key=lambda pair: pair[0] ** 2 + pair[1] ** 2)
    return [{first: i * step, second: j * step} for i, j in steps]
