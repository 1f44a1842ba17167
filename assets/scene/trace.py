"""The camera, and the nearest thing that each ray of a bundle meets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assets.scene.room import WALL_Z
from assets.scene.sdf import Array, Vec
from assets.scene.solids import Solid

NEAR, FAR = 2.2, WALL_Z
FLOOR, WALL, NOTHING = -1, -2, -3
_CLOSE = 3e-4


@dataclass(frozen=True)
class Camera:
    """A view camera at (0, 1, 0) looking along z with a raised back, so that uprights stay upright.

    Image coordinates are x/z and (y − 1)/z. The floor leaves the picture at z = NEAR and meets the wall at z = FAR, so
    that everything seen lies between them.
    """

    width: int = 1024
    height: int = 768
    field: float = 0.62
    lowest: float = -1 / NEAR

    @property
    def pixel(self) -> float:
        """Size of a pixel in image coordinates."""
        return self.field / self.width

    def image_points(self, rows: NDArray[np.int64], margin: int, dx: float, dy: float) -> tuple[Array, Array]:
        """Image coordinates (rows · (width + 2·margin),) of the pixels in `rows`, (dx, dy) pixels off their centres."""
        x = (np.arange(-margin, self.width + margin) + 0.5 + dx - self.width / 2) * self.pixel
        y = self.lowest + (self.height - rows - 0.5 - dy) * self.pixel
        grid_x, grid_y = np.meshgrid(x, y)
        return grid_x.ravel().astype(np.float32), grid_y.ravel().astype(np.float32)


@dataclass
class Hit:
    """For each ray: distance along it, and what it met (index of a solid, FLOOR, WALL or NOTHING)."""

    t: Array
    what: NDArray[np.int32]


def depth_code(z: Array) -> Array:
    """0 at z = NEAR … 1 at z = FAR, linear in 1/z: the measure in which a lens' blur grows evenly."""
    return np.asarray(np.clip((1 / NEAR - 1 / z) / (1 / NEAR - 1 / FAR), 0, 1), dtype=np.float32)


def at(origin: Vec, direction: Vec, t: Array) -> Vec:
    """Points at distance t along the rays."""
    x, y, z = (o + t * d for o, d in zip(origin, direction, strict=True))
    return x, y, z


def take(v: Vec, index: NDArray[np.int64]) -> Vec:
    """Some points of a bundle."""
    return v[0][index], v[1][index], v[2][index]


def dot(a: Vec, b: Vec) -> Array:
    """Scalar product, ray by ray."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], dtype=np.float32)


def unit(v: Vec) -> Vec:
    """Unit vectors."""
    scale = np.float32(1) / np.sqrt(np.maximum(dot(v, v), np.float32(1e-20)))
    x, y, z = (np.asarray(c * scale, dtype=np.float32) for c in v)
    return x, y, z


def passing(origin: Vec, direction: Vec, solid: Solid, margin: float = 0.0) -> tuple[NDArray[np.int64], Array, Array]:
    """Which rays come within `margin` of the solid's bounding ball, and between which distances."""
    to = tuple(np.float32(c) - o for c, o in zip(solid.world_centre, origin, strict=True))
    towards = (to[0], to[1], to[2])
    middle = dot(towards, direction)
    square = np.float32((solid.radius + margin) ** 2) - (dot(towards, towards) - middle**2)
    index = np.flatnonzero((square > 0) & (middle + np.sqrt(np.maximum(square, 0)) > 0))
    half = np.sqrt(square[index])
    return index, np.maximum(middle[index] - half, 0), middle[index] + half


def intersect(origin: Vec, direction: Vec, solids: list[Solid], start: float = 0.0) -> Hit:
    """The first thing on each ray (unit directions), beyond `start`."""
    hit = _room(origin, direction)
    for number, solid in enumerate(solids):
        index, enter, leave = passing(origin, direction, solid)
        if index.size == 0:
            continue
        t = _march(take(origin, index), take(direction, index), solid, np.maximum(enter, np.float32(start)), leave)
        nearer = t < hit.t[index]
        hit.t[index[nearer]] = t[nearer]
        hit.what[index[nearer]] = number
    return hit


def _room(origin: Vec, direction: Vec) -> Hit:
    """Where rays meet the floor (y = 0) and the wall (z = WALL_Z)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(direction[1] < 0, -origin[1] / direction[1], np.inf)
        wall = np.where(direction[2] > 0, (np.float32(WALL_Z) - origin[2]) / direction[2], np.inf)
    t = np.minimum(floor, wall).astype(np.float32)
    what = np.where(floor < wall, FLOOR, np.where(np.isfinite(wall), WALL, NOTHING)).astype(np.int32)
    return Hit(t, what)


def _march(origin: Vec, direction: Vec, solid: Solid, enter: Array, leave: Array, steps: int = 72) -> Array:
    """Distance to the solid's surface along each ray, inf where it is missed."""
    result = np.full_like(enter, np.inf)
    live = np.arange(enter.size)
    t = enter.copy()
    for _ in range(steps):
        if live.size == 0:
            break
        gap = solid.distance(at(origin, direction, t))
        t = t + gap
        met, lost = gap < _CLOSE, t > leave
        result[live[met]] = t[met]
        keep = np.flatnonzero(~(met | lost))
        if keep.size < live.size:
            live, t, leave = live[keep], t[keep], leave[keep]
            origin, direction = take(origin, keep), take(direction, keep)
    return result
