"""From a bench and a picture to the focal stack that is optimised for, on the bench's planes and simulation grid."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.targets.defocus import LightCone, diffraction_half_angle
from holoview.holograms.targets.focal_stack import Target, check_brightness, render_focal_stack
from holoview.holograms.targets.framing import FILL, Framing
from holoview.holograms.targets.light_field import ViewingPupil, render_through_pupil
from holoview.holograms.targets.picture import (
    Picture,
    check_saturation,
    depth_notes,
    read_depth,
    read_picture,
    resize_to_cover,
    scale_saturation,
)
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model.eye import Eye
from holoview.light.model.focus import focused_planes
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

_STACK_BYTES = 36  # of a sample of a plane while a focal stack is made


@dataclass(frozen=True)
class Placement:
    """Where a picture stands in front of the viewer: at one distance, or in depth.

    Distances are those of planes, z behind the last modulator. The viewer looks against the light: larger is nearer.

    at_m: one distance, m; the middle plane of the system when None.
    depth: a depth map, an image file of the picture's size; 0 (black) is nearest to the viewer and 1 (white) farthest.
    Not with `at_m`.
    nearest_m, farthest_m: distances z of 0 and 1 in the map, m, `nearest_m` the larger; the largest and the smallest of
    the system's planes when None.

    framing: how a picture of another aspect is placed on the modulators.

    `target_for` checks the distances against the planes of the system.

    >>> import holoview as hv
    >>> hv.Placement(at_m=8e-3)
    Placement(at_m=0.008, depth=None, nearest_m=None, farthest_m=None)
    """

    at_m: float | None = None
    depth: str | os.PathLike[str] | None = None
    nearest_m: float | None = None
    farthest_m: float | None = None
    framing: Framing = field(default=FILL, repr=False)


def target_for(
    system: System,
    picture: str | os.PathLike[str] | Picture,
    placement: Placement = Placement(),
    brightness: float = 1.0,
    *,
    saturation: float = 1.0,
    space: str = "srgb",
    planes: Sequence[float] | NDArray[np.floating] | None = None,
    pupil: ViewingPupil | None = None,
) -> Target:
    """The light of a picture that an observer of a display should see at each plane, with natural defocus.

    Away from its distance the picture is blurred by the cone of light that reaches an image point. The cone's half
    angle is that of the first diffraction order of the modulator at the middle wavelength, or of the stops of relay 2
    where they are smaller. With an eye, or a `pupil`, it is the cone of that pupil alone.

    system: the display, whose planes and simulation grid the stack has.
    picture: an image file (PNG, JPEG, TIFF, EXR), or a `targets.picture.Picture`. It is scaled to cover the
    grid.
    placement: the distance or the depth map of the picture.
    brightness: factor on linear light, positive.
    saturation: factor on the picture's chroma in CIE LCHuv, before it is blurred.
    space: the colour space of a float file, "srgb" or "xyz"; a `Picture` has been converted already.
    planes: distances (m) at which the stack is wanted; when None those of the system, or on which its eye is focused.
    Depth range and layers stay those of the system's planes, so that planes between them show the same scene.
    pupil: of the eye that sees the target, a `targets.moving_pupil.ViewingPupil`; that of the system's eye,
    with its chromatic aberration, when None.

    Returns a `Target`: `stack` is (plane, y, x, 3) linear sRGB for `iterate`. Raises UserError for files that can't be
    used, a distance outside the system's planes, a depth map of another size, and factors out of range; ValueError for
    a `Picture` with another `space`, and for planes that aren't a list of distances.

    Limits: surfaces are matt and opaque, and hidden parts are filled in from their surroundings.

    >>> import holoview as hv
    >>> from PIL import Image
    >>> Image.new("RGB", (48, 32), "orange").save("orange.png")
    >>> system = hv.load("holochrome-8").with_(shape=[16, 24], planes=["5 mm", "10 mm"])
    >>> hv.target_for(system, "orange.png", hv.Placement(at_m=5e-3)).stack.shape
    (2, 32, 48, 3)
    """
    check_brightness(brightness)
    check_saturation(saturation)
    if isinstance(picture, Picture) and space != "srgb":
        raise ValueError(f"space {space!r} with a Picture, which is linear sRGB: give it to read_picture")
    source = picture if isinstance(picture, Picture) else read_picture(picture, space)
    plan = make_plan(system)
    grid = plan.grid
    count = len(plan.planes_m) if planes is None else np.size(planes)
    needed = count * math.prod(grid.shape) * _STACK_BYTES
    require_memory("target", needed, remedy="lower shape, upsample or the number of planes")
    depth_m = scene_depth(system, placement, source, grid.shape)
    rgb = scale_saturation(resize_to_cover(source.rgb, grid.shape, placement.framing), saturation)
    planes_m = np.asarray(focused_planes(system) if planes is None else planes, dtype=np.float64)
    if pupil is None and system.eye is not None:
        pupil = pupil_of_eye(system, system.eye, planes_m)
    stack = _render(plan, rgb, depth_m, planes_m, pupil)
    return Target.from_stack(stack, planes_m, source.source, brightness, _notes(source, placement, grid.shape))


def _notes(source: Picture, placement: Placement, shape: tuple[int, int]) -> tuple[str, ...]:
    """What was done with a picture and its depth map on samples of a shape (y, x)."""
    placed = placement.framing.describe(source.rgb.shape[:2], shape)
    own = (f"another aspect than the bench's {shape[1]} × {shape[0]} samples; {placed}",) if placed else ()
    return (*source.notes, *(() if placement.depth is None else depth_notes(placement.depth)), *own)


def _render(
    plan: Plan,
    rgb: NDArray[np.float32],
    depth_m: float | NDArray[np.floating],
    planes_m: NDArray[np.float64],
    pupil: ViewingPupil | None,
) -> NDArray[np.float32]:
    """The focal stack (plane, y, x, 3) of a picture, through a pupil or through the stops of the bench."""
    if pupil is None:
        return render_focal_stack(rgb, depth_m, planes_m, plan.grid.pitch_m, _blur_cone(plan.nominal))
    laser_rgb = xyz_to_linear_srgb(plan.colour_weights)
    return render_through_pupil(rgb, depth_m, planes_m, plan.grid.pitch_m, pupil, laser_rgb)


def pupil_of_eye(system: System, eye: Eye, planes_m: NDArray[np.float64]) -> ViewingPupil:
    """The pupil through which an eye sees a target, focused on planes (plane,) at its reference wavelength.

    Its cylinder, its Zernike terms and the Stiles–Crawford effect are left out.
    """
    shift_m = eye.focus_shift_m(system.wavelengths_m)
    return ViewingPupil(
        eye.pupil_na(system.field_m),
        eye.pupil_centre_na,
        planes_m[:, None] + shift_m if shift_m.any() else None,
        np.array([eye.image_shift_m(float(shift)) for shift in shift_m]),
    )


def scene_depth(
    system: System, placement: Placement, source: Picture, shape: tuple[int, int]
) -> float | NDArray[np.floating]:
    """Distance (m) of a picture, or of each sample of a simulation grid of `shape` (y, x).

    Raises UserError as `target_for` does.
    """
    first, last = float(system.planes_m.min()), float(system.planes_m.max())
    if placement.depth is None:
        at_m = float(np.median(system.planes_m)) if placement.at_m is None else placement.at_m
        _check_inside(at_m, first, last, "the picture's distance")
        return at_m
    if placement.at_m is not None:
        raise UserError(str(placement.depth), "a depth map and one distance", expected="one of them")
    depth = read_depth(placement.depth)
    if depth.shape != source.rgb.shape[:2]:
        sizes = [f"{columns} x {rows}" for rows, columns in (depth.shape, source.rgb.shape[:2])]
        raise UserError(str(placement.depth), f"{sizes[0]} pixels", expected=f"the picture's size, {sizes[1]}")
    nearest = last if placement.nearest_m is None else placement.nearest_m
    farthest = first if placement.farthest_m is None else placement.farthest_m
    _check_inside(nearest, first, last, "the nearest depth")
    _check_inside(farthest, first, last, "the farthest depth")
    if nearest < farthest:
        raise UserError(
            "depth range",
            f"near at {units.format_rounded(nearest, 'mm')}, far at {units.format_rounded(farthest, 'mm')}",
            expected="near at the larger distance: the viewer looks against the light",
            remedy="exchange the two",
        )
    return nearest + resize_to_cover(depth, shape, placement.framing).astype(np.float64) * (farthest - nearest)


def _check_inside(at_m: float, first: float, last: float, what: str) -> None:
    if not first <= at_m <= last:
        raise UserError(
            what,
            units.format_rounded(at_m, "mm"),
            expected=f"inside the planes, {units.format_rounded(first, 'mm')} to {units.format_rounded(last, 'mm')}",
            remedy="move it, or change planes",
        )


def _blur_cone(system: System) -> LightCone:
    """An image point's light cone: the first order of the finest pixels, or a smaller stop."""
    middle_m, way = float(np.median(system.wavelengths_m)), system.way
    angle, relay = diffraction_half_angle(middle_m, way.finest_m), way.relays[way.last]
    if relay.square is not None:
        angle = min(angle, math.asin(relay.square.half_side_sine(middle_m, way.orders_m[way.last])))
    if relay.iris_na is not None and relay.iris_na < math.sin(angle):
        return LightCone(math.tan(math.asin(relay.iris_na)), "disc")
    return LightCone(math.tan(angle))
