"""Light on what the rays meet: a soft key light, ambient light with occlusion, highlights and one reflection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from assets.scene.room import Floor, surroundings, wall_albedo
from assets.scene.sdf import Array, Vec
from assets.scene.solids import Solid
from assets.scene.trace import FLOOR, NOTHING, WALL, Hit, at, dot, intersect, passing, take, unit

_KEY = (-0.676, 0.718, -0.165)
_KEY_COLOUR = (1.55, 1.45, 1.29)
_PENUMBRA = 7.0
_LIFT = 4e-3
_FLOOR_SHINE, _FLOOR_HIGHLIGHT = 0.03, 6.0


@dataclass(frozen=True)
class Scene:
    """Everything that light can meet."""

    solids: list[Solid]
    floor: Floor


@dataclass
class _Surface:
    """What is needed of each hit point to light it."""

    point: Vec
    normal: Vec
    albedo: Vec
    shine: Array
    highlight: Array
    what: NDArray[np.int32]


def radiance(scene: Scene, origin: Vec, direction: Vec) -> tuple[Array, Array]:
    """Colour (ray, 3) that rays bring back, in 0 … 1, and the depth z (ray,) at which they end.

    Each ray's own light goes through the tone curve, so that the averages over pixel and aperture are of light that a
    display can show.
    """
    hit = intersect(origin, direction, scene.solids)
    surface = _surface(scene, origin, direction, hit)
    colour = _direct(scene, surface, direction, shadows=True)
    facing = np.clip(-dot(surface.normal, direction), 0, 1)
    fresnel = surface.shine + (1 - surface.shine) * (1 - facing) ** 5 * np.where(surface.shine > 0, np.float32(0.7), 0)
    index = np.flatnonzero(fresnel > 0.012)
    if index.size:
        mirrored = _mirrored(scene, surface, direction, index)
        weight = fresnel[index][:, None]
        colour[index] = colour[index] * (1 - weight) + mirrored * weight
    return _tone(colour), surface.point[2]


def _mirrored(scene: Scene, surface: _Surface, direction: Vec, index: NDArray[np.int64]) -> Array:
    """Light (ray, 3) in the mirror direction of some hits; what it shows is lit without cast shadows."""
    normal, incoming = take(surface.normal, index), take(direction, index)
    twice = 2 * dot(normal, incoming)
    out = unit(tuple(d - twice * n for d, n in zip(incoming, normal, strict=True)))  # type: ignore[arg-type]
    start = at(take(surface.point, index), normal, np.full(index.size, _LIFT, dtype=np.float32))
    hit = intersect(start, out, scene.solids, start=_LIFT)
    seen = np.flatnonzero(hit.what != NOTHING)
    light = np.stack(surroundings(out), axis=-1).astype(np.float32)
    if seen.size:
        some = Hit(hit.t[seen], hit.what[seen])
        second = _surface(scene, take(start, seen), take(out, seen), some)
        light[seen] = _direct(scene, second, take(out, seen), shadows=False)
    return light


def _surface(scene: Scene, origin: Vec, direction: Vec, hit: Hit) -> _Surface:
    point = at(origin, direction, np.where(hit.what == NOTHING, np.float32(1), hit.t))
    count = hit.t.size
    normal = [np.zeros(count, np.float32) for _ in range(3)]
    albedo = [np.zeros(count, np.float32) for _ in range(3)]
    shine, highlight = np.zeros(count, np.float32), np.ones(count, np.float32)
    for what in np.unique(hit.what):
        index = np.flatnonzero(hit.what == what)
        here = take(point, index)
        if what == FLOOR:
            n, a = _constant(here, (0, 1, 0)), scene.floor.albedo(here[0], here[2])
            shine[index], highlight[index] = _FLOOR_SHINE, _FLOOR_HIGHLIGHT
        elif what == WALL:
            n, a = _constant(here, (0, 0, -1)), wall_albedo(here[0], here[1])
        else:
            solid = scene.solids[what]
            n, a = _gradient(solid, here), solid.albedo(here)
            shine[index], highlight[index] = solid.material.shine, solid.material.highlight
        for axis in range(3):
            normal[axis][index], albedo[axis][index] = n[axis], a[axis]
    return _Surface(
        point, (normal[0], normal[1], normal[2]), (albedo[0], albedo[1], albedo[2]), shine, highlight, hit.what
    )


def _constant(like: Vec, value: tuple[float, float, float]) -> Vec:
    x, y, z = (np.full_like(like[0], v) for v in value)
    return x, y, z


def _gradient(solid: Solid, p: Vec, step: float = 4e-3) -> Vec:
    """Unit normals from four samples at a tetrahedron's corners."""
    total = [np.zeros_like(p[0]) for _ in range(3)]
    for sx, sy, sz in ((1, -1, -1), (-1, -1, 1), (-1, 1, -1), (1, 1, 1)):
        signs = (sx, sy, sz)
        moved = tuple(c + np.float32(step * s) for c, s in zip(p, signs, strict=True))
        value = solid.distance((moved[0], moved[1], moved[2]))
        for axis in range(3):
            total[axis] += value * signs[axis]
    return unit((total[0], total[1], total[2]))


def _direct(scene: Scene, surface: _Surface, direction: Vec, shadows: bool) -> Array:
    """Key and ambient light (ray, 3) that the surfaces send back along −direction."""
    key: Vec = _constant(surface.point, (_KEY[0], _KEY[1], _KEY[2]))
    facing = np.clip(dot(surface.normal, key), 0, 1)
    lit = facing * _shadow(scene.solids, surface, key, facing) if shadows else facing
    open_sky = _openness(scene.solids, surface)
    up = 0.5 + 0.5 * surface.normal[1]
    half = unit(tuple(k - d for k, d in zip(key, direction, strict=True)))  # type: ignore[arg-type]
    lobe = np.clip(dot(half, surface.normal), 0, 1) ** surface.highlight
    diffuse_share = (1 - surface.shine) ** 4  # mirrors show the studio's window instead of a lobe
    gloss = lit * lobe * surface.shine * diffuse_share * (surface.highlight + 8) / 10
    spot = np.where(surface.what == WALL, _wall_spot(surface.point), np.float32(1))
    channels = []
    for c in range(3):
        sky, bounce = (0.21, 0.24, 0.29)[c], (0.14, 0.125, 0.11)[c]
        ambient = open_sky * (sky * up + bounce * (1 - up))
        channels.append(surface.albedo[c] * spot * (ambient + _KEY_COLOUR[c] * lit) + _KEY_COLOUR[c] * gloss)
    return np.stack(channels, axis=-1).astype(np.float32)


def _wall_spot(p: Vec) -> Array:
    """The wall is brightest behind the middle and falls off softly to the corners."""
    return np.asarray(1.0 + 1.3 * np.exp(-((p[0] - 0.25) ** 2 + 1.2 * (p[1] - 0.55) ** 2) / 1.5), dtype=np.float32)


def _openness(solids: list[Solid], surface: _Surface) -> Array:
    """Share of the sky left by the solids' proxy balls, floor and wall (closed form for a ball above the horizon)."""
    result = np.ones_like(surface.point[0])
    for number, solid in enumerate(solids):
        for x, y, z, radius in solid.world_proxies:
            to = (np.float32(x) - surface.point[0], np.float32(y) - surface.point[1], np.float32(z) - surface.point[2])
            square = np.maximum(dot(to, to), np.float32(radius**2))
            cover = np.clip(dot(to, surface.normal) / np.sqrt(square) + 0.15, 0, 1) * np.float32(radius**2) / square
            result *= np.where(surface.what == number, np.float32(1), 1 - np.float32(0.85) * np.clip(cover, 0, 1))
    low = np.clip(surface.point[1] / np.float32(0.25), 0, 1)
    return np.where(surface.what == FLOOR, result, result * (0.45 + 0.55 * low)).astype(np.float32)


def _shadow(solids: list[Solid], surface: _Surface, key: Vec, facing: Array) -> Array:
    """1 in the light … 0 in full shade; the narrowest miss, seen from the point, sets the penumbra."""
    result = np.ones_like(facing)
    lit = np.flatnonzero(facing > 0)
    start = at(take(surface.point, lit), take(surface.normal, lit), np.full(lit.size, _LIFT, dtype=np.float32))
    towards = take(key, lit)
    for solid in solids:
        index, enter, leave = passing(start, towards, solid, margin=0.12)
        if index.size == 0:
            continue
        clear = _clearance(solid, take(start, index), take(towards, index), enter, leave)
        result[lit[index]] = np.minimum(result[lit[index]], clear)
    smooth = np.clip(result, 0, 1)
    return np.asarray(smooth * smooth * (3 - 2 * smooth), dtype=np.float32)


def _clearance(solid: Solid, start: Vec, towards: Vec, enter: Array, leave: Array, steps: int = 64) -> Array:
    result = np.ones_like(enter)
    live, t = np.arange(enter.size), np.maximum(enter, np.float32(0.02))
    for _ in range(steps):
        if live.size == 0:
            break
        gap = solid.distance(at(start, towards, t))
        result[live] = np.minimum(result[live], 0.5 + 0.5 * np.float32(_PENUMBRA) * gap / t)
        t = t + np.clip(np.abs(gap), np.float32(0.006), np.float32(0.12))
        keep = np.flatnonzero((t < leave) & (result[live] > 0))
        live, t, leave = live[keep], t[keep], leave[keep]
        start, towards = take(start, keep), take(towards, keep)
    return result


def _tone(light: Array) -> Array:
    """Straight to 0.6, then a soft shoulder that reaches 1 only at infinity."""
    knee = np.float32(0.6)
    over = np.maximum(light - knee, 0)
    return np.where(light < knee, np.maximum(light, 0), knee + (1 - knee) * over / (over + (1 - knee))).astype(
        np.float32
    )
