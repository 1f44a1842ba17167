"""The images of the sides of a comparison, each kept up to date on the device: now, target, snapshots, presets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.app.progressive_renderer import ProgressiveRenderer
from holoview.app.viewport import DeviceImage
from holoview.colour import SRGB_TO_XYZ
from holoview.document.editing_session import EditingSession
from holoview.document.scene import Scene
from holoview.document.target_spec import TargetSpec
from holoview.document.view_settings import NOW, TARGET, ComparisonSide
from holoview.gpu.device import Device

_MAX_OTHERS = 2  # renderers besides that of "now", as each takes memory of the device


@dataclass(frozen=True, eq=False)
class _ShownTarget:
    """A target on the device: the image (y, x, 3) that it shows, and of which specification."""

    spec: TargetSpec
    image: NDArray[np.float32]
    shown: DeviceImage


class SideRenderers:
    """One renderer for each side: call `request` after each change of the session, `compute_slice` while `is_busy`.

    now: the renderer of "now", if it has been started already.
    """

    def __init__(self, device: Device, session: EditingSession, now: ProgressiveRenderer | None = None) -> None:
        self._device, self._session = device, session
        self.now = ProgressiveRenderer(device) if now is None else now
        self._others: dict[ComparisonSide, ProgressiveRenderer] = {}
        self._presets: dict[tuple[str, tuple[int, int], int], Scene | None] = {}
        self._target: _ShownTarget | None = None

    def visible_sides(self) -> tuple[ComparisonSide, ...]:
        """The sides that the view settings show, and "now", which is always kept up to date."""
        view = self._session.view_settings
        return (NOW,) if view.compare == "off" else tuple(dict.fromkeys((NOW, view.a, view.b)))

    def request(self) -> None:
        """Requests the images that the session shows. Raises UserError for an impossible scene."""
        for side in self.visible_sides():
            if side == TARGET:
                continue
            scene = self._scene(side)
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
            target = self._session.target_at()
            return None if target is None else target @ SRGB_TO_XYZ.T
        renderer = self.renderer(side)
        return None if renderer is None else renderer.xyz()

    def close(self) -> None:
        """Ends all renderers."""
        for renderer in (self.now, *self._others.values()):
            renderer.close()

    def _scene(self, side: ComparisonSide) -> Scene | None:
        """The scene of a side; that of a preset is cached, since new random patterns would restart its rendering."""
        if side.kind != "preset":
            return self._session.scene_for(side)
        system = self._session.system
        key = (side.name, system.modulators[0].shape, system.sampling.upsample)
        if key not in self._presets:
            self._presets[key] = self._session.scene_for(side)
        scene = self._presets[key]
        return None if scene is None else replace(scene, plane_m=self._session.view_settings.plane_m)

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
        session, old = self._session, self._target
        if old is not None and (old.spec, old.shown.shape) != (session.target_spec, session.document.image_shape):
            old = self._target = None
        is_moving = session.system.eye is not None and not self.now.is_fresh
        image = None if is_moving and old is not None else session.target_at()
        is_new = image is not None and (old is None or old.image is not image)
        if is_new and image is not None and session.target_spec is not None:
            xyz = np.zeros((*image.shape[:2], 4), np.float32)
            xyz[..., :3] = image @ SRGB_TO_XYZ.T
            shown = DeviceImage(self._device.upload(xyz, "target"), (image.shape[0], image.shape[1]))
            self._target = _ShownTarget(session.target_spec, image, shown)
        return None if self._target is None else self._target.shown
