"""A placed solid: what it is made of, where it stands, and cheap stand-ins for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from assets.scene.sdf import Array, Distance, Vec

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """`albedo` in linear sRGB, or a function of own coordinates; `shine` is the mirror share at normal incidence."""

    albedo: Colour | Callable[[Vec], Vec]
    shine: float = 0.04
    highlight: float = 60.0


@dataclass(frozen=True)
class Solid:
    """A distance function standing at `at`, turned by `yaw`; `centre` (own coordinates) and `radius` bound it.

    `proxies` are balls (x, y, z, radius) in own coordinates that throw the solid's ambient shade on its neighbours.
    """

    shape: Distance
    material: Material
    at: tuple[float, float, float]
    centre: tuple[float, float, float]
    radius: float
    yaw: float = 0.0
    proxies: tuple[tuple[float, float, float, float], ...] = ()

    @property
    def world_centre(self) -> tuple[float, float, float]:
        """Centre of the bounding ball in the scene."""
        x, y, z = self._turned(self.centre)
        return self.at[0] + x, self.at[1] + y, self.at[2] + z

    @property
    def world_proxies(self) -> list[tuple[float, float, float, float]]:
        """The proxies in the scene; the bounding ball when none are given."""
        balls = self.proxies or ((*self.centre, 0.9 * self.radius),)
        placed = []
        for x, y, z, radius in balls:
            tx, ty, tz = self._turned((x, y, z))
            placed.append((self.at[0] + tx, self.at[1] + ty, self.at[2] + tz, radius))
        return placed

    def own(self, p: Vec) -> Vec:
        """Scene points in the solid's own coordinates."""
        x, y, z = (c - np.float32(a) for c, a in zip(p, self.at, strict=True))
        if self.yaw == 0:
            return x, y, z
        cos, sin = np.float32(math.cos(self.yaw)), np.float32(math.sin(self.yaw))
        return cos * x - sin * z, y, sin * x + cos * z

    def distance(self, p: Vec) -> Array:
        """Signed distance of scene points."""
        return self.shape(self.own(p))

    def albedo(self, p: Vec) -> Vec:
        """Colour at scene points."""
        if callable(self.material.albedo):
            return self.material.albedo(self.own(p))
        r, g, b = (np.full_like(p[0], c) for c in self.material.albedo)
        return r, g, b

    def _turned(self, point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = point
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return cos * x + sin * z, y, -sin * x + cos * z
