"""The room: a terrazzo floor, a lit wall with a poster, and the studio lights that glossy things reflect."""

from __future__ import annotations

import numpy as np

from assets.scene.sdf import Array, Vec

WALL_Z = 6.0
_TEXELS = 1536
_TEXTURE_SIZE = 1.5
_MORTAR = (0.40, 0.395, 0.385)
_CHIPS: tuple[tuple[float, float, float], ...] = (
    (0.46, 0.455, 0.44),
    (0.35, 0.345, 0.335),
    (0.29, 0.285, 0.28),
    (0.20, 0.20, 0.205),
    (0.52, 0.51, 0.50),
    (0.36, 0.28, 0.22),
    (0.24, 0.30, 0.31),
)
_ARCS: tuple[tuple[float, float, float], ...] = (
    (0.75, 0.04, 0.03),
    (0.88, 0.26, 0.02),
    (0.92, 0.66, 0.03),
    (0.06, 0.50, 0.10),
    (0.02, 0.36, 0.62),
    (0.10, 0.06, 0.50),
)


_WALL = tuple(
    tuple(np.float32(c) for c in channel) for channel in ((0.66, -0.56, 0.04), (0.42, -0.17, 0.04), (0.27, 0.21, 0.06))
)


class Floor:
    """Terrazzo slabs: chips of stone in a light mortar, drawn once into a repeating texture."""

    def __init__(self, seed: int = 7) -> None:
        self._texture = _terrazzo(np.random.default_rng(seed))

    def albedo(self, x: Array, z: Array) -> Vec:
        """Colour at floor points; joints between the slabs are dark and thin."""
        x, z = (np.clip(c, -500, 500).astype(np.float32) for c in (x, z))  # reflections reach far, integers don't
        scale = np.float32(_TEXELS / _TEXTURE_SIZE)
        column = np.floor(x * scale).astype(np.int32) % _TEXELS
        row = np.floor(z * scale).astype(np.int32) % _TEXELS
        r, g, b = (c[row, column] for c in self._texture)
        slab = np.float32(0.5)
        x = x + np.float32(0.19)  # no joint runs straight up the middle of the picture
        edge = np.minimum(np.abs(x / slab - np.rint(x / slab)), np.abs(z / slab - np.rint(z / slab))) * slab
        checker = (np.floor(x / slab) + np.floor(z / slab)) % 2
        dim = np.where(edge < np.float32(0.004), np.float32(0.25), np.float32(1)) * (1 - np.float32(0.5) * checker)
        return r * dim, g * dim, b * dim


def wall_albedo(x: Array, y: Array) -> Vec:
    """Colour at wall points: a smooth gradient from warm (left) to blue (right), and the poster."""
    across = np.clip((x + 1.9) / 3.8, 0, 1).astype(np.float32)
    up = np.clip(y / np.float32(1.2), 0, 1)
    ground = [start + slope * across + rise * up for start, slope, rise in _WALL]
    return _with_poster(x, y, (ground[0], ground[1], ground[2]))


def surroundings(direction: Vec) -> Vec:
    """Light (linear) from a direction that meets nothing: a grey studio with a big window and a strip lamp."""
    x, y, z = direction
    base = 0.22 + 0.30 * np.clip(y, 0, 1)
    flat = np.maximum(y, np.float32(1e-3))
    window = _soft(np.abs(x / flat + 0.95), 0.55) * _soft(np.abs(z / flat + 0.55), 0.6) * (y > 0)
    strip = _soft(np.abs(x / flat - 1.7), 0.22) * _soft(np.abs(z / flat + 0.3), 1.1) * (y > 0)
    glow = 3.4 * window + 1.6 * strip
    r, g, b = (np.asarray(base * s + glow * w, dtype=np.float32) for s, w in ((1, 1), (1.02, 0.98), (1.1, 0.94)))
    return r, g, b


def _soft(distance: Array, half: float) -> Array:
    """1 inside `half`, 0 outside, with a narrow smooth edge."""
    return np.asarray(np.clip((half - distance) / (0.08 * half) + 0.5, 0, 1), dtype=np.float32)


def _with_poster(x: Array, y: Array, ground: Vec) -> Vec:
    u, v = (x + np.float32(0.32)) / np.float32(0.31), (y - np.float32(0.66)) / np.float32(0.33)
    frame = (np.abs(u) < 1.06) & (np.abs(v) < 1.06)
    paper = (np.abs(u) < 1) & (np.abs(v) < 1)
    ring = np.hypot(u, v + np.float32(0.75)) / np.float32(0.22)
    band = np.clip(ring, 0, len(_ARCS) + 1).astype(np.int32) - 1
    arc = paper & (band >= 0) & (band < len(_ARCS)) & (v > np.float32(-0.75)) & (ring - np.floor(ring) > 0.16)
    out = []
    for channel in range(3):
        inks = np.array([ink[channel] for ink in _ARCS], dtype=np.float32)
        value = np.where(frame, np.float32(0.03), ground[channel])
        value = np.where(paper, np.float32((0.86, 0.83, 0.76)[channel]), value)
        out.append(np.where(arc, inks[np.clip(band, 0, len(_ARCS) - 1)], value).astype(np.float32))
    return out[0], out[1], out[2]


def _terrazzo(random: np.random.Generator, cells: int = 40) -> list[Array]:
    """Three (row, column) channels that repeat seamlessly: nearest-seed cells, with mortar where two seeds tie."""
    seeds = random.uniform(0.1, 0.9, (cells, cells, 2))
    kind = random.integers(0, len(_CHIPS), (cells, cells))
    tone = random.uniform(0.85, 1.1, (cells, cells))
    position = np.arange(_TEXELS) * (cells / _TEXELS)
    column, row = np.meshgrid(position, position)
    first = np.full(row.shape, np.inf)
    second, owner = first.copy(), np.zeros(row.shape, dtype=np.int64)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            i, j = np.floor(row).astype(int) + dy, np.floor(column).astype(int) + dx
            seed = seeds[i % cells, j % cells]
            distance = np.hypot(row - i - seed[..., 0], column - j - seed[..., 1])
            nearer = distance < first
            second = np.where(nearer, first, np.minimum(second, distance))
            owner = np.where(nearer, (i % cells) * cells + j % cells, owner)
            first = np.minimum(first, distance)
    mortar = second - first < 0.3
    chips = np.array(_CHIPS)[kind].reshape(-1, 3) * tone.reshape(-1, 1)
    picture = np.where(mortar[..., None], _MORTAR, chips[owner])
    return [picture[..., c].astype(np.float32) for c in range(3)]
