"""The test chart: colour patches, grey ramps, a star, rings and line pairs; slanted edges are drawn 8 times finer."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
_OVER = 8
_BACK = 0.18
_PATCHES: tuple[tuple[float, float, float], ...] = (
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (0, 1, 1),
    (1, 0, 1),
    (1, 1, 0),
    (0.44, 0.17, 0.11),
    (0.54, 0.30, 0.22),
    (0.11, 0.20, 0.34),
    (0.10, 0.15, 0.05),
    (0.22, 0.22, 0.44),
    (0.13, 0.51, 0.41),
)


def chart() -> Array:
    """The chart (768, 1024, 3) in linear sRGB."""
    picture = np.full((768, 1024, 3), _BACK, dtype=np.float32)
    _patches(picture)
    _ramps(picture)
    _star(picture, centre=(512, 384), radius=232)
    for number, period in enumerate((2, 3, 4, 6, 8, 12, 16)):
        _line_pairs(picture, top=154 + 66 * number, left=40, period=period)
    _zone_plate(picture, centre=(886, 384), radius=110)
    _dots(picture)
    return picture


def _patches(picture: Array) -> None:
    """Full-strength primaries and mixtures, then muted natural colours, along the top."""
    for number, ink in enumerate(_PATCHES):
        left = 32 + 80 * number
        picture[32:112, left : left + 80] = ink


def _ramps(picture: Array) -> None:
    """Below: eleven grey steps even to the eye, a smooth grey ramp, and red, green and blue ramps, linear in light."""
    for step in range(11):
        left = 32 + round(960 / 11 * step)
        picture[636:672, left : 32 + round(960 / 11 * (step + 1))] = (step / 10) ** 2.2
    ramp = np.linspace(0, 1, 960, dtype=np.float32)
    picture[672:700, 32:992] = ramp[None, :, None]
    for channel in range(3):
        rows = slice(700 + 12 * channel, 712 + 12 * channel)
        picture[rows, 32:992] = 0
        picture[rows, 32:992, channel] = ramp


def _star(picture: Array, centre: tuple[int, int], radius: int, spokes: int = 36) -> None:
    """A Siemens star: finer and finer towards its middle."""
    x, y = _fine(2 * radius, 2 * radius, radius - 0.5)
    value = (np.floor(np.arctan2(y, x) * (2 * spokes / math.tau)) % 2).astype(np.float32)
    inside = np.hypot(x, y) < radius
    _blend(picture, centre, value, inside)


def _zone_plate(picture: Array, centre: tuple[int, int], radius: int) -> None:
    """Rings whose period falls to 4 pixels at the rim."""
    x, y = _fine(2 * radius, 2 * radius, radius - 0.5)
    distance = np.hypot(x, y)
    value = 0.5 + 0.5 * np.cos(np.pi * distance**2 / (4 * radius))
    _blend(picture, centre, value.astype(np.float32), distance < radius)


def _line_pairs(picture: Array, top: int, left: int, period: int) -> None:
    """Lines of one period (pixels) in squares of 48 pixels: upright, level, and upright in red and blue."""
    halves = (np.arange(96) % (2 * period) < period).astype(np.float32)
    bars = halves.reshape(48, 2).mean(axis=1)
    rows = slice(top, top + 48)
    picture[rows, left : left + 48] = bars[None, :, None]
    picture[rows, left + 60 : left + 108] = bars[:, None, None]
    picture[rows, left + 120 : left + 168] = np.stack([bars, 0 * bars, 1 - bars], axis=-1)[None]


def _dots(picture: Array) -> None:
    """Bright points on black: what speckle, aberrations and defocus make of a point."""
    picture[154:254, 776:996] = 0
    for number, size in enumerate((1, 2, 3, 4, 6)):
        for row in range(3):
            top, left = 168 + 30 * row, 796 + 40 * number
            picture[top : top + size, left : left + size] = ((1, 1, 1), (1, 0.1, 0.02), (0.05, 0.2, 1))[row]
    picture[514:614, 776:996] = 1
    for number, size in enumerate((1, 2, 3, 4, 6)):
        for row in range(3):
            top, left = 528 + 30 * row, 796 + 40 * number
            picture[top : top + size, left : left + size] = ((0, 0, 0), (0, 0.4, 0.05), (0.3, 0, 0.3))[row]


def _fine(width: int, height: int, middle: float) -> tuple[Array, Array]:
    fine_x = (np.arange(width * _OVER) + 0.5) / _OVER - 0.5 - middle
    fine_y = (np.arange(height * _OVER) + 0.5) / _OVER - 0.5 - middle
    x, y = np.meshgrid(fine_x, fine_y)
    return x.astype(np.float32), y.astype(np.float32)


def _blend(picture: Array, centre: tuple[int, int], value: Array, inside: NDArray[np.bool_]) -> None:
    cover, light = _coarse(inside.astype(np.float32)), _coarse(value * inside)
    rows, columns = cover.shape
    top, left = centre[1] - rows // 2, centre[0] - columns // 2
    part = picture[top : top + rows, left : left + columns]
    part[...] = part * (1 - cover[..., None]) + light[..., None]


def _coarse(fine: Array) -> Array:
    rows, columns = fine.shape[0] // _OVER, fine.shape[1] // _OVER
    return np.asarray(fine.reshape(rows, _OVER, columns, _OVER).mean(axis=(1, 3)), dtype=np.float32)
