"""What an eye should see at each plane: a picture with depth, naturally out of focus everywhere but where it belongs.

`picture_stack` makes such a focal stack from one picture; stacks.py reads one that was rendered elsewhere. `Target` is
either with its planes: what the optimiser aims at.

A picture with a depth map is cut into layers of nearly equal depth. On each plane they are laid over each other from
far to near, each blurred by its own distance, its blurred coverage hiding what lies behind:

    light ← light·(1 − K∗m) + K∗(m·rgb)        coverage ← coverage·(1 − K∗m) + K∗m        result = light / coverage

Where a nearer layer hides a farther one, the farther is continued beneath it with its neighbouring colours, because a
blurred edge is translucent and a lens looks round it. Dividing by the coverage makes up for what is still missing.

Limits: coverages of different layers are taken as independent, surfaces as matt (a reflection blurs with the mirror,
not with what it shows), and hidden things are guessed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from holoview.targets.defocus import Aperture, FftConvolver, blur_kernel, blur_radius_px, kernel_share_in_frame
from holoview.util.errors import UserError

MAX_LAYERS = 24
_LAYER_STEP_PX = 1.0  # half a pixel either way is no blur; finer cuts are further from a real lens, seams add up


@dataclass(frozen=True)
class Target:
    """A focal stack to aim at.

    `stack` (plane, y, x, 3) float32 linear sRGB with `brightness` already applied, `planes_m` the planes' distances,
    `source` what it was made from, in words, `notes` what was done to it that a person should know.

    Raises UserError when the number of pictures and of planes differ, ValueError for other shapes.
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
        """The target that shows `stack` at `brightness`, a factor on linear light. UserError unless it is above 0."""
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
    half_angle_rad: float,
    aperture: Aperture = "square",
    layers: int | None = None,
) -> NDArray[np.float32]:
    """Natural incoherent defocus of one picture, (plane, y, x, 3) float32.

    `rgb_linear` (y, x, 3) linear light; `depth_m` where it lies, one distance or one per pixel (y, x), on the same axis
    as `planes_m` (n,), the smaller the nearer: near layers hide far ones; `pitch_m` of the picture's pixels;
    `half_angle_rad` of the light cone. `layers` at most; by default as many as keep every depth within half a pixel
    of blur of its layer, but no more than 24.

    At the borders the missing light from outside is made up by dividing by the share of the blur inside the frame, so
    that an even picture stays even and the borders don't darken.

    Raises ValueError for wrong shapes, an unknown aperture, or numbers that aren't finite (positive where due).
    """
    depth = _checked_depth(rgb_linear, depth_m, planes_m, pitch_m, half_angle_rad, aperture)
    planes = np.asarray(planes_m, dtype=np.float64)
    labels, distances = _split_layers(depth, layers or _layer_count(depth, half_angle_rad, pitch_m))
    shape = labels.shape
    radii = np.array([[blur_radius_px(z - d, half_angle_rad, pitch_m) for z in planes] for d in distances])
    reach = max(math.ceil(float(radii.max()) - 0.5), 0)
    total = np.zeros((len(planes), 4, *shape), dtype=np.float32)
    for layer in reversed(range(len(distances))):
        window = _bounding_window(labels == layer, 2 * reach + 2)
        content = _inpaint_occluded(rgb_linear[window], labels[window], layer, 2 * reach + 1)
        picture = FftConvolver(content, reach)
        for plane, radius in enumerate(radii[layer]):
            blur = blur_kernel(float(radius), aperture)
            over = picture.convolve(blur) / kernel_share_in_frame(blur, (shape[0], shape[1]), window)
            part = total[(plane, slice(None), *window)]
            part *= 1 - np.clip(over[3], 0, 1)
            part += over
    light = total[:, :3] / np.maximum(total[:, 3:], np.float32(1e-6))
    return np.ascontiguousarray(np.moveaxis(light, 1, -1))


def _checked_depth(
    rgb: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: Sequence[float] | NDArray[np.floating],
    pitch_m: float,
    half_angle_rad: float,
    aperture: Aperture,
) -> NDArray[np.float64]:
    """The depth per pixel (y, x), all arguments being sound."""
    if rgb.ndim != 3 or rgb.shape[-1] != 3 or rgb.size == 0:
        raise ValueError(f"picture {rgb.shape}: expected (y, x, 3)")
    depth = np.asarray(depth_m, dtype=np.float64)
    if depth.shape not in ((), rgb.shape[:2]):
        raise ValueError(f"depth {depth.shape}: expected one number or {rgb.shape[:2]} as the picture")
    planes = np.asarray(planes_m, dtype=np.float64)
    if planes.ndim != 1 or planes.size == 0 or not (np.isfinite(planes).all() and np.isfinite(depth).all()):
        raise ValueError("planes and depths: expected finite distances in metres, at least one plane")
    if not (pitch_m > 0 and 0 <= half_angle_rad < math.pi / 2):
        raise ValueError(f"pitch {pitch_m} m, half angle {half_angle_rad} rad: expected > 0 and 0 … π/2")
    if aperture not in ("square", "disc"):
        raise ValueError(f"aperture {aperture!r}: expected 'square' or 'disc'")
    return np.broadcast_to(depth, rgb.shape[:2])


def _layer_count(depth: NDArray[np.float64], half_angle_rad: float, pitch_m: float) -> int:
    spread_px = blur_radius_px(float(np.ptp(depth)), half_angle_rad, pitch_m)
    return min(max(math.ceil(spread_px / _LAYER_STEP_PX), 1), MAX_LAYERS)


def _split_layers(depth: NDArray[np.float64], count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Layer (y, x) of each pixel, 0 nearest, and each layer's mean depth; layers without pixels are left out."""
    low, spread = float(depth.min()), float(np.ptp(depth))
    if spread == 0:
        return np.zeros(depth.shape, dtype=np.int64), np.array([low])
    slot = np.minimum(((depth - low) * (count / spread)).astype(np.int64), count - 1)
    used, labels = np.unique(slot, return_inverse=True)
    labels = labels.reshape(depth.shape)
    sums = np.bincount(labels.ravel(), weights=depth.ravel(), minlength=len(used))
    return labels, sums / np.bincount(labels.ravel(), minlength=len(used))


def _bounding_window(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """The smallest rectangle about the mask, widened by `margin` inside the frame."""
    spans = []
    for axis, size in enumerate(mask.shape):
        hit = np.flatnonzero(mask.any(axis=1 - axis))
        spans.append(slice(max(int(hit[0]) - margin, 0), min(int(hit[-1]) + 1 + margin, size)))
    return spans[0], spans[1]


def _inpaint_occluded(
    rgb: NDArray[np.float32], labels: NDArray[np.int64], layer: int, reach: int
) -> NDArray[np.float32]:
    """The layer's light and coverage (4, y, x), continued by up to `reach` pixels beneath the nearer layers.

    A hidden pixel belongs to whichever of this and the farther layers is seen nearest to it, and takes the colour found
    there. Pixels that touch a much nearer layer don't lend their colour: antialiasing has mixed the nearer one into it.
    """
    seen = labels == layer
    behind = labels >= layer
    source, owned = np.indices(labels.shape), seen
    if not behind.all():
        mixed = ndimage.binary_dilation(labels < layer - 1, np.ones((3, 3), dtype=bool))
        lenders = behind & ~mixed if (seen & ~mixed).any() else behind
        distance, nearest = ndimage.distance_transform_edt(~lenders, return_indices=True)
        source = np.where(behind, source, nearest)
        owned = seen | (~behind & (labels[tuple(source)] == layer) & (distance <= reach))
    light = np.where(owned[..., None], rgb[tuple(source)], np.float32(0))
    return np.stack([*np.moveaxis(light, -1, 0), owned.astype(np.float32)])
