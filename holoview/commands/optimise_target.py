"""The target that the arguments of `holoview optimise` describe: a picture, a focal stack, or a light field."""

from __future__ import annotations

import argparse
import re
from collections.abc import Hashable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.commands.console import print_stderr
from holoview.model.eye import Eye
from holoview.model.focus import parse_plane, required_eye
from holoview.model.system import System
from holoview.targets.focal_stack import Target, is_stack, target_from_stack
from holoview.targets.light_field import LightField, ViewGrid, is_light_field, read_light_field
from holoview.targets.moving_pupil import (
    StacksAt,
    moving_target,
    moving_target_from_views,
    target_from_views,
    views_of_picture,
)
from holoview.targets.picture import Picture, read_picture
from holoview.targets.target import Placement, target_for
from holoview.util import units
from holoview.util.errors import UserError

_MIN_BRIGHTNESS = 1e-6  # and the maximum is its inverse
_VIEWS = re.compile(r"(?P<rows>\d{1,2})x(?P<columns>\d{1,2})(:(?P<spacing>.+))?")


def parse_view_grid(text: str | None, system: System) -> ViewGrid | None:
    """The grid of viewpoints about the pupil of a system's eye, from text such as "7x7:0.5mm" or "7x7"; None for None.

    Raises UserError for text of another form, and without an eye.
    """
    if text is None:
        return None
    match = _VIEWS.fullmatch(text)
    if match is None:
        raise UserError("--views", f'"{text}"', expected="rows x columns, and perhaps their spacing, e.g. 7x7:0.5mm")
    eye = required_eye(system, "--views")
    spacing = None if match["spacing"] is None else units.parse(match["spacing"], "--views")
    try:
        return ViewGrid(int(match["rows"]), int(match["columns"]), spacing, eye.pupil_y_m, eye.pupil_x_m)
    except UserError as error:
        raise error.inside("--views: ") from error


class TargetSource:
    """The target that the arguments describe.

    A picture is read once and can be turned into a focal stack at any planes, so that a hologram can be scored between
    the planes that it was optimised for; so can a light field, a folder of views or a picture with `--views`. A target
    that is a focal stack (`is_stack`) has its own planes.

    reach_m: how far from its place the eye's pupil is moved, at most; views cover it unless their spacing is given.

    Raises UserError for arguments that contradict each other and files that can't be read.
    """

    def __init__(self, args: argparse.Namespace, system: System, reach_m: float = 0.0) -> None:
        _check_arguments(args)
        self._args, self._system = args, system
        self._notes_printed: set[str] = set()
        self._built: dict[Hashable, Target] = {}
        grid = parse_view_grid(args.views, system)
        is_folder = Path(args.target).is_dir()
        has_views = is_light_field(args.target) or (grid is not None and is_folder)
        self.is_stack = not has_views and is_stack(args.target)
        if self.is_stack and (args.depth is not None or args.at is not None or grid is not None):
            raise UserError("--depth/--at/--views", "with a focal stack", expected="a picture, or none of them")
        if has_views and args.depth is not None:
            raise UserError("--depth", "with a folder of views", expected="a picture, or no depth map")
        self._picture = None if self.is_stack or has_views else self._read_picture()
        self._field: LightField | None = None
        if has_views:
            self._field = self._read_views(grid)
        elif self._picture is not None and grid is not None:
            grid = _covering(grid, required_eye(system, "--views"), system.field_m, reach_m)
            self._field = views_of_picture(system, self._picture, self._placement(), grid, saturation=args.saturation)

    def build(self, planes_m: NDArray[np.float64] | None = None, system: System | None = None) -> Target:
        """The target at the system's planes, or at others (m) if the target isn't a focal stack.

        system: another one that differs in its lasers and its eye alone.
        """
        args, system = self._args, system or self._system
        key = (system.eye, system.wavelengths_m.tobytes(), None if planes_m is None else planes_m.tobytes())
        if key not in self._built:  # with an eye, each takes as long as some iterations
            if self._field is not None:
                target = target_from_views(system, self._field, args.brightness, planes=planes_m)
            elif self._picture is not None:
                target = target_for(
                    system,
                    self._picture,
                    self._placement(),
                    args.brightness,
                    saturation=args.saturation,
                    planes=planes_m,
                )
            else:
                target = target_from_stack(
                    system, args.target, brightness=args.brightness, saturation=args.saturation, space=args.space
                )
            self._print_notes(target.notes)
            self._built[key] = target
        return self._built[key]

    def stack_for(self, system: System) -> NDArray[np.float32]:
        """The focal stack (plane, y, x, 3) that the eye of a system is to see."""
        return self.build(system=system).stack

    def moving(self, radius_m: float, system: System) -> StacksAt:
        """The focal stacks from any places of the pupil within a radius, of a picture or a light field."""
        if self._field is not None:
            return moving_target_from_views(system, self._field, self._args.brightness)
        assert self._picture is not None
        args = self._args
        return moving_target(
            system, self._picture, self._placement(), radius_m, args.brightness, saturation=args.saturation
        )

    def _placement(self) -> Placement:
        return Placement(
            self._parse_length("at"), self._args.depth, self._parse_length("near"), self._parse_length("far")
        )

    def _read_views(self, grid: ViewGrid | None) -> LightField:
        args = self._args
        zero_m = None if args.at is None else parse_plane(self._system, args.at, "--at")
        return read_light_field(self._system, args.target, grid, zero_m, saturation=args.saturation, space=args.space)

    def _read_picture(self) -> Picture:
        picture = read_picture(self._args.target, space=self._args.space)
        self._print_notes(picture.notes)
        return picture

    def _print_notes(self, notes: tuple[str, ...]) -> None:
        """Prints the notes that haven't been printed."""
        for note in notes:
            if note not in self._notes_printed:
                print_stderr(f"note: {self._args.target}: {note}")
        self._notes_printed.update(notes)

    def _parse_length(self, flag: str) -> float | None:
        text = getattr(self._args, flag)
        return None if text is None else units.parse(text, f"--{flag}")


def _check_arguments(args: argparse.Namespace) -> None:
    if not _MIN_BRIGHTNESS <= args.brightness <= 1 / _MIN_BRIGHTNESS:
        expected = f"a factor from {_MIN_BRIGHTNESS:g} to {1 / _MIN_BRIGHTNESS:g}"
        raise UserError("--brightness", f"{args.brightness:g}", expected=expected)
    if args.depth is None and (args.near is not None or args.far is not None):
        raise UserError("--near/--far", "without --depth", expected="a depth map, or --at for one distance")


def _covering(grid: ViewGrid, eye: Eye, field_m: tuple[float, float], reach_m: float) -> ViewGrid:
    """The grid with a spacing by which it covers the pupil wherever it is moved, unless it has a spacing."""
    width_m = eye.pupil_diameter_m(field_m) + 2 * reach_m
    return grid if grid.spacing_m is not None else replace(grid, spacing_m=width_m / min(grid.rows, grid.columns))
