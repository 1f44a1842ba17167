"""A picture with depth as it is seen from any place of a pupil in the eyebox: blurred once, then only moved.

A pupil that moves by Δc (as a slope) moves the blurred image of what stands at d, on the plane z, by (z − d)·Δc, and
doesn't change the blur itself. The layers of the scene are therefore blurred once, for the middle of the places, and
joined to groups that move together within a sample. From another place, each group is moved by whole samples, and
they are composited from near to far:

    light ← light + t·L_g        t ← t·(1 − K∗m_g)        result = light / (1 − t)

A group that is in focus isn't moved at all, and one that is moved by a sample is blurred by more where the pupil is
wider than its path, so that whole samples are enough.

With a focus for each wavelength, the parts of an eye's picture move together over the wavelengths if its lens moves
with its pupil. They are then added first, M_λ·L for the light and M_λ·1 for the coverage (`colour_shares`): a group
hides the groups behind it as it would hide white light. Where each wavelength moves on its own, each is composited on
its own, which multiplies the time by their number.

`moving_target` makes the targets of a bench whose eye moves: from a light field, or from a picture with depth.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.targets.defocus import (
    LayerBlur,
    LightCone,
    Window,
    checked_depth,
    layer_count,
    split_layers,
)
from holoview.holograms.targets.focal_stack import Target, check_brightness
from holoview.holograms.targets.light_field import (
    LightField,
    ViewGrid,
    ViewingPupil,
    colour_shares,
    largest_step_px,
    render_views,
    see_light_field,
)
from holoview.holograms.targets.picture import (
    Picture,
    check_saturation,
    read_picture,
    resize_to_cover,
    scale_saturation,
)
from holoview.holograms.targets.target import Placement, pupil_of_eye, scene_depth
from holoview.light.colour import xyz_to_linear_srgb
from holoview.light.model.eye import Eye
from holoview.light.model.focus import focused_planes, required_eye, with_pupil_at
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System

_ROUNDING = 1e-9  # of a sample
_LEAST_COVERAGE = np.float32(1e-6)
_STRIP_NUMBERS = 1 << 16  # composited at a time, so that all groups' parts fit a core's second-level cache


@dataclass(frozen=True, eq=False)
class _Beam:
    """Wavelengths that move together. foci: indices of their pictures for each plane, (plane, wavelength).

    to_beam (wavelength, channel, 3): the contribution of their light to the beam's channels. covers (wavelength,
    channel): the same for coverage. to_rgb (3, channel): linear sRGB of the channels.
    """

    wavelengths: tuple[int, ...]
    to_beam: NDArray[np.float32]
    covers: NDArray[np.float32]
    to_rgb: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Group:
    """Layers that move together. light, clear: (plane, channel, y, x) in `window`; clear is the share that passes."""

    depth_m: float
    window: Window
    light: NDArray[np.float32]
    clear: NDArray[np.float32]


class MovingPupilTarget:
    """The focal stacks of a picture (y, x, 3) for a pupil that moves over a disc in the eyebox.

    depth_m: distance z of each pixel (y, x) or of all. planes_m: distances (n,) of the planes. pitch_m: of the
    picture's samples. pupil: at the middle of the disc. farthest: the same, moved to the rim. laser_rgb: (wavelength,
    3) linear sRGB of each laser at unit intensity.

    Raises ValueError as `render_focal_stack` does.
    """

    def __init__(
        self,
        rgb_linear: NDArray[np.float32],
        depth_m: float | NDArray[np.floating],
        planes_m: Sequence[float] | NDArray[np.floating],
        pitch_m: float,
        pupil: ViewingPupil,
        farthest: ViewingPupil,
        laser_rgb: NDArray[np.float64],
    ) -> None:
        depth = checked_depth(rgb_linear, depth_m, planes_m, pitch_m)
        self._pupil, self._pitch_m, self._shape = pupil, pitch_m, rgb_linear.shape[:2]
        planes = np.asarray(planes_m, dtype=np.float64)
        self._focus_m = np.repeat(planes[:, None], 1, axis=1) if pupil.focus_m is None else pupil.focus_m
        count = max(layer_count(depth, pupil.cone(), pitch_m), layer_count(depth, self._difference(farthest), pitch_m))
        labels, distances = split_layers(depth, count)
        self._beams = self._make_beams(farthest, laser_rgb)
        groups = self._group_layers(distances, farthest)
        farthest_px = [
            abs(px)
            for d in distances.tolist()
            for plane, λ in np.ndindex(*self._focus_m.shape)
            for px in (*self._base_shift(d, plane, λ), math.hypot(*self._shift(farthest, d, plane, λ)))
        ]
        self._margin = math.ceil(max(farthest_px))
        frame = np.pad(rgb_linear, ((self._margin, self._margin), (self._margin, self._margin), (0, 0)), mode="edge")
        self._groups = self._blur(frame, np.pad(labels, self._margin, mode="edge"), distances, groups)

    def seen_through(self, pupils: Sequence[ViewingPupil]) -> NDArray[np.float32]:
        """The focal stacks (pupil, plane, y, x, 3) float32 through the same pupil at other places of the disc."""
        inside = slice(self._margin, self._margin + self._shape[0]), slice(self._margin, self._margin + self._shape[1])
        stacks = np.zeros((len(pupils), len(self._focus_m), *self._shape, 3), dtype=np.float32)
        for beam, groups in zip(self._beams, self._groups, strict=True):
            for plane in range(len(self._focus_m)):
                for stack, seen in zip(stacks, self._composite(pupils, beam, groups, plane), strict=True):
                    stack[plane] += np.moveaxis(seen[:, *inside], 0, -1) @ beam.to_rgb.T
        return stacks

    # --- where things are seen --------------------------------------------------------------------------------------

    def _base_shift(self, depth_m: float, plane: int, wavelength: int) -> tuple[float, float]:
        """Where a point is seen through the pupil in the middle, beside where it is, (y, x) samples."""
        distance_m = float(self._focus_m[plane, wavelength]) - depth_m
        return self._pupil.cone(wavelength).shift_px(distance_m, self._pitch_m)

    def _shift(self, pupil: ViewingPupil, depth_m: float, plane: int, wavelength: int) -> tuple[float, float]:
        """How much further than that it is seen through the pupil at another place, (y, x) samples."""
        distance_m = float(self._focus_m[plane, wavelength]) - depth_m
        (y, x), (y0, x0) = (one.cone(wavelength).shift_px(distance_m, self._pitch_m) for one in (pupil, self._pupil))
        return y - y0, x - x0

    def _difference(self, pupil: ViewingPupil) -> LightCone:
        """A cone without width whose slope is how much a pupil has moved."""
        (y, x), (y0, x0) = pupil.centre, self._pupil.centre
        return LightCone(0.0, "disc", (math.hypot(y - y0, x - x0), 0.0))

    # --- what is kept -----------------------------------------------------------------------------------------------

    def _make_beams(self, farthest: ViewingPupil, laser_rgb: NDArray[np.float64]) -> list[_Beam]:
        """One beam of all wavelengths if they move together, else a beam for each."""
        count = self._focus_m.shape[1]
        if count == 1:
            unit = np.eye(3, dtype=np.float32)
            return [_Beam((0,), unit[None], np.ones((1, 3), np.float32), unit)]
        depth_m = float(self._focus_m[0, 0])
        moved = np.array([self._shift(farthest, depth_m, 0, λ) for λ in range(count)])
        shares = colour_shares(laser_rgb)
        if np.ptp(moved, axis=0).max() < _ROUNDING:
            return [_beam(tuple(range(count)), shares, shares.sum(axis=2), np.eye(3))]
        mixture = np.linalg.pinv(laser_rgb.T)
        if np.allclose(laser_rgb.T @ mixture, np.eye(3)):  # a laser's part of the light is a number, its intensity
            return [_beam((λ,), mixture[λ][None, None], np.ones((1, 1)), laser_rgb[λ][:, None]) for λ in range(count)]
        return [_beam((λ,), shares[λ][None], np.ones((1, 3)), np.eye(3)) for λ in range(count)]

    def _group_layers(self, distances: NDArray[np.float64], farthest: ViewingPupil) -> list[list[int]]:
        """The layers, near to far, in groups whose depths move within a sample of each other."""
        step_m = self._pitch_m / max(self._difference(farthest).centre[0], _ROUNDING)
        group_of = ((distances[0] - distances) / step_m).astype(np.int64)
        return [np.flatnonzero(group_of == group).tolist() for group in np.unique(group_of)]

    def _blur(
        self,
        frame: NDArray[np.float32],
        labels: NDArray[np.int64],
        distances: NDArray[np.float64],
        groups: list[list[int]],
    ) -> list[list[_Group]]:
        """The groups of each beam's groups, near to far."""
        pairs, most = list(np.ndindex(*self._focus_m.shape)), max(labels.shape) - 1
        at = [(self._pupil.cone(λ), float(self._focus_m[plane, λ])) for plane, λ in pairs]
        kernels = [[cone.kernel(z - d, self._pitch_m, most) for cone, z in at] for d in distances.tolist()]
        reach = max(len(kernel) // 2 for layer in kernels for kernel in layer)
        made: list[list[_Group]] = [[] for _ in self._beams]
        for layers in groups:
            blurs = [LayerBlur(frame, labels, layer, reach) for layer in layers]
            window = _union([blur.window for blur in blurs])
            joined = np.zeros((len(pairs), 4, *(side.stop - side.start for side in window)), dtype=np.float32)
            for layer, blur in reversed(list(zip(layers, blurs, strict=True))):
                for light, kernel in zip(joined, kernels[layer], strict=True):
                    blur.put_over(light, kernel, window)
            joined = joined.reshape(*self._focus_m.shape, *joined.shape[1:])
            depth_m = float(np.mean(distances[layers]))
            for beam, own in zip(self._beams, made, strict=True):
                own.append(_group_of(beam, joined, depth_m, window))
        return made

    # --- from another place -----------------------------------------------------------------------------------------

    def _composite(
        self, pupils: Sequence[ViewingPupil], beam: _Beam, groups: list[_Group], plane: int
    ) -> NDArray[np.float32]:
        """The light (pupil, channel, y, x) of a beam's groups on a plane, with the margin.

        Strip by strip for all pupils, so that their common data are read from memory once.
        """
        height, width = (n + 2 * self._margin for n in self._shape)
        seen = np.empty((len(pupils), beam.to_rgb.shape[1], height, width), dtype=np.float32)
        shifts = [
            [[round(px) for px in self._shift(pupil, group.depth_m, plane, beam.wavelengths[0])] for group in groups]
            for pupil in pupils
        ]
        rows = max(_STRIP_NUMBERS // (seen.shape[1] * width), 1)
        passes, added = np.empty((2, seen.shape[1], rows, width), dtype=np.float32)
        for start in range(0, height, rows):
            strip = slice(start, min(start + rows, height)), slice(0, width)
            for light, moved in zip(seen[:, :, strip[0]], shifts, strict=True):
                clear = passes[:, : light.shape[1]]
                light.fill(0)
                clear.fill(1)
                for group, shift in zip(groups, moved, strict=True):
                    cuts = [_cut(*sides) for sides in zip(group.window, shift, strip, strict=True)]
                    outer, inner = zip(*cuts, strict=True)
                    part, own = clear[:, *outer], added[:, *outer]
                    np.multiply(part, group.light[plane][:, *inner], out=own)
                    light[:, *outer] += own
                    part *= group.clear[plane][:, *inner]
                np.subtract(1, clear, out=clear)
                light /= np.maximum(clear, _LEAST_COVERAGE, out=clear)
        return seen


def _beam(
    wavelengths: tuple[int, ...], to_beam: NDArray[np.float64], covers: NDArray[np.float64], to_rgb: NDArray[np.float64]
) -> _Beam:
    return _Beam(wavelengths, *(matrix.astype(np.float32) for matrix in (to_beam, covers, to_rgb)))


def _group_of(beam: _Beam, joined: NDArray[np.float32], depth_m: float, window: Window) -> _Group:
    """A beam's part of a group's light and coverage (plane, wavelength, 4, y, x)."""
    of_beam = joined[:, list(beam.wavelengths)]
    light = np.einsum("wqc,pwcyx->pqyx", beam.to_beam, of_beam[:, :, :3], optimize=True)
    covered = np.einsum("wq,pwyx->pqyx", beam.covers, np.clip(of_beam[:, :, 3], 0, 1), optimize=True)
    return _Group(depth_m, window, np.ascontiguousarray(light), np.ascontiguousarray(1 - covered))


def _union(windows: Sequence[Window]) -> Window:
    """The smallest window that holds all of them."""
    y, x = (
        slice(min(side.start for side in sides), max(side.stop for side in sides))
        for sides in zip(*windows, strict=True)
    )
    return y, x


def _cut(side: slice, shift: int, part: slice) -> tuple[slice, slice]:
    """The slices of a moved side within a part of the frame: counted from the part, and from the side."""
    start, stop = max(side.start + shift, part.start), min(side.stop + shift, part.stop)
    stop, origin = max(start, stop), side.start + shift
    return slice(start - part.start, stop - part.start), slice(start - origin, stop - origin)


# Targets of a bench whose eye moves: from a light field, and from a picture with depth for any place of its pupil.


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
    """The target of a light field: its picture in the eye of a system that is focused on each plane.

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
    rgb = scale_saturation(resize_to_cover(source.rgb, shape, placement.framing), saturation)
    return eye, source, rgb, scene_depth(system, placement, source, shape)
