"""What a rig's camera sees beside its prediction, with wipe, difference in σ, χ²/n, and values under the pointer."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.app.readout import draw_centred_text, draw_label
from holoview.app.rig.camera_picture import MODES, CameraPicture
from holoview.experiment.live.rig_session import MODELS

_SPANS = (3.0, 5.0, 10.0, 30.0, 100.0)
_TIPS = {
    "show": "Difference: camera − prediction, in standard deviations of the noise. Blue: too dark, red: too bright.",
    "predicted by": "rig.toml: the nominal bench. The viewer's bench: with its gap, stops and effects. The "
    "diagnosis: the nominal bench with what the last diagnosis found.",
}


class CameraView:
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
