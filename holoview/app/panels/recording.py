"""The panel of an off-axis recording: the order that its field is cut out of, on its spectrum, to drag."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.viewport import Viewport
from holoview.app.widgets import button, combo, share_of_width, tooltip
from holoview.io.load_field import RecordedOrders
from holoview.render.view_settings import ViewSettings
from holoview.wavefield.reading import Recording

_OWN_COLOURS = ViewSettings(plane_m=0.0, page="field")
_MARK, _TWIN = imgui.IM_COL32(255, 220, 80, 255), imgui.IM_COL32(255, 220, 80, 90)
_EDGE_PX = 6.0  # from the circle, within which a drag changes its radius
_RADII = (0.005, 0.5)  # cycles a pixel
_HELP = (
    "The light inside the circle is the field; the other circle holds its conjugate. Drag the circle, or its edge; a "
    "click elsewhere moves it there."
)


class RecordingPanel(Panel):
    """Shows the spectrum of a recording; a drag moves the circle around the order, and the image follows."""

    title = "Recording"
    dock = "Low right"
    starts_open = False

    def __init__(self) -> None:
        self._wavelength = 0
        self._grip: tuple[float, float] | None = None  # from the pointer to the centre; None: the radius is dragged
        self._shown: Recording | None = None

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        show = partial(context.show_panel, self.title)
        context.commands.add("Image", "Order of a recording", show, help=_HELP)
        self._picture = Viewport(context, "spectrum of a recording")

    def wants_to_open(self, context: AppContext) -> bool:
        """With a recording that is new."""
        recorded, shown = context.session.document.recorded, self._shown
        self._shown = None if recorded is None else recorded.recording
        return self._shown is not None and self._shown is not shown

    def draw(self, context: AppContext) -> None:
        """Draws buttons and the spectrum with the circles."""
        chosen = context.order_editor.chosen
        if chosen is None:
            imgui.text_wrapped("Open an off-axis recording of a camera: its order is shown here.")
            return
        self._draw_choices(context, chosen)
        picture = context.page_images.recording(chosen.recording, self._wavelength)
        order = chosen.orders[self._wavelength]
        y, x = order.carrier
        imgui.text_wrapped(f"x {x:+.4f}, y {y:+.4f}, radius {order.radius:.4f} cycles a pixel")
        if picture is None:
            return
        available = imgui.get_content_region_avail()
        side = max(int(min(available.x, available.y)), 64)
        corner = imgui.get_cursor_screen_pos()
        corner = imgui.ImVec2(float(round(corner.x)), float(round(corner.y)))
        self._picture.draw(picture, None, _OWN_COLOURS, (side, side), corner, is_stretched=True)
        imgui.invisible_button("##recording", imgui.ImVec2(side, side))
        context.record_item_rect("recording")
        tooltip("" if imgui.is_item_active() else _HELP)
        self._handle_pointer(context, chosen)
        for mark, colour in ((order, _MARK), (order.conjugate(), _TWIN)):
            middle = self._to_screen(mark.carrier)
            imgui.get_window_draw_list().add_circle(middle, mark.radius * side, colour, 64, 1.5)

    def _draw_choices(self, context: AppContext, chosen: RecordedOrders) -> None:
        names = [f"{λ * 1e9:.4g} nm" for λ in chosen.recording.wavelengths_m]
        self._wavelength = min(self._wavelength, len(names) - 1)
        if len(names) > 1:
            self._wavelength = names.index(combo("wavelength", names[self._wavelength], names))
        width = share_of_width(2)
        if button(context, "Find", "The order that stands out of the spectrum.", width=width, name="find the order"):
            context.order_editor.find()
        imgui.same_line()
        tip = "The order on the other side: its field has the other sign of phase and of distance."
        if button(context, "Other order", tip, width=width, name="other order"):
            orders = tuple(order.conjugate() for order in chosen.orders)
            context.order_editor.choose(replace(chosen, orders=orders))
            context.order_editor.end_drag()

    def _to_screen(self, carrier: tuple[float, float]) -> imgui.ImVec2:
        """The place of a frequency (y, x), cycles a pixel, on the screen."""
        rows, columns = self._picture.shape
        return self._picture.to_screen(carrier[1] * columns + columns // 2, carrier[0] * rows + rows // 2)

    def _frequency_at(self, place: imgui.ImVec2) -> tuple[float, float]:
        """The frequency (y, x), cycles a pixel, at a place on the screen."""
        (rows, columns), (x, y) = self._picture.shape, self._picture.to_sample(place)
        return (y - rows // 2) / rows, (x - columns // 2) / columns

    def _handle_pointer(self, context: AppContext, chosen: RecordedOrders) -> None:
        order, mouse = chosen.orders[self._wavelength], imgui.get_io().mouse_pos
        at = self._frequency_at(mouse)
        way = math.hypot(at[0] - order.carrier[0], at[1] - order.carrier[1])
        side = self._picture.size[0]
        if imgui.is_item_activated():
            is_edge = abs(way - order.radius) * side < _EDGE_PX
            is_inside = way < order.radius
            inside = (order.carrier[0] - at[0], order.carrier[1] - at[1])
            self._grip = None if is_edge else inside if is_inside else (0.0, 0.0)
        delta = imgui.get_io().mouse_delta
        if imgui.is_item_active() and (delta.x or delta.y or imgui.is_item_activated()):
            if self._grip is None:
                order = replace(order, radius=min(max(way, _RADII[0]), _RADII[1]))
            else:
                centre = [min(max(f + grip, -0.5), 0.5) for f, grip in zip(at, self._grip, strict=True)]
                order = replace(order, carrier=(centre[0], centre[1]), origin="given")
            if order != chosen.orders[self._wavelength]:
                context.order_editor.choose(chosen.with_order(self._wavelength, order))
        if imgui.is_item_deactivated():
            context.order_editor.end_drag()
