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

from holoview.targets.defocus import LightCone
from holoview.targets.scene_layers import blurred_layer, checked_depth, layer_count, split_layers
from holoview.util.errors import UserError


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
    depth = checked_depth(rgb_linear, depth_m, planes_m, pitch_m)
    cones = [cone] * len(planes_m) if isinstance(cone, LightCone) else list(cone)
    count = max(layer_count(depth, one, pitch_m) for one in dict.fromkeys(cones))
    labels, distances = split_layers(depth, layers or count)
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
        window, blurred = blurred_layer(rgb, labels, layer, kernels[layer], reach)
        for plane, over in enumerate(blurred):
            part = total[(plane, slice(None), *window)]
            part *= 1 - np.clip(over[-1], 0, 1)
            part += over
    return np.asarray(total[:, :-1] / np.maximum(total[:, -1:], np.float32(1e-6)))
