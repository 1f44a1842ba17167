"""Computes the pictures `night` and `bright` with their depth maps: python -m assets.make_scenes [--out FOLDER].

Both are painted from far to near in linear light on a grid of twice the size and averaged over 2 × 2 points. `night` is
dark with few small lights, `bright` is bright and smooth. Depth: 0 is the nearest, 65535 the farthest (README.md).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Floats = NDArray[np.float64]

ROWS, COLUMNS, FINER = 768, 1024, 2
_FAR = 1.0


class Canvas:
    """Linear RGB (y, x, 3) and depth (y, x), painted from far to near; x is 0 … 4/3, and y is 0 … 1 downwards."""

    def __init__(self) -> None:
        y, x = np.mgrid[0 : ROWS * FINER, 0 : COLUMNS * FINER] + 0.5
        self.y, self.x = y / (ROWS * FINER), x / (ROWS * FINER)
        self.rgb = np.zeros((*self.y.shape, 3))
        self.depth = np.full(self.y.shape, _FAR)

    def paint(self, mask: NDArray[np.bool_], rgb: Floats, depth: float | Floats) -> None:
        """Covers the masked points with a colour (3,) or colours (y, x, 3) at a depth."""
        self.rgb[mask] = np.broadcast_to(rgb, self.rgb.shape)[mask]
        self.depth[mask] = np.broadcast_to(depth, self.depth.shape)[mask]

    def shine(self, y: float, x: float, radius: float, rgb: Floats) -> None:
        """Adds the glow of a lamp, which falls with the square of the distance outside its radius."""
        squared = (self.y - y) ** 2 + (self.x - x) ** 2
        self.rgb += (1 / (1 + squared / radius**2))[..., None] ** 1.5 * rgb

    def save(self, folder: Path, name: str) -> None:
        """Writes NAME.png (8-bit sRGB) and NAME-depth.png (16-bit grey)."""
        fine = np.clip(self.rgb, 0, 1).reshape(ROWS, FINER, COLUMNS, FINER, 3).mean(axis=(1, 3))
        encoded = np.where(fine <= 0.0031308, 12.92 * fine, 1.055 * fine ** (1 / 2.4) - 0.055)
        Image.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(folder / f"{name}.png", optimize=True)
        depth = np.rint(65535 * self.depth[::FINER, ::FINER]).astype(np.uint16)
        Image.fromarray(depth).save(folder / f"{name}-depth.png", optimize=True)


def night(rng: np.random.Generator) -> Canvas:
    """A town at night: a moon, lit windows in three rows of houses, two street lamps and their light on the ground."""
    c = Canvas()
    c.rgb += (0.002 + 0.010 * c.y)[..., None] * np.array([0.5, 0.7, 1.6])
    c.paint((c.y - 0.16) ** 2 + (c.x - 1.08) ** 2 < 0.045**2, np.array([0.75, 0.72, 0.62]), _FAR)
    for depth, base, height, width, share in ((0.8, 0.62, 0.30, 0.09, 0.10), (0.55, 0.72, 0.34, 0.15, 0.12)):
        _houses(c, rng, depth, base, height, width, share)
    ground = c.y > 0.70
    c.paint(ground, (0.004 + 0.01 * (c.y - 0.7))[..., None] * np.array([0.9, 1.0, 1.2]), 0.55 - 1.6 * (c.y - 0.7))
    _houses(c, rng, 0.3, 0.78, 0.5, 0.26, 0.08, edge=0.30)
    for x, depth, top, size in ((0.72, 0.12, 0.30, 0.016), (1.02, 0.4, 0.48, 0.008)):
        c.paint((abs(c.x - x) < size / 4) & (c.y > top) & (c.y < 0.95 - depth / 2), np.full(3, 0.006), depth)
        c.paint((c.y - top) ** 2 + (c.x - x) ** 2 < size**2, np.array([1.0, 0.78, 0.42]), depth)
        c.shine(top, x, 1.6 * size, np.array([0.35, 0.22, 0.09]))
        wet = np.exp(-(((c.x - x) / (2.5 * size)) ** 2)) * (c.y > 0.95 - depth / 2) * np.exp(-4 * (c.y - 0.7))
        c.rgb += wet[..., None] * np.array([0.30, 0.21, 0.10])
    return c


def _houses(
    c: Canvas,
    rng: np.random.Generator,
    depth: float,
    base: float,
    height: float,
    width: float,
    share: float,
    edge: float = 4 / 3,
) -> None:
    """A row of dark houses up to x = `edge`, of whose windows a share is lit."""
    left = -0.03
    while left < edge:
        right, top = left + width * rng.uniform(0.7, 1.2), base - height * rng.uniform(0.5, 1.0)
        c.paint((c.x >= left) & (c.x < right) & (c.y > top) & (c.y < base), np.array([0.004, 0.004, 0.006]), depth)
        pitch = width / 5
        for y in np.arange(top + pitch / 2, base - pitch / 2, 1.3 * pitch):
            for x in np.arange(left + pitch / 2, right - pitch / 2, pitch):
                lit, colour = rng.random() < share, rng.uniform(0.35, 0.9) * np.array([1.0, rng.uniform(0.6, 0.9), 0.4])
                mask = (abs(c.x - x - pitch / 4) < pitch / 5) & (abs(c.y - y - pitch / 4) < pitch / 4)
                c.paint(mask & (c.x < right), colour if lit else np.array([0.003, 0.004, 0.006]), depth)
        left = right


def bright(rng: np.random.Generator) -> Canvas:
    """Hills under a bright sky with three balloons: large smooth shapes, soft shading, nothing dark."""
    c = Canvas()
    t = c.y[..., None]
    c.rgb[:] = (1 - t) * np.array([0.55, 0.72, 0.92]) + t * np.array([0.95, 0.90, 0.80])
    colours = ([0.62, 0.72, 0.82], [0.60, 0.76, 0.62], [0.72, 0.80, 0.48], [0.88, 0.80, 0.46])
    for number, (depth, level, colour) in enumerate(
        zip((0.8, 0.6, 0.4, 0.2), (0.5, 0.6, 0.72, 0.84), colours, strict=True)
    ):
        phase = rng.uniform(0, 2 * np.pi, 2)
        top = level + 0.05 * np.sin(4.2 * c.x + phase[0]) + 0.02 * np.sin(9.1 * c.x + phase[1])
        light = 0.85 + 0.18 * np.tanh(2.5 * (top - c.y + 0.12)) + 0.05 * np.cos(4.2 * c.x + phase[0])
        c.paint(c.y > top, light[..., None] * np.array(colour), depth - 0.15 * np.clip(c.y - top, 0, 1) * (number > 1))
    for y, x, radius, depth, colour in (
        (0.30, 0.36, 0.13, 0.05, [0.95, 0.50, 0.42]),
        (0.22, 0.90, 0.08, 0.5, [0.98, 0.82, 0.40]),
        (0.40, 1.14, 0.05, 0.9, [0.55, 0.62, 0.90]),
    ):
        v, u = (c.y - y) / radius, (c.x - x) / radius
        height = np.sqrt(np.clip(1 - u**2 - v**2, 0, 1))
        light = 0.55 + 0.45 * np.clip(-0.5 * u - 0.6 * v + 0.65 * height, 0, 1)
        stripes = 1 - 0.10 * (np.cos(6 * np.arctan2(u, height + 1e-9)) > 0)
        c.paint(u**2 + v**2 < 1, (light * stripes)[..., None] * np.array(colour), depth)
    return c


def main() -> None:
    """Writes both pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder; this one by default")
    folder = parser.parse_args().out
    for scene in (night, bright):
        scene(np.random.default_rng(7)).save(folder, scene.__name__)


if __name__ == "__main__":
    main()
