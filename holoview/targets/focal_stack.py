"""Renders a focal stack with incoherent defocus from a picture and a depth map (layers, occlusion, inpainting).

The viewer looks against the light, so that what has the larger distance z behind the last modulator is nearer to the
viewer, and occludes what has a smaller one.

The picture is cut into layers of nearly equal depth. On each plane they are composited from far to near; each layer's
light and mask m are convolved with the blur kernel K of its distance, and its blurred mask occludes what lies behind:

    light ← light·(1 − K∗m) + K∗(m·rgb)        coverage ← coverage·(1 − K∗m) + K∗m        result = light / coverage

Where a nearer layer occludes a farther one, the farther one is inpainted beneath it from its neighbourhood, because a
blurred edge is translucent. The division by the coverage compensates for light that is still missing.

Limits: the masks of different layers count as statistically independent, surfaces as matt (a reflection is blurred by
the mirror's distance, not by that of what it shows), and occluded parts of the scene are guessed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.targets.defocus import FftConvolver, LightCone, kernel_share_in_frame
from holoview.util.errors import UserError

MAX_LAYERS = 24
_LEAST_SHARE = np.float32(1e-3)  # less occurs only in the margin of a cone off the axis, which is cut off
_LAYER_STEP_PX = (
    1.0  # change of blur radius, or of shift, from layer to layer: finer layers only add errors at their seams
)


@dataclass(frozen=True)
class Target:
    """The focal stack that a hologram is optimised for.

    stack: (plane, y, x, 3) float32 linear sRGB with `brightness` already applied. planes_m: distances of the planes.
    source: what it was made from, in words. notes: what was changed on the way, for the user.
    Raises UserError when the numbers of pictures and of planes differ, ValueError for other shapes.
    """

    stack: NDArray[np.float32]
    planes_m: tuple[float, ...]
    source: str
    brightness: float = 1.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.stack.ndim != 4 or self.stack.shape[-1] != 3:
            raise ValueError(f"stack {self.stack.shape}: expected (plane, y, x, 3)")
        if len(self.stack) != len(self.planes_m):
            raise UserError(
                self.source,
                f"has {len(self.stack)} pictures",
                expected=f"one for each of the {len(self.planes_m)} planes",
            )

    @classmethod
    def from_stack(
        cls,
        stack: NDArray[np.float32],
        planes_m: Sequence[float] | NDArray[np.floating],
        source: str,
        brightness: float = 1.0,
        notes: tuple[str, ...] = (),
    ) -> Target:
        """The target of `stack` times `brightness`, a factor on linear light. UserError unless it is positive."""
        check_brightness(brightness)
        scaled = np.asarray(stack, dtype=np.float32) * np.float32(brightness)
        return cls(scaled, tuple(float(z) for z in planes_m), source, brightness, notes)


def check_brightness(brightness: float) -> None:
    """Raises UserError for a factor on linear light that isn't finite and positive."""
    if not (math.isfinite(brightness) and brightness > 0):
        raise UserError("brightness", f"{brightness:g}", expected="a positive number", remedy="1 changes nothing")


def render_focal_stack(
    rgb_linear: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    cone: LightCone | Sequence[LightCone],
    layers: int | None = None,
) -> NDArray[np.float32]:
    """The focal stack of a picture in incoherent light, (plane, y, x, 3) float32.

    rgb_linear: (y, x, 3) linear light. depth_m: distance z of the picture or of each pixel (y, x) behind the last
    modulator; larger is nearer to the viewer. planes_m: distances z (n,) of the planes. pitch_m: of the picture's
    pixels. cone: of the light that reaches an image point; one for each plane, if they differ.
    layers: greatest number of layers. By default as many as keep blur radius and shift of each depth within half a
    pixel of its layer's, but at most 24.

    Near the borders the result is divided by the fraction of the kernel inside the picture, so that an even picture
    stays even and the borders don't darken. For a cone off the axis, the picture is continued by its outermost pixels.

    Raises ValueError for wrong shapes, or numbers that aren't finite (positive where due).
    """
    depth = _checked_depth(rgb_linear, depth_m, planes_m, pitch_m)
    cones = [cone] * len(planes_m) if isinstance(cone, LightCone) else list(cone)
    count = max(_layer_count(depth, one, pitch_m) for one in dict.fromkeys(cones))
    labels, distances = _split_layers(depth, layers or count)
    cones_at = list(zip(cones, np.asarray(planes_m, dtype=np.float64).tolist(), strict=True))
    kernels = [[one.kernel(z - d, pitch_m) for one, z in cones_at] for d in distances.tolist()]
    shifts = [one.shift_px(z - d, pitch_m) for one, z in cones_at for d in distances.tolist()]
    margin = max(math.ceil(abs(shift)) for pair in shifts for shift in pair)
    if margin:
        rgb_linear = np.pad(rgb_linear, ((margin, margin), (margin, margin), (0, 0)), mode="edge")
        labels = np.pad(labels, margin, mode="edge")
    light = _composite_layers(rgb_linear, labels, kernels)
    inside = slice(margin, -margin or None)
    return np.ascontiguousarray(np.moveaxis(light[:, :, inside, inside], 1, -1))


def _composite_layers(
    rgb: NDArray[np.float32], labels: NDArray[np.int64], kernels: Sequence[Sequence[NDArray[np.float64]]]
) -> NDArray[np.float32]:
    """The light (plane, channel, y, x) of layers that occlude each other. kernels: of each layer, on each plane."""
    shape = (labels.shape[0], labels.shape[1])
    reach = max(len(kernel) // 2 for layer in kernels for kernel in layer)
    total = np.zeros((len(kernels[0]), rgb.shape[-1] + 1, *shape), dtype=np.float32)
    for layer in reversed(range(len(kernels))):
        window = _bounding_window(labels == layer, 2 * reach + 2)
        content = _inpaint_occluded(rgb[window], labels[window], layer, 2 * reach + 1)
        picture = FftConvolver(content, reach)
        for plane, blur in enumerate(kernels[layer]):
            share = kernel_share_in_frame(blur, shape, window)
            over = picture.convolve(blur) / np.maximum(share, _LEAST_SHARE)
            part = total[(plane, slice(None), *window)]
            part *= 1 - np.clip(over[-1], 0, 1)
            part += over
    return np.asarray(total[:, :-1] / np.maximum(total[:, -1:], np.float32(1e-6)))


def _checked_depth(
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


def _layer_count(depth: NDArray[np.float64], cone: LightCone, pitch_m: float) -> int:
    range_m = float(np.ptp(depth))
    range_px = max(cone.radius_px(range_m, pitch_m), *map(abs, cone.shift_px(range_m, pitch_m)))
    return min(max(math.ceil(range_px / _LAYER_STEP_PX), 1), MAX_LAYERS)


def _split_layers(depth: NDArray[np.float64], count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The layer of each pixel (y, x), 0 nearest (largest z), and each layer's mean depth; empty ones are left out."""
    nearest, depth_range = float(depth.max()), float(np.ptp(depth))
    if depth_range == 0:
        return np.zeros(depth.shape, dtype=np.int64), np.array([nearest])
    bins = np.minimum(((nearest - depth) * (count / depth_range)).astype(np.int64), count - 1)
    used, labels = np.unique(bins, return_inverse=True)
    labels = labels.reshape(depth.shape)
    sums = np.bincount(labels.ravel(), weights=depth.ravel(), minlength=len(used))
    return labels, sums / np.bincount(labels.ravel(), minlength=len(used))


def _bounding_window(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
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
