"""The images of the sides of a comparison, each kept up to date on the device: now, target, snapshots, presets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.colour import SRGB_TO_XYZ
from holoview.gpu.device import Device
from holoview.model.system import System
from holoview.render.progressive_renderer import ProgressiveRenderer
from holoview.render.scene import DeviceImage, Scene, image_shape
from holoview.render.view_settings import NOW, TARGET, ComparisonSide, ViewSettings

_MAX_OTHERS = 2  # renderers besides that of "now", as each takes memory of the device


@dataclass(frozen=True, eq=False)
class _ShownTarget:
    """A target on the device: the image (y, x, 3) that it shows, and of which specification."""

    spec: object
    image: NDArray[np.float32]
    shown: DeviceImage


class ComparedScenes(Protocol):
    """The scenes of the sides of a comparison at present, which the editing session tells."""

    @property
    def view_settings(self) -> ViewSettings:
        """Which sides are shown, and how."""

    @property
    def system(self) -> System:
        """The system of the side "now"."""

    @property
    def target_spec(self) -> object:
        """The specification of the target; None without a target."""

    def scene_for(self, side: ComparisonSide) -> Scene | None:
        """The scene of a side; None for a side that isn't rendered."""

    def target_at(self) -> NDArray[np.float32] | None:
        """The target (y, x, 3) in linear sRGB at the displayed plane; None until it is built."""


class SideRenderers:
    """One renderer for each side: call `request` after each change of the scenes, `compute_slice` while `is_busy`.

    now: the renderer of "now", if it has been started already.
    """

    def __init__(self, device: Device, scenes: ComparedScenes, now: ProgressiveRenderer | None = None) -> None:
        self._device, self._scenes = device, scenes
        self.now = ProgressiveRenderer(device) if now is None else now
        self._others: dict[ComparisonSide, ProgressiveRenderer] = {}
        self._target: _ShownTarget | None = None

    def visible_sides(self) -> tuple[ComparisonSide, ...]:
        """The sides that the view settings show, and "now", which is always kept up to date."""
        view = self._scenes.view_settings
        return (NOW,) if view.compare == "off" else tuple(dict.fromkeys((NOW, view.a, view.b)))

    def request(self) -> None:
        """Requests the images of the visible sides. Raises UserError for an impossible scene."""
        for side in self.visible_sides():
            if side == TARGET:
                continue
            scene = self._scenes.scene_for(side)
            if scene is not None:
                self._renderer_for(side).request(scene)

    def compute_slice(self) -> bool:
        """Computes a slice of the first side that isn't up to date; returns whether a picture has changed."""
        for side in self.visible_sides():
            renderer = self.renderer(side)
            if renderer is not None and renderer.is_busy and renderer.wait_s == 0:
                return renderer.compute_slice()
        return False

    @property
    def is_busy(self) -> bool:
        """Whether an image isn't up to date, even if its full frame still waits for a pause in editing."""
        return any(renderer.is_busy for side in self.visible_sides() if (renderer := self.renderer(side)) is not None)

    @property
    def wait_s(self) -> float:
        """The time until `compute_slice` can do something, while `is_busy`."""
        waits = [
            renderer.wait_s
            for side in self.visible_sides()
            if (renderer := self.renderer(side)) is not None and renderer.is_busy
        ]
        return min(waits, default=0.0)

    def renderer(self, side: ComparisonSide) -> ProgressiveRenderer | None:
        """The renderer of a side; None if it isn't rendered."""
        return self.now if side == NOW else self._others.get(side)

    def picture(self, side: ComparisonSide) -> DeviceImage | None:
        """The newest image of a side on the device; None before the first."""
        if side == TARGET:
            return self._target_picture()
        renderer = self.renderer(side)
        return None if renderer is None else renderer.picture

    def xyz(self, side: ComparisonSide) -> NDArray[np.floating] | None:
        """The full image XYZ (y, x, 3) of a side on the host; None until it is computed."""
        if side == TARGET:
            target = self._scenes.target_at()
            return None if target is None else target @ SRGB_TO_XYZ.T
        renderer = self.renderer(side)
        return None if renderer is None else renderer.xyz()

    def close(self) -> None:
        """Ends all renderers."""
        for renderer in (self.now, *self._others.values()):
            renderer.close()

    def _renderer_for(self, side: ComparisonSide) -> ProgressiveRenderer:
        if side == NOW:
            return self.now
        if side not in self._others:
            while len(self._others) >= _MAX_OTHERS:
                self._others.pop(next(iter(self._others)))
            self._others[side] = ProgressiveRenderer(self._device)
        self._others[side] = self._others.pop(side)
        return self._others[side]

    def _target_picture(self) -> DeviceImage | None:
        """The newest target that is built; with an eye, which it follows, one is built when that has come to rest."""
        scenes, old = self._scenes, self._target
        if old is not None and (old.spec, old.shown.shape) != (scenes.target_spec, image_shape(scenes.system)):
            old = self._target = None
        is_moving = scenes.system.eye is not None and not self.now.is_fresh
        image = None if is_moving and old is not None else scenes.target_at()
        is_new = image is not None and (old is None or old.image is not image)
        if is_new and image is not None and scenes.target_spec is not None:
            xyz = np.zeros((*image.shape[:2], 4), np.float32)
            xyz[..., :3] = image @ SRGB_TO_XYZ.T
            shown = DeviceImage(self._device.upload(xyz, "target"), (image.shape[0], image.shape[1]))
            self._target = _ShownTarget(scenes.target_spec, image, shown)
        return None if self._target is None else self._target.shown
