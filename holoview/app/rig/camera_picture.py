"""The picture of a rig's camera and its prediction, drawn into a texture: side by side, wipe, difference in σ."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.context import AppContext
from holoview.app.viewport import Viewport, VisibleArea, visible_area_of
from holoview.experiment.live.live_view import LiveView
from holoview.render.scene import DeviceImage
from holoview.render.view_settings import ViewSettings

MODES = ("side-by-side", "wipe", "difference", "camera", "prediction")
"""What is shown of camera and prediction."""
_VIEW = ViewSettings(plane_m=0.0, channel="luminance")


class CameraPicture:
    """Draws camera and prediction. mode: one of MODES. wipe: share of the width that shows the camera.

    span_sigmas: differences from −span to +span are told apart. stops: a factor 2^stops on the light.
    area: what of the picture was drawn last.
    """

    def __init__(self, context: AppContext) -> None:
        self._context = context
        self._viewport = Viewport(context.device, "camera")
        self._texture: imgui.ImTextureRef | None = None
        self._images: dict[str, DeviceImage] = {}
        self._shown: dict[str, object] = {}
        self.mode, self.wipe, self.span_sigmas, self.stops = MODES[0], 0.5, 5.0, 0.0
        self.area: VisibleArea | None = None

    @property
    def view_settings(self) -> ViewSettings:
        """How the viewport is to show the pair."""
        if self.mode == "difference":
            return replace(_VIEW, compare="difference", high=self.span_sigmas)
        compare = self.mode if self.mode in ("wipe", "side-by-side") else "off"
        return replace(_VIEW, compare=compare, wipe=self.wipe, exposure_stops=self.stops)

    def draw(self, view: LiveView, size: tuple[int, int], corner: imgui.ImVec2) -> bool:
        """Draws into `size` (x, y) logical pixels at a corner; returns whether there was anything to draw."""
        a, b = self._pair(view)
        if a is None:
            return False
        scale = imgui.get_io().display_framebuffer_scale.x
        pixels = (max(round(size[0] * scale), 1), max(round(size[1] * scale), 1))
        settings = self.view_settings if b is not None else replace(_VIEW, exposure_stops=self.stops)
        self.area = visible_area_of(settings, pixels, a.shape)
        if self._viewport.draw(a, b, settings, self.area):
            if self._texture is not None:
                self._context.window.forget_texture(self._texture)
            self._texture = self._context.window.texture(self._viewport.view)
        assert self._texture is not None
        end = imgui.ImVec2(corner.x + size[0], corner.y + size[1])
        imgui.get_window_draw_list().add_image(self._texture, corner, end)
        return True

    def pixels(self) -> NDArray[np.uint8]:
        """Reads back what was drawn, 8-bit sRGB (y, x, 3)."""
        return self._viewport.pixels()

    def _pair(self, view: LiveView) -> tuple[DeviceImage | None, DeviceImage | None]:
        """The images of both sides; None for a side that isn't there or isn't wanted."""
        picture, found = view.picture, view.prediction
        if picture is None:
            return None, None
        if self.mode == "difference":
            if found is None:
                return None, None
            zero = self._image("zero", found.residual.shape, lambda: np.zeros_like(found.residual))
            return self._image("residual", found, lambda: found.residual), zero
        expected = None if found is None else self._image("expected", found, lambda: found.expected / picture.white)
        if self.mode == "prediction":
            return expected, None
        measured = self._image("measured", picture, lambda: (picture.counts - picture.black) / picture.white)
        return measured, None if self.mode == "camera" else expected

    def _image(self, name: str, of: object, values: Any) -> DeviceImage:
        """An image of values (y, x), which are asked for when `of` is another one than before."""
        if self._shown.get(name) is not of and self._shown.get(name) != of:
            light = np.asarray(values(), np.float32)
            xyz = np.repeat(light[..., None], 4, axis=2)
            old = self._images.get(name)
            if old is not None and old.shape == light.shape:
                self._context.device.write(old.buffer, xyz)
                self._images[name] = replace(old, version=old.version + 1)
            else:
                shape = (light.shape[0], light.shape[1])
                self._images[name] = DeviceImage(self._context.device.upload(xyz, f"camera: {name}"), shape)
            self._shown[name] = of
        return self._images[name]
