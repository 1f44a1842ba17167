"""The specification of a target: which picture a hologram should show, where it stands and how bright it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.model.plan import make_plan
from holoview.model.system import System
from holoview.targets.focal_stack import Target, target_from_stack
from holoview.targets.light_field import is_light_field, read_light_field
from holoview.targets.moving_pupil import StacksAt, moving_target, moving_target_from_views, target_from_views
from holoview.targets.picture import Picture, read_picture
from holoview.targets.target import Placement, scene_depth, target_for
from holoview.util.errors import UserError
from holoview.util.files import data_dir


@dataclass(frozen=True, eq=False)
class TargetSpec:
    """What a hologram should show, independent of the system that shows it.

    source: a picture in linear light, or the path of a rendered focal stack or of a folder of views. brightness: a
    factor on linear light. saturation: a factor on the chroma in CIE LCHuv. space: the colour space of float files.
    is_example: whether it is `example_target()`, which nobody chose: a hologram that is opened removes it.
    """

    source: Picture | Path
    title: str
    placement: Placement = field(default_factory=Placement)
    brightness: float = 1.0
    saturation: float = 1.0
    space: str = "srgb"
    is_example: bool = False

    @property
    def is_stack(self) -> bool:
        """Whether it is a rendered stack, which has pictures for the system's own planes only."""
        return isinstance(self.source, Path) and not is_light_field(self.source)

    def build(self, system: System, planes_m: NDArray[np.float64] | None = None) -> Target:
        """The target at the planes of a system; at `planes_m` (n,) in metres instead, unless it is a rendered stack.

        Raises UserError as `target_for`, `target_from_stack` and `target_from_views` do.
        """
        if isinstance(self.source, Path) and not self.is_stack:
            field = read_light_field(system, self.source, saturation=self.saturation, space=self.space)
            return target_from_views(system, field, self.brightness, planes=planes_m)
        if isinstance(self.source, Path):
            return target_from_stack(
                system, self.source, brightness=self.brightness, saturation=self.saturation, space=self.space
            )
        return target_for(
            system, self.source, self.placement, self.brightness, saturation=self.saturation, planes=planes_m
        )

    def stack_for(self, system: System) -> NDArray[np.float32]:
        """The focal stack (plane, y, x, 3) at the planes of a system, or on which its eye is focused."""
        return self.build(system).stack

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius; not of a rendered stack.

        Raises UserError as `moving_target` and `moving_target_from_views` do.
        """
        if isinstance(self.source, Path):
            field = read_light_field(system, self.source, saturation=self.saturation, space=self.space)
            return moving_target_from_views(system, field, self.brightness)
        return moving_target(system, self.source, self.placement, radius_m, self.brightness, saturation=self.saturation)

    def depth_at(self, system: System, row: int, column: int) -> float:
        """Distance (m) behind the last modulator of what the target shows at a sample of the simulation grid.

        Raises UserError for a focal stack and for views, whose pictures don't tell, and as `target_for` does.
        """
        if isinstance(self.source, Path):
            raise UserError(
                "target", "pictures without depth", expected="a picture with a depth map, which tells what is where"
            )
        depth_m = scene_depth(system, self.placement, self.source, make_plan(system).grid.shape)
        return float(np.broadcast_to(depth_m, make_plan(system).grid.shape)[row, column])


def example_target() -> TargetSpec:
    """The shipped still life with its depth. Raises UserError when its files can't be read."""
    folder = data_dir("assets")
    placement = Placement(depth=folder / "still-life-depth.png")
    return TargetSpec(read_picture(folder / "still-life.png"), "still life", placement, is_example=True)
