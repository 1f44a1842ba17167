"""A target file that is read once and built for any planes and places of the pupil.

It is a picture, a focal stack, a light field, or a scene that computes its own pictures, such as a complex field.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.targets.focal_stack import Target, is_stack, target_from_stack
from holoview.holograms.targets.light_field import LightField, ViewGrid, is_light_field, read_light_field
from holoview.holograms.targets.moving_pupil import (
    StacksAt,
    moving_target,
    moving_target_from_views,
    target_from_views,
    views_of_picture,
)
from holoview.holograms.targets.picture import COLOUR_SPACES, Picture, check_saturation, read_picture, scale_saturation
from holoview.holograms.targets.target import Placement, target_for
from holoview.light.model.eye import Eye
from holoview.light.model.fields import Number, Word, described_field, fields_by_key
from holoview.light.model.focus import focused_planes, required_eye
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.progress import TextCallback


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetLight:
    """How the light of pictures becomes that of a target. What is equal is for those to say that have more fields."""

    brightness: float = described_field(
        Number(low=1e-6, high=1e6, words="a factor from 1e-06 to 1e+06"),
        "Factor on the target's linear light.",
        default=1.0,
    )
    saturation: float = described_field(
        Number(low=0.0, words="a factor of 0 or more: 0 is grey, 1 changes nothing"),
        "Factor on the target's chroma in CIE LCHuv.",
        default=1.0,
    )
    space: str = described_field(
        Word(COLOUR_SPACES),
        "Of a float file, xyz: Y = 1 is white; of a file of 16 bits, srgb8 … srgb16: white is 2^bits - 1.",
        default="srgb",
    )

    @property
    def light(self) -> dict[str, Any]:
        """These three, by name."""
        return {key: getattr(self, key) for key in fields_by_key(TargetLight)}


@dataclass(frozen=True)
class TargetFile(TargetLight):
    """A file or folder that holds a target, and how it is read.

    placement: where a picture stands. grid: viewpoints of a folder of pictures without views.toml, or from which a
    picture is rendered, with occlusion. zero_m: where the views of a light field have no disparity; None for what the
    folder says.
    """

    path: str
    placement: Placement = field(default_factory=Placement)
    grid: ViewGrid | None = None
    zero_m: float | None = None

    @property
    def has_views(self) -> bool:
        """Whether it is a folder of views."""
        return is_light_field(self.path) or (self.grid is not None and Path(self.path).is_dir())

    @property
    def is_stack(self) -> bool:
        """Whether it is a focal stack, which has pictures for the system's own planes only."""
        return not self.has_views and is_stack(self.path)


class ComputedScene(Protocol):
    """A scene that computes its pictures for any system, such as `fields.field_target.FieldTarget`."""

    @property
    def source(self) -> str:
        """Its name."""

    def images(self, system: System, planes_m: NDArray[np.float64]) -> NDArray[np.float32]:
        """Its pictures (plane, y, x, 3), linear sRGB, in planes (plane,) m, on the samples of the system's simulation.

        Raises UserError for a system that can't show it.
        """


@dataclass(frozen=True, eq=False)
class TargetContent(TargetLight):
    """A picture, views of a light field, the path of a focal stack, or a scene, from which targets are built.

    placement: of a picture. Views have their saturation already.
    """

    source: Picture | LightField | Path | ComputedScene
    placement: Placement = field(default_factory=Placement)

    def build(self, system: System, planes_m: NDArray[np.float64] | None = None) -> Target:
        """The target at the planes of a system; at others (m) if they are given, unless it is a focal stack.

        Raises UserError as `target_for`, `target_from_stack` and `target_from_views` do.
        """
        if isinstance(self.source, LightField):
            return target_from_views(system, self.source, self.brightness, planes=planes_m)
        if isinstance(self.source, Path):
            return target_from_stack(system, self.source, **self.light)
        if not isinstance(self.source, Picture):
            return self._of_scene(self.source, system, focused_planes(system) if planes_m is None else planes_m)
        return target_for(
            system, self.source, self.placement, self.brightness, saturation=self.saturation, planes=planes_m
        )

    def _of_scene(self, scene: ComputedScene, system: System, planes_m: NDArray[np.float64]) -> Target:
        check_saturation(self.saturation)
        stack = np.stack([scale_saturation(image, self.saturation) for image in scene.images(system, planes_m)])
        return Target.from_stack(stack, planes_m, scene.source, self.brightness)

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius; not of a focal stack.

        Raises UserError for a scene, and as `moving_target` and `moving_target_from_views` do.
        """
        if isinstance(self.source, LightField):
            return moving_target_from_views(system, self.source, self.brightness)
        assert not isinstance(self.source, Path), "a focal stack has no other views"
        if not isinstance(self.source, Picture):
            raise UserError(self.source.source, "a field", expected="a picture or views for places of the pupil")
        return moving_target(system, self.source, self.placement, radius_m, self.brightness, saturation=self.saturation)


class TargetSource:
    """A target from a file.

    A picture is read once and can be turned into a focal stack at any planes, so that a hologram can be scored between
    the planes that it was optimised for; so can a light field, a folder of views or a picture with a grid of
    viewpoints. A target that is a focal stack (`is_stack`) has its own planes.

    reach_m: how far from its place the eye's pupil is moved, at most; views cover it unless their spacing is given.
    tell: called once with each note on the files. scene: the kind of content of the file, where it isn't a picture or
    pictures.

    Raises UserError for files that can't be read.
    """

    def __init__(
        self,
        system: System,
        file: TargetFile,
        tell: TextCallback,
        reach_m: float = 0.0,
        scene: ComputedScene | None = None,
    ) -> None:
        self._system, self._file, self._tell = system, file, tell
        self._told: set[str] = set()
        self._built: dict[Hashable, Target] = {}
        self.scene, self.is_stack = scene, scene is None and file.is_stack
        source = scene or self._read(reach_m)
        self._content = TargetContent(source, file.placement, **file.light)

    def _read(self, reach_m: float) -> Picture | LightField | Path:
        system, file = self._system, self._file
        if file.has_views:
            return read_light_field(
                system, file.path, file.grid, file.zero_m, saturation=file.saturation, space=file.space
            )
        if file.is_stack:
            return Path(file.path)
        picture = read_picture(file.path, space=file.space)
        self._tell_once(picture.notes)
        if file.placement.depth is None and (beside := depth_beside(file.path)):
            self._tell_once((f"{beside.name} beside it isn't used; --depth takes it",))
        if file.grid is None:
            return picture
        grid = _covering(file.grid, required_eye(system, "--views"), system.field_m, reach_m)
        return views_of_picture(system, picture, file.placement, grid, saturation=file.saturation)

    def build(self, planes_m: NDArray[np.float64] | None = None, system: System | None = None) -> Target:
        """The target at the system's planes, or at others (m) if the target isn't a focal stack.

        system: another one that differs in its lasers and its eye alone.
        """
        system = system or self._system
        key = (system.eye, system.wavelengths_m.tobytes(), None if planes_m is None else planes_m.tobytes())
        if key not in self._built:  # with an eye, each takes as long as some iterations
            self._built[key] = self._content.build(system, planes_m)
            self._tell_once(self._built[key].notes)
        return self._built[key]

    def with_plane(self, plane_m: float) -> Target:
        """The target at the system's planes and at one more, where they don't hold it; a focal stack as it is."""
        return self.build(None if self.is_stack else planes_with(self._system, plane_m))

    def stack_for(self, system: System) -> NDArray[np.float32]:
        """The focal stack (plane, y, x, 3) that the eye of a system is to see."""
        return self.build(system=system).stack

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius, of a picture or a light field."""
        return self._content.moving(radius_m, system)

    def _tell_once(self, notes: tuple[str, ...]) -> None:
        for note in notes:
            if note not in self._told:
                self._tell(f"{self._file.path}: {note}")
        self._told.update(notes)


def planes_with(system: System, plane_m: float) -> NDArray[np.float64] | None:
    """The planes of a system and one more (m), in rising order; None where they hold it."""
    own_m = focused_planes(system)
    if np.isclose(own_m, plane_m, rtol=0, atol=1e-9).any():
        return None
    return np.sort(np.append(own_m, plane_m))


def depth_beside(path: str | Path) -> Path | None:
    """The file beside a picture that is named as its depth map, if there is one."""
    picture = Path(path)
    depth = picture.with_name(f"{picture.stem}-depth{picture.suffix}")
    return depth if depth.is_file() else None


def _covering(grid: ViewGrid, eye: Eye, field_m: tuple[float, float], reach_m: float) -> ViewGrid:
    """The grid with a spacing by which it covers the pupil wherever it is moved, unless it has a spacing."""
    width_m = eye.pupil_diameter_m(field_m) + 2 * reach_m
    return grid if grid.spacing_m is not None else replace(grid, spacing_m=width_m / min(grid.rows, grid.columns))
