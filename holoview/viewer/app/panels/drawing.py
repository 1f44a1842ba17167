"""The panel in which the bench is drawn: a click on a part opens its panel, a drag of the gap changes it."""

from __future__ import annotations

import itertools
import math
from functools import partial

from imgui_bundle import imgui

from holoview.light.model.bench_drawing import draw_bench
from holoview.util.drawing import Drawing, DrawnLine, colour_of, line_width
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.widgets import FINE, show_tooltip

_LARGEST_SCALE = 1.5  # over the least, at which its texts are as large as others
_FONT_PT = 14.0  # of a panel's text of usual size
_PANELS = {"wavelengths": "Lasers", "planes": "Focal plane", "eye": "Eye", "observer": "Lasers"}
_DECADE_PX = 300.0  # of a drag for a factor of ten


class DrawingPanel(Panel):
    """Draws the bench of the session, the parts in the order of the light."""

    title = "Drawing"
    dock = "Centre"
    starts_open = False

    def __init__(self) -> None:
        self._dragged: str = ""
        self._drawing: tuple[object, Drawing] | None = None

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        show = partial(context.show_panel, self.title)
        help = "Lasers, modulators, relays, planes and eye, with their distances."
        context.commands.add("Window", "Draw the bench", show, help=help)

    def draw(self, context: AppContext) -> None:
        """Draws it as wide as the panel, and scrolls where its texts would become too small."""
        system = context.session.system
        if self._drawing is None or self._drawing[0] is not system:
            self._drawing = system, draw_bench(system)
        drawing = self._drawing[1]
        room = imgui.get_content_region_avail()
        least = imgui.get_font_size() / _FONT_PT
        scale = min(max(room.x / drawing.width, least), _LARGEST_SCALE * least)
        flags = imgui.WindowFlags_.horizontal_scrollbar
        if imgui.begin_child("drawing", imgui.ImVec2(0, 0), imgui.ChildFlags_.none, flags):
            corner = imgui.get_cursor_screen_pos()
            imgui.invisible_button("##bench", imgui.ImVec2(drawing.width * scale, drawing.height * scale))
            context.record_item_rect("bench drawing")
            _paint(drawing, corner, scale)
            self._answer_mouse(context, drawing, corner, scale)
        imgui.end_child()

    def _answer_mouse(self, context: AppContext, drawing: Drawing, corner: imgui.ImVec2, scale: float) -> None:
        mouse = imgui.get_io().mouse_pos
        key = drawing.key_at((mouse.x - corner.x) / scale, (mouse.y - corner.y) / scale)
        if imgui.is_item_activated():
            self._dragged = key
        gap_m, moved = context.session.system.gap_m, imgui.get_io().mouse_delta.x
        if imgui.is_item_active() and self._dragged == "gap" and gap_m and moved:
            moved *= FINE if imgui.get_io().key_alt else 1.0
            factor = math.pow(10.0, moved / _DECADE_PX)
            context.change("Gap", "gap", float(f"{min(gap_m * factor, 1.0):.6g}"), is_held=True)
        if imgui.is_item_deactivated():
            if self._dragged == "gap":
                context.session.end_gesture()
            elif self._dragged and key == self._dragged:
                context.show_panel(_PANELS.get(key.partition(".")[0], "Bench"))
            self._dragged = ""
        if imgui.is_item_hovered() and key and not self._dragged:
            what = "drag to change it" if key == "gap" else "click to open its panel"
            show_tooltip(f"{key}: {what}")


def _paint(drawing: Drawing, corner: imgui.ImVec2, scale: float) -> None:
    canvas, font = imgui.get_window_draw_list(), imgui.get_font()

    def place(x: float, y: float) -> imgui.ImVec2:
        return imgui.ImVec2(corner.x + x * scale, corner.y + y * scale)

    canvas.add_rect_filled(place(0, 0), place(drawing.width, drawing.height), _colour("#ffffff"))
    for stroke in drawing.strokes:
        points = [place(*point) for point in stroke.points]
        if stroke.is_filled:
            _fill(canvas, stroke, points)
        else:
            width = max(line_width(stroke.role) * scale, 1.0)
            for first, second in itertools.pairwise(points):
                canvas.add_line(first, second, _colour(colour_of(stroke.role)), width)
    for label in drawing.labels:
        size = label.size * scale
        width = imgui.calc_text_size(label.text).x * size / imgui.get_font_size()
        at = place(label.x, label.y)
        at = imgui.ImVec2(at.x - width / 2, at.y - size / 2)
        canvas.add_text(font, size, at, _colour(colour_of(label.role)), label.text)


def _fill(canvas: imgui.ImDrawList, stroke: DrawnLine, points: list[imgui.ImVec2]) -> None:
    """Fills an area that lies between a line and the same number of points on its way back."""
    colour, count = _colour(colour_of(stroke.role)), len(points)
    for n in range(count // 2 - 1):
        canvas.add_quad_filled(points[n], points[n + 1], points[count - 2 - n], points[count - 1 - n], colour)


def _colour(text: str) -> int:
    """ImGui's colour of #rrggbb."""
    red, green, blue = (int(text[place : place + 2], 16) / 255 for place in (1, 3, 5))
    return imgui.color_convert_float4_to_u32(imgui.ImVec4(red, green, blue, 1.0))
