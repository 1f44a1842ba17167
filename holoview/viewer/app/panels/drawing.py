"""The panel in which the bench is drawn as a strip, from the source to the eye.

A click chooses an element, whose keys the panel Element has; a drag on a length changes it. The left and right arrows
choose the next one while the strip has the keys. Below the image its dock grows to the height of the strip, so that the
image stays in view.
"""

from __future__ import annotations

import itertools
import math

from imgui_bundle import hello_imgui, imgui

from holoview.light.model.bench_drawing import draw_bench
from holoview.light.model.elements import Space
from holoview.light.model.system import System
from holoview.util.drawing import Drawing, DrawnLine, colour_of, line_width
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.panels.element import ElementPanel
from holoview.viewer.app.widgets import FINE, show_tooltip
from holoview.viewer.document import chain_edits

_LARGEST_SCALE = 1.5  # over the least, at which its texts are as large as others
_MOST_SHARE = 0.45  # of the window's height that its dock grows to, whatever the size of text
_FONT_PT = 14.0  # of a panel's text of usual size
_PANELS = {"wavelengths": "Lasers", "planes": "Focal plane", "eye": "Eye", "observer": "Lasers"}
_SEEN_TO = 0.9  # of the panel's width, at which the first length ends when it opens
_DECADE_PX = 300.0  # of a drag for a factor of ten
_OFF_COLOUR = imgui.IM_COL32(255, 255, 255, 190)


class DrawingPanel(Panel):
    """Draws the bench of the session, the parts in the order of the light, and frames the chosen element."""

    title = "Drawing"
    dock = "Bottom"
    starts_open = False

    def __init__(self) -> None:
        self._dragged = ""
        self._has_moved = False
        self._drawing: tuple[object, Drawing] | None = None
        self._is_new = True
        self._grown: tuple[int, float] | None = None  # the dock that has grown for it, and its height before

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel, and that of the chosen element."""

        def show() -> None:
            context.show_panel(ElementPanel.title)
            context.show_panel(self.title)

        help = "Lasers, elements, spaces, planes and eye, with their distances: click one to edit it."
        context.commands.add("Window", "Draw the bench", show, help=help)

    def wants_to_open(self, context: AppContext) -> bool:
        """Never; once it was closed, its dock gets the height back, and grows anew with the next opening."""
        window = hello_imgui.get_runner_params().docking_params.dockable_window_of_name(self.title)
        if window is not None and not window.is_visible:
            self._is_new = True
            if self._grown is not None:
                _set_height(*self._grown)
                self._grown = None
        return False

    def draw(self, context: AppContext) -> None:
        """Draws it as wide as the panel, and scrolls where its texts would become too small."""
        system = context.session.system
        if self._drawing is None or self._drawing[0] is not system:
            self._drawing = system, draw_bench(system)
        drawing = self._drawing[1]
        least = imgui.get_font_size() / _FONT_PT
        room = imgui.get_content_region_avail()
        scale = min(max(room.x / drawing.width, least), _LARGEST_SCALE * least)
        if begins := self._is_new and room.y > 1:
            self._grow_dock(math.ceil(drawing.height * scale + imgui.get_style().scrollbar_size - room.y))
        scale = min(scale, max(room.y / drawing.height, least))
        self._draw_strip(context, drawing, scale, begins=begins)

    def _grow_dock(self, missing: float) -> None:
        """Makes its dock higher by what is missing, once after it was opened; a splitter moves it as ever."""
        self._is_new = False
        node, most = imgui.internal.get_current_window().dock_node, _MOST_SHARE * imgui.get_main_viewport().size.y
        if node is not None and missing > 0 and not (node.is_floating_node() or node.is_central_node()):
            self._grown = node.id_, node.size.y
            _set_height(node.id_, max(min(node.size.y + missing, most), node.size.y))

    # --- the strip --------------------------------------------------------------------------------------------------

    def _draw_strip(self, context: AppContext, drawing: Drawing, scale: float, *, begins: bool) -> None:
        """Draws it. begins: whether it has just been opened, and the first length is scrolled into view."""
        flags = imgui.WindowFlags_.horizontal_scrollbar
        if imgui.begin_child("drawing", imgui.ImVec2(0, 0), imgui.ChildFlags_.nav_flattened, flags):
            corner = imgui.get_cursor_screen_pos()
            size = imgui.ImVec2(drawing.width * scale, drawing.height * scale)
            imgui.invisible_button("##bench", size, imgui.ButtonFlags_.enable_nav)
            context.record_item_rect("bench drawing")
            has_keys = imgui.is_item_focused() and imgui.get_io().nav_visible
            if begins:
                system = context.session.system
                right = min(box[2] for key, box in drawing.areas if key == "planes" or _length(system, key)[1])
                imgui.set_scroll_x(max(right * scale - _SEEN_TO * imgui.get_window_width(), 0.0))
            _paint(drawing, corner, scale)
            self._mark(context, drawing, corner, scale)
            self._answer_mouse(context, drawing, corner, scale)
            if has_keys:
                self._answer_keys(context, drawing, scale)
        imgui.end_child()

    def _mark(self, context: AppContext, drawing: Drawing, corner: imgui.ImVec2, scale: float) -> None:
        """Frames what is chosen, and pales what is switched off."""
        canvas, document = imgui.get_window_draw_list(), context.session.document
        accent = imgui.color_convert_float4_to_u32(theme.signal_colour("accent"))
        for key, (left, top, right, bottom) in drawing.areas:
            name = element_of(document.system, key)
            low = imgui.ImVec2(corner.x + left * scale, corner.y + top * scale)
            high = imgui.ImVec2(corner.x + right * scale, corner.y + bottom * scale)
            if name and not chain_edits.is_on(document, name):
                canvas.add_rect_filled(low, high, _OFF_COLOUR)
            if name and name == context.chosen_element:
                canvas.add_rect(low, high, accent, 3.0, 2.0)

    def _answer_mouse(self, context: AppContext, drawing: Drawing, corner: imgui.ImVec2, scale: float) -> None:
        system, mouse = context.session.system, imgui.get_io().mouse_pos
        key = drawing.key_at((mouse.x - corner.x) / scale, (mouse.y - corner.y) / scale)
        if imgui.is_item_activated() and imgui.is_mouse_down(imgui.MouseButton_.left):
            self._dragged, self._has_moved = key, False
        length_m, path = _length(system, self._dragged)
        moved = imgui.get_io().mouse_delta.x
        if imgui.is_item_active() and length_m and moved:
            self._has_moved = True
            moved *= FINE if imgui.get_io().key_alt else 1.0
            factor = math.pow(10.0, moved / _DECADE_PX)
            new_m = float(f"{min(length_m * factor, 1.0):.6g}")
            context.change("Gap" if path == "gap" else "Distance", path, new_m, is_held=True)
        if imgui.is_item_deactivated():
            if self._has_moved:
                context.session.end_gesture()
            elif self._dragged and key == self._dragged:
                self._choose(context, key)
            self._dragged = ""
        if imgui.is_item_hovered() and key and not self._dragged:
            show_tooltip(_tip(system, key))

    def _choose(self, context: AppContext, key: str) -> None:
        """Chooses the element of a key, and opens its panel, or that of what is none."""
        context.chosen_element = element_of(context.session.system, key) or context.chosen_element
        context.show_panel(_PANELS.get(key.partition(".")[0], ElementPanel.title))

    def _answer_keys(self, context: AppContext, drawing: Drawing, scale: float) -> None:
        names = context.session.system.element_names
        for key, step in ((imgui.Key.left_arrow, -1), (imgui.Key.right_arrow, 1)):
            imgui.set_item_key_owner(key)
            if imgui.is_key_pressed(key):
                name = names[min(max(names.index(context.chosen_element) + step, 0), len(names) - 1)]
                context.chosen_element = name
                areas = [box for of, box in drawing.areas if element_of(context.session.system, of) == name]
                if areas:
                    imgui.set_scroll_x(max(areas[0][0] * scale - imgui.get_window_width() / 2, 0.0))


def element_of(system: System, key: str) -> str:
    """The name of the element that a key of the drawing stands for; "" for lasers, planes and who looks."""
    names = system.element_names
    kind, _, number = key.partition(".")
    places = {"gap": 1, "relay1": 1, "relay2": len(names) - 1}
    if kind in ("elements", "modulators"):
        return names[int(number) * (1 if kind == "elements" else 2)]
    return names[places[kind]] if kind in places else ""


def _set_height(dock: int, height: float) -> None:
    """Sets the height of a dock beside the middle one, which takes the rest, from the next frame on."""
    node = imgui.internal.dock_builder_get_node(dock)
    if node is not None:
        imgui.internal.dock_builder_set_node_size(dock, imgui.ImVec2(node.size.x, height))


def _length(system: System, key: str) -> tuple[float | None, str]:
    """The length of the space that a key of the drawing stands for, and its key in the system; None of others."""
    name = element_of(system, key)
    if not name or key.startswith(("modulators", "relay")):
        return None, ""
    element = system.elements[system.part(name)]
    path = "gap" if key == "gap" else f"elements.{name}.distance"
    return (element.distance_m, path) if isinstance(element, Space) else (None, "")


def _tip(system: System, key: str) -> str:
    name, (length_m, _) = element_of(system, key), _length(system, key)
    if length_m:
        return f"{name}: drag to change its length, click to edit it"
    return f"{name}: click to edit it" if name else f"{key}: click to open its panel"


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
