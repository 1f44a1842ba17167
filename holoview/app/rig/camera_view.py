"""What a rig's camera sees beside its prediction, with wipe, difference in σ, χ²/n, and values under the pointer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.app.readout import draw_centred_text, draw_label
from holoview.app.viewport import Viewport, VisibleArea, visible_area_of
from holoview.experiment.live.live_view import LiveView
from holoview.experiment.live.rig_session import MODELS
from holoview.render.scene import DeviceImage
from holoview.render.view_settings import ViewSettings

_SPANS = (3.0, 5.0, 10.0, 30.0, 100.0)
_TIPS = {
    "show": "Difference: camera − prediction, in standard deviations of the noise. Blue: too dark, red: too bright.",
    "predicted by": "rig.toml: the nominal bench. The viewer's bench: with its gap, stops and effects. The "
    "diagnosis: the nominal bench with what the last diagnosis found.",
}
MODES = ("side-by-side", "wipe", "difference", "camera", "prediction")
"""What is shown of camera and prediction."""
_VIEW = ViewSettings(plane_m=0.0, channel="luminance")


class CameraPanes:
    """Shows what the camera sees and what it should see. model: one of MODELS."""

    def __init__(self, context: AppContext) -> None:
        self.picture = CameraPicture(context)
        self.model = MODELS[0]

    def draw(self, context: AppContext) -> None:
        """Draws the choices, the pictures, and values under the pointer."""
        self._draw_choices(context, self.picture)
        available = imgui.get_content_region_avail()
        footer = imgui.get_text_line_height_with_spacing() + 2
        size = (max(int(available.x), 16), max(int(available.y - footer), 16))
        corner = imgui.get_cursor_screen_pos()
        if not self.picture.draw(context.rig.view, size, corner):
            draw_centred_text(_waiting_text(context), size)
            return
        imgui.invisible_button("##camera", imgui.ImVec2(*size))
        context.record_item_rect("camera")
        self._draw_labels(context, self.picture, corner, size)
        self._drag_wipe(self.picture, corner, size)
        imgui.text_disabled(self._under_pointer(context, self.picture, corner))

    def _draw_choices(self, context: AppContext, picture: CameraPicture) -> None:
        em = imgui.get_font_size()
        imgui.set_next_item_width(8 * em)
        _, index = imgui.combo("##show", MODES.index(picture.mode), list(MODES))
        tooltip(_TIPS["show"])
        picture.mode = MODES[index]
        imgui.same_line()
        imgui.set_next_item_width(9 * em)
        _, index = imgui.combo("##model", MODELS.index(self.model), [f"by {name}" for name in MODELS])
        tooltip(_TIPS["predicted by"])
        self.model = MODELS[index]
        context.rig.choose_model(self.model)
        imgui.same_line()
        imgui.set_next_item_width(-1)
        if picture.mode == "difference":
            _, index = imgui.combo("##span", _SPANS.index(picture.span_sigmas), [f"±{span:g} σ" for span in _SPANS])
            picture.span_sigmas = _SPANS[index]
        else:
            _, picture.stops = imgui.slider_float("##stops", picture.stops, -4.0, 8.0, "%.1f stops")
            tooltip("Brightens both pictures alike, on the screen only.")

    def _draw_labels(
        self, context: AppContext, picture: CameraPicture, corner: imgui.ImVec2, size: tuple[int, int]
    ) -> None:
        """The names of both sides, and χ²/n in the corner."""
        found, draw_list = context.rig.view.prediction, imgui.get_window_draw_list()
        predicted = "" if found is None else f"prediction by {found.model}"
        b_at = {"side-by-side": 0.5, "wipe": picture.wipe}.get(picture.mode)
        first = {"difference": f"camera − {predicted}", "prediction": predicted}.get(picture.mode, "camera")
        draw_label(draw_list, first, imgui.ImVec2(corner.x + 8, corner.y + 6))
        if b_at is not None and predicted:
            draw_label(draw_list, predicted, imgui.ImVec2(corner.x + b_at * size[0] + 8, corner.y + 6))
        text = _waiting_text(context) if found is None else f"χ²/n {found.chi2:.3g}"
        width = imgui.calc_text_size(text).x
        draw_label(draw_list, text, imgui.ImVec2(corner.x + size[0] - width - 10, corner.y + size[1] - 24))

    def _drag_wipe(self, picture: CameraPicture, corner: imgui.ImVec2, size: tuple[int, int]) -> None:
        if picture.mode == "wipe" and imgui.is_item_active():
            picture.wipe = float(np.clip((imgui.get_io().mouse_pos.x - corner.x) / size[0], 0.0, 1.0))

    def _under_pointer(self, context: AppContext, picture: CameraPicture, corner: imgui.ImVec2) -> str:
        """Values of the pixel under the pointer, else a hint."""
        view, area = context.rig.view, picture.area
        if view.picture is None or area is None or not imgui.is_item_hovered():
            return context.rig.waiting or "χ²/n: mean squared difference in σ; noise alone gives 1"
        scale, at = imgui.get_io().display_framebuffer_scale.x, imgui.get_io().mouse_pos
        x, y = (at.x - corner.x) * scale, (at.y - corner.y) * scale
        is_pair = picture.view_settings.compare == "side-by-side" and view.prediction is not None
        u, v = area.to_image(x % (area.size[0] // 2) if is_pair else x, y)
        rows, columns = view.picture.counts.shape
        row, column = int(v * rows), int(u * columns)
        if not (0 <= u < 1 and 0 <= v < 1):
            return ""
        counts = int(view.picture.counts[row, column])
        if view.prediction is None:
            return f"({column}, {row})   {counts} counts"
        expected = view.prediction.expected[row, column] + view.picture.black
        sigmas = view.prediction.residual[row, column]
        return f"({column}, {row})   {counts} counts   expected {expected:.0f}   {sigmas:+.1f} σ"


def _waiting_text(context: AppContext) -> str:
    """Why there is no picture or no prediction."""
    rig = context.rig
    if rig.status != "open":
        return f"the rig is {rig.status}"
    if rig.view.picture is None:
        return rig.waiting or "no picture yet"
    missing = rig.state.missing
    return f"for a prediction: {missing}" if missing else rig.view.problem or "computing the prediction"


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
