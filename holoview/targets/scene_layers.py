"""A picture with depth as layers of nearly equal depth, continued beneath those that are nearer to the viewer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from holoview.targets.defocus import FftConvolver, LightCone, kernel_share_in_frame

MAX_LAYERS = 24
_LAYER_STEP_PX = (
    1.0  # change of blur radius, or of shift, from layer to layer: finer layers only add errors at their seams
)
_LEAST_SHARE = np.float32(1e-3)  # less occurs only in the margin of a cone off the axis, which is cut off

Window = tuple[slice, slice]


def checked_depth(
    rgb: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
) -> NDArray[np.float64]:
    """The depth of each pixel (y, x). Raises ValueError for arguments that `render_focal_stack` refuses."""
    if rgb.ndim != 3 or rgb.shape[-1] != 3 or rgb.size == 0:
        raise ValueError(f"picture {rgb.shape}: expected (y, x, 3)")
    depth = np.asarray(depth_m, dtype=np.float64)
    if depth.shape not in ((), rgb.shape[:2]):
        raise ValueError(f"depth {depth.shape}: expected one number or {rgb.shape[:2]} as the picture")
    planes = np.asarray(planes_m, dtype=np.float64)
    if planes.ndim != 1 or planes.size == 0 or not (np.isfinite(planes).all() and np.isfinite(depth).all()):
        raise ValueError("planes and depths: expected finite distances in metres, at least one plane")
    if not pitch_m > 0:
        raise ValueError(f"pitch {pitch_m} m: expected > 0")
    return np.broadcast_to(depth, rgb.shape[:2])


def layer_count(depth: NDArray[np.float64], cone: LightCone, pitch_m: float) -> int:
    """Layers that keep blur radius and shift of each depth (y, x) within half a sample of its layer's, at most 24."""
    range_m = float(np.ptp(depth))
    range_px = max(cone.radius_px(range_m, pitch_m), *map(abs, cone.shift_px(range_m, pitch_m)))
    return min(max(math.ceil(range_px / _LAYER_STEP_PX), 1), MAX_LAYERS)


def split_layers(depth: NDArray[np.float64], count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The layer of each pixel (y, x), 0 nearest (largest z), and each layer's mean depth; empty ones are left out."""
    nearest, depth_range = float(depth.max()), float(np.ptp(depth))
    if depth_range == 0:
        return np.zeros(depth.shape, dtype=np.int64), np.array([nearest])
    bins = np.minimum(((nearest - depth) * (count / depth_range)).astype(np.int64), count - 1)
    used, labels = np.unique(bins, return_inverse=True)
    labels = labels.reshape(depth.shape)
    sums = np.bincount(labels.ravel(), weights=depth.ravel(), minlength=len(used))
    return labels, sums / np.bincount(labels.ravel(), minlength=len(used))


def blurred_layer(
    rgb: NDArray[np.float32],
    labels: NDArray[np.int64],
    layer: int,
    kernels: Sequence[NDArray[np.float64]],
    reach: int,
) -> tuple[Window, Iterator[NDArray[np.float32]]]:
    """The window (y, x) of a layer, and there its light and coverage (4, y, x), blurred by each kernel in turn.

    rgb: (y, x, 3). labels: (y, x) the layer of each pixel. reach: the largest radius of all layers' kernels.
    """
    window = _bounding_window(labels == layer, 2 * reach + 2)
    content = _inpaint_occluded(rgb[window], labels[window], layer, 2 * reach + 1)
    picture, shape = FftConvolver(content, reach), (labels.shape[0], labels.shape[1])

    def blur(kernel: NDArray[np.float64]) -> NDArray[np.float32]:
        share = kernel_share_in_frame(kernel, shape, window)
        return np.asarray(picture.convolve(kernel) / np.maximum(share, _LEAST_SHARE))

    return window, map(blur, kernels)


def _bounding_window(mask: NDArray[np.bool_], margin: int) -> Window:
    """The bounding box of the mask, widened by `margin` but not beyond the image."""
    spans = []
    for axis, size in enumerate(mask.shape):
        occupied = np.flatnonzero(mask.any(axis=1 - axis))
        spans.append(slice(max(int(occupied[0]) - margin, 0), min(int(occupied[-1]) + 1 + margin, size)))
    return spans[0], spans[1]


def _inpaint_occluded(
    rgb: NDArray[np.float32], labels: NDArray[np.int64], layer: int, reach: int
) -> NDArray[np.float32]:
    """The layer's light and mask (4, y, x), continued by up to `reach` pixels beneath the nearer layers.

    An occluded pixel takes the colour of the nearest visible pixel of this or a farther layer, and belongs to the
    layer of that pixel. Visible pixels next to a much nearer layer aren't used as sources, because antialiasing has
    mixed the nearer colour into them.
    """
    from scipy import ndimage  # slow start: a picture needs it, and most programs that can open one don't

    visible = labels == layer
    not_nearer = labels >= layer
    source, mask = np.indices(labels.shape), visible
    if not not_nearer.all():
        mixed = ndimage.binary_dilation(labels < layer - 1, np.ones((3, 3), dtype=bool))
        usable = not_nearer & ~mixed if (visible & ~mixed).any() else not_nearer
        distance, nearest = ndimage.distance_transform_edt(~usable, return_indices=True)
        source = np.where(not_nearer, source, nearest)
        mask = visible | (~not_nearer & (labels[tuple(source)] == layer) & (distance <= reach))
    light = np.where(mask[..., None], rgb[tuple(source)], np.float32(0))
    return np.stack([*np.moveaxis(light, -1, 0), mask.astype(np.float32)])
