"""Targets of a bench whose eye moves: from a light field, and from a picture with depth for any place of its pupil."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.colour import xyz_to_linear_srgb
from holoview.model.eye import Eye
from holoview.model.focus import focused_planes, required_eye, with_pupil_at
from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.targets.focal_stack import Target, check_brightness
from holoview.targets.light_field import LightField, largest_step_px, render_views, see_light_field
from holoview.targets.moving_pupil import MovingPupilTarget
from holoview.targets.picture import Picture, read_picture, resize_to_cover
from holoview.targets.saturation import check_saturation, scale_saturation
from holoview.targets.target import Placement, pupil_of_eye, scene_depth
from holoview.targets.view_folder import ViewGrid

StacksAt = Callable[[Sequence[tuple[float, float]]], NDArray[np.float32]]
"""The focal stacks (place · plane, y, x, 3) that the eye of a system sees from places (y, x) of its pupil, m."""

_COARSE_PX = 2.0  # between neighbouring views: edges out of focus show such steps


def target_from_views(
    system: System,
    field: LightField,
    brightness: float = 1.0,
    *,
    planes: Sequence[float] | NDArray[np.floating] | None = None,
) -> Target:
    """The target of a light field: what the eye of a system sees of it, focused on each plane.

    field: views on the system's simulation grid. brightness: factor on linear light, positive. planes: distances (m) at
    which the stack is wanted, those on which the eye is focused when None.

    Raises UserError without an eye, for a pupil that reaches beyond the views and for views that are too few for it.
    """
    check_brightness(brightness)
    eye, plan = required_eye(system, field.source), make_plan(system)
    if field.views.shape[2:4] != plan.grid.shape:
        raise ValueError(f"views of {field.views.shape[2:4]} samples: expected the grid's {plan.grid.shape}")
    field = replace(field, eyepiece_m=eye.eyepiece_m)
    planes_m = np.asarray(focused_planes(system) if planes is None else planes, dtype=np.float64)
    pupil, laser_rgb = pupil_of_eye(system, eye, planes_m), xyz_to_linear_srgb(plan.colour_weights)
    stack = see_light_field(field, planes_m, plan.grid.pitch_m, pupil, laser_rgb)
    step_px, notes = largest_step_px(field, np.append(planes_m, field.zero_m), plan.grid.pitch_m), field.notes
    if step_px > _COARSE_PX:
        notes += (f"neighbouring views lie up to {step_px:.2g} samples apart out of focus: more of them are smoother",)
    return Target.from_stack(stack, planes_m, field.source, brightness, notes)


def views_of_picture(
    system: System,
    picture: str | os.PathLike[str] | Picture,
    placement: Placement,
    grid: ViewGrid,
    *,
    saturation: float = 1.0,
) -> LightField:
    """The light field of a picture with depth, rendered with occlusion from a grid of viewpoints with a spacing.

    picture, placement, saturation: as those of `target_for`. The views' zero disparity is at the middle plane.

    Raises UserError without an eye, and as `target_for` does.
    """
    assert grid.spacing_m is not None
    eye, source, rgb, depth_m = _scene(system, picture, placement, saturation)
    zero_m, pitch_m = float(np.median(system.planes_m)), make_plan(system).grid.pitch_m
    size = (grid.rows, grid.columns)
    field = render_views(rgb, depth_m, pitch_m, size, grid.spacing_m, grid.centre_m, zero_m, eye.eyepiece_m)
    return replace(field, source=source.source, notes=source.notes)


def moving_target(
    system: System,
    picture: str | os.PathLike[str] | Picture,
    placement: Placement,
    radius_m: float,
    brightness: float = 1.0,
    *,
    saturation: float = 1.0,
) -> StacksAt:
    """The focal stacks of a picture from any places of the pupil within a radius about that of the system's eye.

    picture, placement, brightness, saturation: as those of `target_for`. The layers of the scene are blurred once, and
    each place takes little time (`MovingPupilTarget`).

    Raises UserError without an eye, and as `target_for` does.
    """
    check_brightness(brightness)
    eye, _, rgb, depth_m = _scene(system, picture, placement, saturation)
    plan, planes_m = make_plan(system), focused_planes(system)
    rim = eye.moved_to((eye.pupil_y_m, eye.pupil_x_m + radius_m))
    here, there = (pupil_of_eye(system, one, planes_m) for one in (eye, rim))
    laser_rgb = xyz_to_linear_srgb(plan.colour_weights)
    light, pitch_m = rgb * np.float32(brightness), plan.grid.pitch_m
    scene = MovingPupilTarget(light, depth_m, planes_m, pitch_m, here, there, laser_rgb)

    def stacks_at(places: Sequence[tuple[float, float]]) -> NDArray[np.float32]:
        return np.concatenate(scene.seen_through([pupil_of_eye(system, eye.moved_to(p), planes_m) for p in places]))

    return stacks_at


def moving_target_from_views(system: System, field: LightField, brightness: float = 1.0) -> StacksAt:
    """The focal stacks of a light field from any places of the pupil; each place takes as long as a target.

    Raises UserError without an eye; for a place, as `target_from_views` does.
    """

    def stacks_at(places: Sequence[tuple[float, float]]) -> NDArray[np.float32]:
        return np.concatenate(
            [target_from_views(with_pupil_at(system, place), field, brightness).stack for place in places]
        )

    return stacks_at


def _scene(
    system: System, picture: str | os.PathLike[str] | Picture, placement: Placement, saturation: float
) -> tuple[Eye, Picture, NDArray[np.float32], float | NDArray[np.floating]]:
    """The eye of a system, the picture, and its light and depth on the simulation grid."""
    check_saturation(saturation)
    eye = required_eye(system, "target")
    source, shape = picture if isinstance(picture, Picture) else read_picture(picture), make_plan(system).grid.shape
    rgb = scale_saturation(resize_to_cover(source.rgb, shape), saturation)
    return eye, source, rgb, scene_depth(system, placement, source, shape)
