"""The panel in which the bench is drawn as a strip, from the source to the eye, and its elements are edited.

A click chooses an element, whose keys stand below; a drag on a length changes it. The left and right arrows choose the
next one while the strip has the keys.
"""

from __future__ import annotations

import itertools
import math
from functools import partial

from imgui_bundle import imgui

from holoview.light.model.bench_drawing import draw_bench
from holoview.light.model.chain import place_of
from holoview.light.model.elements import FieldPlane, Pixels, Space
from holoview.light.model.system import System
from holoview.util.drawing import Drawing, DrawnLine, colour_of, line_width
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.parameter_widgets import draw_element
from holoview.viewer.app.widgets import FINE, button, combo, pale, show_tooltip, wrapped_text
from holoview.viewer.document import chain_edits

_LARGEST_SCALE = 1.5  # over the least, at which its texts are as large as others
_FONT_PT = 14.0  # of a panel's text of usual size
_PANELS = {"wavelengths": "Lasers", "planes": "Focal plane", "eye": "Eye", "observer": "Lasers"}
_DECADE_PX = 300.0  # of a drag for a factor of ten
_OFF_COLOUR = imgui.IM_COL32(255, 255, 255, 190)
_ADD = "Add behind it …"


class DrawingPanel(Panel):
    """Draws the bench of the session, the parts in the order of the light, and the keys of the chosen element.

    chosen: its name; that of the first if it isn't there.
    """

    title = "Drawing"
    dock = "Centre"
    starts_open = False

    def __init__(self) -> None:
        self.chosen, self._dragged = "", ""
        self._has_moved = False
        self._drawing: tuple[object, Drawing] | None = None
        self._reset: System | None = None

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        show = partial(context.show_panel, self.title)
        help = "Lasers, elements, spaces, planes and eye, with their distances: click one to edit it."
        context.commands.add("Window", "Draw the bench", show, help=help)

    def draw(self, context: AppContext) -> None:
        """Draws it as wide as the panel, and scrolls where its texts would become too small."""
        system = context.session.system
        if self._drawing is None or self._drawing[0] is not system:
            self._drawing = system, draw_bench(system)
            if self._reset is None or self._reset.element_names != system.element_names:
                self._reset = system
        if self.chosen not in system.element_names:
            self.chosen = system.element_names[0]
        self._draw_strip(context, self._drawing[1])
        self._draw_off(context)
        if imgui.begin_child("element", imgui.ImVec2(0, 0), imgui.ChildFlags_.nav_flattened):
            self._draw_actions(context)
            self._draw_keys(context)
        imgui.end_child()

    # --- the strip --------------------------------------------------------------------------------------------------

    def _draw_strip(self, context: AppContext, drawing: Drawing) -> None:
        least = imgui.get_font_size() / _FONT_PT
        room = imgui.get_content_region_avail().x
        scale = min(max(room / drawing.width, least), _LARGEST_SCALE * least)
        height = drawing.height * scale + imgui.get_style().scrollbar_size + 2 * imgui.get_style().window_padding.y
        flags = imgui.WindowFlags_.horizontal_scrollbar
        if imgui.begin_child("drawing", imgui.ImVec2(0, height), imgui.ChildFlags_.nav_flattened, flags):
            corner = imgui.get_cursor_screen_pos()
            size = imgui.ImVec2(drawing.width * scale, drawing.height * scale)
            imgui.invisible_button("##bench", size, imgui.ButtonFlags_.enable_nav)
            context.record_item_rect("bench drawing")
            has_keys = imgui.is_item_focused() and imgui.get_io().nav_visible
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
            if name and name == self.chosen:
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
        """Chooses the element of a key, and opens the panel of what is none, or of a short form's."""
        system = context.session.system
        self.chosen = element_of(system, key) or self.chosen
        of = key.partition(".")[0]
        if of in _PANELS or not system.is_chain:
            context.show_panel(_PANELS.get(of, "Bench"))

    def _answer_keys(self, context: AppContext, drawing: Drawing, scale: float) -> None:
        names = context.session.system.element_names
        for key, step in ((imgui.Key.left_arrow, -1), (imgui.Key.right_arrow, 1)):
            imgui.set_item_key_owner(key)
            if imgui.is_key_pressed(key):
                self.chosen = names[min(max(names.index(self.chosen) + step, 0), len(names) - 1)]
                areas = [box for of, box in drawing.areas if element_of(context.session.system, of) == self.chosen]
                if areas:
                    imgui.set_scroll_x(max(areas[0][0] * scale - imgui.get_window_width() / 2, 0.0))

    # --- the chosen element -----------------------------------------------------------------------------------------

    def _draw_off(self, context: AppContext) -> None:
        """Draws a button for each element that was taken away by switching it off."""
        document = context.session.document
        for parked in document.parked:
            if parked.name in document.system.element_names:
                continue
            imgui.text_disabled(f"{parked.name} is switched off")
            imgui.same_line()
            if button(context, f"Switch on##{parked.name}", name=f"switch on {parked.name}"):
                context.attempt(chain_edits.switch_element, context.session, parked.name)

    def _draw_actions(self, context: AppContext) -> None:
        session, name = context.session, self.chosen
        imgui.separator_text(f"{name}  ·  {_kind(session.system, name)}")
        edit = context.attempt
        is_on = chain_edits.is_on(session.document, name)
        tip = "A modulator passes all light then, a space has no stops, others aren't there; on again as it was."
        if button(context, "Switch off" if is_on else "Switch on", tip, name="switch element"):
            edit(chain_edits.switch_element, session, name)
        imgui.same_line()
        if button(context, "Remove", "Takes it away; undo brings it back.", name="remove element"):
            edit(chain_edits.remove_element, session, name)
        for label, step in (("<", -1), (">", 1)):
            imgui.same_line()
            where = "before" if step < 0 else "behind"
            if button(context, label, f"Exchanges it with the element {where} it; spaces stay.", name=f"move {where}"):
                edit(chain_edits.move_element, session, name, step)
        imgui.same_line()
        if button(
            context, "Light behind it", "In the image; Escape goes back to the focal plane.", name="light behind"
        ):
            edit(self._show_light, context, name)
        width = imgui.get_font_size() * 9
        kind = combo("##add", _ADD, (_ADD, *chain_edits.ADDED_KINDS), "In the middle of a space.", width)
        context.record_item_rect("add element")
        if kind != _ADD:
            edit(self.add, context, kind)

    def add(self, context: AppContext, kind: str) -> None:
        """Adds an element of a kind behind the chosen one, and chooses it. Raises UserError where it can't be."""
        self.chosen = chain_edits.add_element(context.session, kind, self.chosen)

    def _show_light(self, context: AppContext, name: str) -> None:
        stage = context.session.system.stage_behind(name)
        context.session.edit_view("Light behind", page="field", stage=stage, quantity="intensity", compare="off")
        context.show_panel("Image")

    def _draw_keys(self, context: AppContext) -> None:
        session, name = context.session, self.chosen
        system = session.system
        if name not in system.element_names:
            return
        index = system.part(name)
        element, reset = system.elements[index], (self._reset or system).elements[min(index, len(system.elements) - 1)]
        if not system.is_chain and isinstance(element, Pixels) and not isinstance(element, FieldPlane):
            count = len(system.modulators)
            both = "both have one pitch and shape, which change together; " if count == 2 else ""
            tail = "its place is the axis, and its patterns are of each frame"
            wrapped_text(f"A modulator of the short form: {both}{tail}.", pale())
        if isinstance(element, Space) and element.distance_m is None:
            imgui.text_disabled("Its length is told by the planes.")
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.56)
        draw_element(context, system, element, reset if type(reset) is type(element) else element, name)
        imgui.pop_item_width()


def _kind(system: System, name: str) -> str:
    """What an element is: its kind, and its place in a short form."""
    index, count = system.part(name), len(system.elements)
    kind = system.elements[index].kind
    return kind if system.is_chain else f"{kind}, {place_of(index, count)}"


def element_of(system: System, key: str) -> str:
    """The name of the element that a key of the drawing stands for; "" for lasers, planes and who looks."""
    names = system.element_names
    kind, _, number = key.partition(".")
    places = {"gap": 1, "relay1": 1, "relay2": len(names) - 1}
    if kind in ("elements", "modulators"):
        return names[int(number) * (1 if kind == "elements" else 2)]
    return names[places[kind]] if kind in places else ""


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
