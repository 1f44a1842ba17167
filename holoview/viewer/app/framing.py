"""The framing of a target: fill, fit, or crop with a frame of the modulators' aspect that is dragged on the picture."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from holoview.holograms.targets.framing import KINDS, LEAST_SHARE, Framing
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.viewport import Viewport, next_corner
from holoview.viewer.app.widgets import combo, fine_slider, tooltip, wrapped_text
from holoview.viewer.document.target_builder import TargetSpec, thumbnail_xyz
from holoview.viewer.render.scene import DeviceImage, uploaded_image
from holoview.viewer.render.view_settings import ViewSettings

_HEIGHT_EM = 10.0
_GRIP_PX = 7.0  # from an edge of the frame, within which a drag changes its size
_PER_NOTCH = 0.9  # of the wheel, on the size of the frame
_OWN_COLOURS = ViewSettings(plane_m=0.0)
_SHADE, _FRAME = imgui.IM_COL32(0, 0, 0, 150), imgui.IM_COL32(255, 220, 80, 255)
_DOCS = {
    "fill": "The largest part that fills the modulators, from the middle.",
    "fit": "All of the picture, with black beside it.",
    "crop": "The part inside the frame: drag it, or its edge; the wheel changes its size.",
}


class FramingEditor:
    """Draws the framing of the session's target, if that is a picture."""

    def __init__(self) -> None:
        self._shown: tuple[object, DeviceImage] | None = None  # the source of the small picture, and it
        self._viewport: Viewport | None = None
        self._resizes = False  # by the present drag

    def draw(self, context: AppContext, target_spec: TargetSpec) -> None:
        """Draws the choice, what is cut off in words, and the picture with its frame."""
        session, framing = context.session, target_spec.placement.framing
        said = target_spec.framing_text(session.system)
        is_open = imgui.collapsing_header("Framing", imgui.TreeNodeFlags_.default_open if said else 0)
        context.record_item_rect("framing header")
        if not is_open:
            return
        kind = combo("framing", framing.kind, KINDS, _DOCS[framing.kind])
        context.record_item_rect("framing")
        if kind != framing.kind:
            framing = replace(framing, kind=kind)
            _edit(context, target_spec, framing)
        if said:
            wrapped_text(said, theme.signal_colour("warning"))
            context.record_item_rect("what is cut off")
        self._draw_picture(context, target_spec, framing)
        if framing.kind == "crop":
            _draw_numbers(context, target_spec, framing)

    def _draw_picture(self, context: AppContext, target_spec: TargetSpec, framing: Framing) -> None:
        if self._shown is None or self._shown[0] is not target_spec.source:
            xyz = thumbnail_xyz(target_spec)
            self._shown = target_spec.source, uploaded_image(context.device, xyz, "framed picture")
        picture = self._shown[1]
        self._viewport = self._viewport or Viewport(context, "framing")
        room = imgui.get_content_region_avail().x, _HEIGHT_EM * imgui.get_font_size()
        scale = min(room[0] / picture.shape[1], room[1] / picture.shape[0])
        size = max(int(picture.shape[1] * scale), 8), max(int(picture.shape[0] * scale), 8)
        corner = next_corner()
        self._viewport.draw(picture, None, _OWN_COLOURS, size, corner, is_stretched=True)
        imgui.invisible_button("##framed picture", imgui.ImVec2(*size))
        context.record_item_rect("framed picture")
        tooltip(_DOCS["crop"])
        if framing.kind != "fit":
            self._handle_pointer(context, target_spec, framing, corner, size)
            low, high = _frame(context, target_spec, framing, corner, size)
            _draw_frame(low, high, corner, imgui.ImVec2(corner.x + size[0], corner.y + size[1]))

    def _handle_pointer(
        self,
        context: AppContext,
        target_spec: TargetSpec,
        framing: Framing,
        corner: imgui.ImVec2,
        size: tuple[int, int],
    ) -> None:
        """A drag moves the frame, one of its edge changes its size, as the wheel does."""
        io = imgui.get_io()
        low, high = _frame(context, target_spec, framing, corner, size)
        middle = imgui.ImVec2((low.x + high.x) / 2, (low.y + high.y) / 2)
        away = abs(io.mouse_pos.x - middle.x), abs(io.mouse_pos.y - middle.y)
        halves = (high.x - low.x) / 2, (high.y - low.y) / 2
        share = framing.share if framing.kind == "crop" else 1.0
        if imgui.is_item_activated():
            context.session.end_gesture()
            self._resizes = any(abs(px - half) < _GRIP_PX for px, half in zip(away, halves, strict=True))
        centre = (middle.x - corner.x) / size[0], (middle.y - corner.y) / size[1]
        moved = bool(io.mouse_delta.x or io.mouse_delta.y) and imgui.is_item_active()
        if imgui.is_item_hovered():
            imgui.set_item_key_owner(imgui.Key.mouse_wheel_y)  # before it turns: else the panel scrolls
        if imgui.is_item_hovered() and io.mouse_wheel:
            share *= _PER_NOTCH**io.mouse_wheel
        elif moved and self._resizes:
            share *= max(px / max(half, 1.0) for px, half in zip(away, halves, strict=True))
        elif moved:
            centre = centre[0] + io.mouse_delta.x / size[0], centre[1] + io.mouse_delta.y / size[1]
        else:
            if imgui.is_item_deactivated():
                context.session.end_gesture()
            return
        inside = tuple(min(max(value, 0.0), 1.0) for value in centre)
        share = min(max(share, LEAST_SHARE), 1.0)
        _edit(context, target_spec, Framing("crop", (inside[0], inside[1]), float(f"{share:.4g}")))


def _frame(
    context: AppContext, target_spec: TargetSpec, framing: Framing, corner: imgui.ImVec2, size: tuple[int, int]
) -> tuple[imgui.ImVec2, imgui.ImVec2]:
    """The upper left and the lower right corner of the frame on the screen."""
    left, top, right, bottom = target_spec.framed_part(context.session.system, framing)
    return (
        imgui.ImVec2(corner.x + left * size[0], corner.y + top * size[1]),
        imgui.ImVec2(corner.x + right * size[0], corner.y + bottom * size[1]),
    )


def _draw_frame(low: imgui.ImVec2, high: imgui.ImVec2, corner: imgui.ImVec2, end: imgui.ImVec2) -> None:
    canvas = imgui.get_window_draw_list()
    canvas.add_rect_filled(corner, imgui.ImVec2(end.x, low.y), _SHADE)
    canvas.add_rect_filled(imgui.ImVec2(corner.x, high.y), end, _SHADE)
    canvas.add_rect_filled(imgui.ImVec2(corner.x, low.y), imgui.ImVec2(low.x, high.y), _SHADE)
    canvas.add_rect_filled(imgui.ImVec2(high.x, low.y), imgui.ImVec2(end.x, high.y), _SHADE)
    canvas.add_rect(low, high, _FRAME, 0, 1.5)


def _draw_numbers(context: AppContext, target_spec: TargetSpec, framing: Framing) -> None:
    """Size and centre of the frame, to be typed with Ctrl+click."""
    numbers = {"size": framing.share, "centre x": framing.centre[0], "centre y": framing.centre[1]}
    edited = dict(numbers)
    for name, value in numbers.items():
        low = LEAST_SHARE if name == "size" else 0.0
        changed, shown = fine_slider(name, value, low, 1.0, "%.3f", imgui.SliderFlags_.always_clamp)
        context.record_item_rect(f"framing {name}")
        tooltip("Of the largest part." if name == "size" else "Of the frame, as a fraction of the picture.")
        if changed:
            edited[name] = float(f"{shown:.4g}")
    if edited != numbers:
        size, x, y = edited.values()
        _edit(context, target_spec, Framing("crop", (x, y), size))


def _edit(context: AppContext, target_spec: TargetSpec, framing: Framing) -> None:
    if framing != target_spec.placement.framing:
        framed = target_spec.with_framing(framing)
        context.attempt(context.session.edit, "Framing", target_spec=framed, merge_key="framing")
