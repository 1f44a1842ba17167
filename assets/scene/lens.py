"""Two cameras: a pinhole (everything sharp, with its depth) and a thin lens with a square aperture (a focal stack).

A ray through image point p and aperture point a crosses the picture focused at depth z at p + a·(1/z − 1/z_ref). One
set of rays therefore gives the pictures at every focus. The aperture is cut into VIEWS × VIEWS cells and the stack's
planes lie evenly in 1/z, with the aperture chosen so that a cell moves by a whole number of pixels from plane to plane:
nothing is resampled. A cell is not a point: each ray's light is spread over the square that its cell's light covers on
the plane, as a lens does, so that no ghost images of the cells show.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from assets.scene.sdf import Array, Vec
from assets.scene.shade import Scene, radiance
from assets.scene.trace import FAR, NEAR, Camera, depth_code, unit

PLANES = 5
VIEWS = 9
BLUR_PER_PLANE = VIEWS / 2  # half-width, in pixels, of a point's square one plane away from its own
_REFERENCE = 2
_MARGIN = (VIEWS // 2) * _REFERENCE
_BAND = 64


def pinhole(scene: Scene, camera: Camera, samples: int = 5) -> tuple[Array, Array]:
    """The sharp picture (y, x, 3), samples² rays a pixel, and the depth code (y, x) at pixel centres, 0 … 1."""
    total = np.zeros((camera.height, camera.width, 3), dtype=np.float32)
    for dy in _strata(samples):
        for dx in _strata(samples):
            total += _view(scene, camera, (0.0, 0.0), (dx, dy))[0]
    return total / np.float32(samples**2), _view(scene, camera, (0.0, 0.0), (0.0, 0.0))[1]


def focal_stack(scene: Scene, camera: Camera) -> Array:
    """The thin lens' pictures (plane, y, x, 3), farthest focus first: a display's planes by rising distance z."""
    gather = _Gather(camera)
    cells = np.arange(VIEWS) - VIEWS // 2
    random = np.random.default_rng(3)
    offsets = [(x, y) for y in _strata(VIEWS) for x in _strata(VIEWS)]
    order = iter(random.permutation(len(offsets)))
    for v in cells:
        for u in cells:
            gather.add(_view(scene, camera, (float(u), float(v)), offsets[next(order)], _MARGIN), int(u), int(v))
    return gather.result()[::-1]


class _Gather:
    """Sums the views on every plane, kept apart by the width of the cell's footprint until the end."""

    def __init__(self, camera: Camera) -> None:
        self._shape = (camera.height, camera.width)
        self._sums = np.zeros((PLANES, PLANES, *self._shape, 4), dtype=np.float32)

    def add(self, view: tuple[Array, Array], u: int, v: int) -> None:
        """Add the picture (with its margin) seen from aperture cell (u, v), drawn as focused on the reference plane."""
        for plane in range(PLANES):
            shift = plane - _REFERENCE
            top, left = _MARGIN - v * shift, _MARGIN + u * shift
            window = slice(top, top + self._shape[0]), slice(left, left + self._shape[1])
            light = np.concatenate([view[0][window], np.ones((*self._shape, 1), dtype=np.float32)], axis=-1)
            width = np.rint(np.abs(view[1][window] * (PLANES - 1) - plane)).astype(np.int64)
            for number in range(PLANES):
                self._sums[plane, number] += light * (width == number)[..., None]

    def result(self) -> Array:
        """The pictures (plane, y, x, 3)."""
        total = np.sum([_box(self._sums[:, number], number) for number in range(PLANES)], axis=0)
        return np.asarray(total[..., :3] / total[..., 3:], dtype=np.float32)


def _box(stack: Array, width: int) -> Array:
    """Running mean of `width` pixels down and across a (plane, y, x, channel) stack, area-true for even widths too."""
    if width <= 1:
        return stack
    reach = width // 2
    kernel = np.ones(2 * reach + 1, dtype=np.float32)
    if width % 2 == 0:
        kernel[[0, -1]] = 0.5
    for axis in (1, 2):
        pad = [(0, 0)] * 4
        pad[axis] = (reach, reach)
        padded = np.pad(stack, pad)
        size = stack.shape[axis]
        parts = [padded.take(range(k, k + size), axis=axis) * w for k, w in enumerate(kernel / np.float32(width))]
        stack = np.sum(parts, axis=0, dtype=np.float32)
    return stack


def _strata(count: int) -> list[float]:
    return [(k + 0.5) / count - 0.5 for k in range(count)]


def _view(
    scene: Scene, camera: Camera, cell: tuple[float, float], offset: tuple[float, float], margin: int = 0
) -> tuple[Array, Array]:
    """Picture (y, x, 3) and depth code (y, x) from the middle of an aperture cell, focused on the reference plane.

    `offset` moves the sample inside the pixel; `margin` pixels are added on every side.
    """
    per_plane = (1 / NEAR - 1 / FAR) / (PLANES - 1)
    reference = 1 / NEAR - _REFERENCE * per_plane
    a, b = (c * camera.pixel / per_plane for c in cell)
    colours, depths = [], []
    for top in range(-margin, camera.height + margin, _BAND):
        rows: NDArray[np.int64] = np.arange(top, min(top + _BAND, camera.height + margin))
        x, y = camera.image_points(rows, margin, *offset)
        origin: Vec = (np.full_like(x, a), np.full_like(x, 1 + b), np.zeros_like(x))
        direction = unit((x - np.float32(a * reference), y - np.float32(b * reference), np.ones_like(x)))
        colour, z = radiance(scene, origin, direction)
        colours.append(colour.reshape(len(rows), -1, 3))
        depths.append(depth_code(z).reshape(len(rows), -1))
    return np.concatenate(colours), np.concatenate(depths)
