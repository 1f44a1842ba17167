"""Keeps the light through the cursor up to date: sections, directions, and the areas that contribute.

It is computed in torch on threads, step by step; an edit ends what is computed, and the pictures before stay until new
ones are there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from holoview.light.gpu.device import Device
from holoview.util.mailbox import LatestTask
from holoview.viewer.render.scene import DeviceImage, Scene, image_shape, uploaded_image
from holoview.viewer.render.tone_mapping import by_decades, in_own_units
from holoview.viewer.render.view_settings import ViewSettings

if TYPE_CHECKING:
    from holoview.light.engine.point_light import PointLight, Sections

SECTION_PLANES = 65
"""Planes of a section: every 2ⁿ-th of them first."""
WINDOWS = (16, 32, 64, 128, 256)
"""Samples across the window of a local spectrum."""


@dataclass(frozen=True, eq=False)
class SeenSections:
    """The sections through a sample (row, column), with z to the right: x–z (x, z) and y–z (y, z) on the device.

    low_m, high_m: distances of the first and the last plane. share: of the planes that are computed.
    """

    place: tuple[int, int]
    low_m: float
    high_m: float
    xz: DeviceImage
    yz: DeviceImage
    share: float


@dataclass(frozen=True, eq=False)
class SeenPoint:
    """The light of a sample, and pictures of it on the device: the areas of each modulator, and the directions."""

    light: PointLight
    areas: tuple[DeviceImage, ...]
    directions: DeviceImage

    def frequency_at(self, u: float, v: float) -> tuple[float, float]:
        """The spatial frequency (y, x), 1/m, at a place of the picture of directions, given as fractions (x, y)."""
        window = self.light.window
        y, x = (int(share * window) - window // 2 for share in (v, u))
        return y * self.light.frequency_step, x * self.light.frequency_step


class PointProbe:
    """The newest sections and the newest light of the cursor.

    deliver: has the owner make a call. on_error: called by the owner with the exception.
    """

    def __init__(
        self, device: Device, deliver: Callable[[Callable[[], None]], None], on_error: Callable[[BaseException], None]
    ) -> None:
        self._device = device
        self._section_task: LatestTask[Sections] = LatestTask("sections", deliver, on_error)
        self._point_task: LatestTask[PointLight] = LatestTask("light of a point", deliver, on_error)
        self.sections: SeenSections | None = None
        self.point: SeenPoint | None = None

    @property
    def is_busy(self) -> bool:
        """Whether something is being computed."""
        return self._section_task.is_busy or self._point_task.is_busy

    def request_sections(self, scene: Scene, view: ViewSettings, low_m: float, high_m: float) -> None:
        """Has the sections through the cursor computed from one distance to another, unless they are there already."""
        place, lasers = view.cursor_in(image_shape(scene.system)), _lasers(scene, view)
        steps = partial(_section_steps, scene, np.linspace(low_m, high_m, SECTION_PLANES), place, lasers)
        inputs = (scene.system, scene.drive, place, lasers, low_m, high_m)
        self._section_task.submit_steps(steps, partial(self._put_sections, place), inputs)

    def request_point(self, scene: Scene, view: ViewSettings, window: int) -> None:
        """Has the light of the cursor computed, unless it is there already. window: one of `WINDOWS`."""
        place, lasers = view.cursor_in(image_shape(scene.system)), _lasers(scene, view)
        inputs = (scene.system, scene.drive, place, lasers, scene.plane_m, window)
        self._point_task.submit_steps(partial(_point_steps, scene, place, lasers, window), self._put_point, inputs)

    def close(self) -> None:
        """Ends the threads."""
        self._section_task.close()
        self._point_task.close()

    def _put_sections(self, place: tuple[int, int], found: Sections) -> None:
        if not found.share:
            return
        xz, yz = (
            uploaded_image(self._device, np.ascontiguousarray(np.swapaxes(picture, 0, 1)), "section")
            for picture in (found.xz, found.yz)
        )
        low_m, high_m = float(found.planes_m[0]), float(found.planes_m[-1])
        self.sections = SeenSections(place, low_m, high_m, xz, yz, found.share)

    def _put_point(self, found: PointLight) -> None:
        areas = tuple(uploaded_image(self._device, in_own_units(area), "area") for area in found.areas)
        directions = uploaded_image(self._device, by_decades(found.directions), "directions")
        self.point = SeenPoint(found, areas, directions)


def angle_deg(frequency: float, wavelength_m: float) -> float:
    """The angle to the axis, in degrees along y or x, of a spatial frequency, 1/m; NaN for one that is evanescent."""
    sine = frequency * wavelength_m
    return math.degrees(math.asin(sine)) if abs(sine) <= 1 else math.nan


def _lasers(scene: Scene, view: ViewSettings) -> tuple[int, ...]:
    """The indices of the lasers that are shown."""
    return tuple(index for index in range(len(scene.system.wavelengths_m)) if view.shows_laser(index))


def _section_steps(
    scene: Scene, planes_m: NDArray[np.float64], place: tuple[int, int], lasers: Sequence[int]
) -> Iterator[Sections]:
    from holoview.light.engine.point_light import section_steps  # slow start: it imports torch

    return section_steps(scene.system, scene.drive, planes_m, place, lasers)


def _point_steps(scene: Scene, place: tuple[int, int], lasers: Sequence[int], window: int) -> Iterator[PointLight]:
    from holoview.light.engine.point_light import point_steps  # slow start: it imports torch

    return point_steps(scene.system, scene.drive, scene.plane_m, place, lasers, window)
