"""The images that are looked at and compared, each kept up to date on the device: now, target, snapshots, presets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from holoview.app.progressive_renderer import ProgressiveRenderer
from holoview.app.viewport import DeviceImage
from holoview.colour import SRGB_TO_XYZ
from holoview.gpu.device import Device
from holoview.session.editing_session import EditingSession
from holoview.session.scene import Scene
from holoview.session.view_settings import NOW, TARGET, ComparisonSide

_MOST_OTHERS = 2  # feeds besides "now": the memory of a device isn't endless


class SideRenderers:
    """Pictures by side. `want` at each change of the session, `advance` while `is_busy`."""

    def __init__(self, device: Device, session: EditingSession) -> None:
        self._device, self._session = device, session
        self.now = ProgressiveRenderer(device)
        self._others: dict[ComparisonSide, ProgressiveRenderer] = {}
        self._presets: dict[tuple[str, tuple[int, int], int], Scene | None] = {}
        self._target: tuple[NDArray[np.float32], DeviceImage] | None = None

    def visible_sides(self) -> tuple[ComparisonSide, ...]:
        """The sides that the look shows."""
        look = self._session.view_settings
        return (NOW,) if look.compare == "off" else tuple(dict.fromkeys((NOW, look.a, look.b)))

    def request(self) -> None:
        """Asks for what the session shows now. Raises UserError where a scene is impossible."""
        for side in self.visible_sides():
            if side == TARGET:
                continue
            scene = self._scene(side)
            if scene is not None:
                self._renderer_for(side).request(scene)

    def compute_slice(self) -> bool:
        """Computes a slice of the first side that has something to do; whether a picture has changed."""
        for side in self.visible_sides():
            feed = self.renderer(side)
            if feed is not None and feed.is_busy and feed.wait_s == 0:
                return feed.compute_slice()
        return False

    @property
    def is_busy(self) -> bool:
        """Whether there is something to compute, now or once the hand rests."""
        return any(feed.is_busy for side in self.visible_sides() if (feed := self.renderer(side)) is not None)

    @property
    def wait_s(self) -> float:
        """How long `advance` has nothing to do, where `is_busy`."""
        rests = [
            feed.wait_s for side in self.visible_sides() if (feed := self.renderer(side)) is not None and feed.is_busy
        ]
        return min(rests, default=0.0)

    def renderer(self, side: ComparisonSide) -> ProgressiveRenderer | None:
        """The feed of a side that is rendered."""
        return self.now if side == NOW else self._others.get(side)

    def picture(self, side: ComparisonSide) -> DeviceImage | None:
        """What there is of a side; None while it isn't there."""
        if side == TARGET:
            return self._target_picture()
        feed = self.renderer(side)
        return None if feed is None else feed.picture

    def xyz(self, side: ComparisonSide) -> NDArray[np.floating] | None:
        """A side's image on the host, XYZ (y, x, 3); None while it isn't there in full."""
        if side == TARGET:
            target = self._session.target_at()
            return None if target is None else target @ SRGB_TO_XYZ.T
        feed = self.renderer(side)
        return None if feed is None else feed.xyz()

    def close(self) -> None:
        """Ends what goes on in the background."""
        for feed in (self.now, *self._others.values()):
            feed.close()

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
            while len(self._others) >= _MOST_OTHERS:
                self._others.pop(next(iter(self._others)))
            self._others[side] = ProgressiveRenderer(self._device)
        self._others[side] = self._others.pop(side)
        return self._others[side]

    def _target_picture(self) -> DeviceImage | None:
        image = self._session.target_at()
        if image is None:
            return None
        if self._target is None or self._target[0] is not image:
            xyz = np.zeros((*image.shape[:2], 4), np.float32)
            xyz[..., :3] = image @ SRGB_TO_XYZ.T
            self._target = (image, DeviceImage(self._device.upload(xyz, "target"), (image.shape[0], image.shape[1])))
        return self._target[1]
