"""The panel of a recording: its kind, and on the spectrum of an off-axis one the order of its field, to drag."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.holograms.fields.reading import Recording
from holoview.holograms.files.request import Order, ReadRequest
from holoview.holograms.load_field import Recorded
from holoview.light.model.fields import field_for
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.viewport import Viewport, next_corner
from holoview.viewer.app.widgets import button, combo, is_taken_over, share_of_width, tooltip
from holoview.viewer.render.view_settings import ViewSettings

_OWN_COLOURS = ViewSettings(plane_m=0.0, page="field")
_MARK, _TWIN = imgui.IM_COL32(255, 220, 80, 255), imgui.IM_COL32(255, 220, 80, 90)
_EDGE_PX = 6.0  # from the circle, within which a drag changes its radius
_HELP_KIND, _HELP_STEPS, _HELP_DARK = (
    field_for(ReadRequest, key).metadata["doc"] for key in ("recording", "steps", "dark_field")
)
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
        self._shown: NDArray[np.float32] | None = None

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        show = partial(context.show_panel, self.title)
        context.commands.add("Image", "Kind and order of a recording", show, help=_HELP)
        self._picture = Viewport(context, "spectrum of a recording")

    def wants_to_open(self, context: AppContext) -> bool:
        """With a recording that is new."""
        recorded, shown = context.session.document.recorded, self._shown
        self._shown = None if recorded is None else recorded.recording.pictures
        return self._shown is not None and self._shown is not shown

    def draw(self, context: AppContext) -> None:
        """Draws buttons and the spectrum with the circles."""
        chosen = context.recording_editor.chosen
        if chosen is None:
            imgui.text_wrapped("Open a camera's recording: what it is taken for is shown here.")
            return
        self._draw_choices(context, chosen.recording)
        if chosen.recording.kind != "off-axis":
            return
        picture = context.page_images.recording(chosen.recording.pictures, self._wavelength)
        order = _draw_numbers(context, chosen, self._wavelength)
        if picture is None:
            return
        available = imgui.get_content_region_avail()
        side = max(int(min(available.x, available.y)), 64)
        corner = next_corner()
        self._picture.draw(picture, None, _OWN_COLOURS, (side, side), corner, is_stretched=True)
        imgui.invisible_button("##recording", imgui.ImVec2(side, side))
        context.record_item_rect("recording")
        tooltip("" if imgui.is_item_active() else _HELP)
        self._handle_pointer(context, chosen)
        for mark, colour in ((order, _MARK), (order.conjugate(), _TWIN)):
            middle = self._to_screen(mark.carrier)
            imgui.get_window_draw_list().add_circle(middle, mark.radius * side, colour, 64, 1.5)

    def _draw_choices(self, context: AppContext, recording: Recording) -> None:
        editor, kind = context.recording_editor, str(recording.kind)
        kinds = ["off-axis", "in-line", "phase-shifting"][: 3 if len(recording.pictures) >= 3 else 2]
        wanted = combo("kind", kind, kinds, _HELP_KIND)
        if wanted != kind:
            editor.find(kind=wanted)
        if kind == "phase-shifting":
            steps: str = recording.steps if isinstance(recording.steps, str) else "stated"
            wanted = combo("steps", steps, list(dict.fromkeys(["equal", "unknown", steps])), _HELP_STEPS)
            if wanted != steps:
                editor.find(steps=wanted)
        names = [f"{λ * 1e9:.4g} nm" for λ in recording.wavelengths_m]
        self._wavelength = min(self._wavelength, len(names) - 1)
        if len(names) > 1:
            self._wavelength = names.index(combo("wavelength", names[self._wavelength], names))
        width = share_of_width(2)
        if kind == "off-axis":
            if button(
                context, "Find", "The order that stands out of the spectrum.", width=width, name="find the order"
            ):
                editor.find()
            imgui.same_line()
        if kind == "in-line":  # its conjugate is the same
            is_dark = bool(recording.dark_field)
            if imgui.checkbox("dark field", is_dark)[0]:
                editor.find(dark_field=not is_dark)
            tooltip(_HELP_DARK)
            return
        tip = "The conjugate field, with the other sign of phase and of distance; of an off-axis one the other order."
        is_pressed = button(context, "Other side", tip, width=width, name="other side of the recording")
        if is_pressed and editor.chosen is not None:
            editor.choose(editor.chosen.conjugate())
            editor.end_drag()

    def _to_screen(self, carrier: tuple[float, float]) -> imgui.ImVec2:
        """The place of a frequency (y, x), cycles a pixel, on the screen."""
        rows, columns = self._picture.shape
        return self._picture.to_screen(carrier[1] * columns + columns // 2, carrier[0] * rows + rows // 2)

    def _frequency_at(self, place: imgui.ImVec2) -> tuple[float, float]:
        """The frequency (y, x), cycles a pixel, at a place on the screen."""
        (rows, columns), (x, y) = self._picture.shape, self._picture.to_sample(place)
        return (y - rows // 2) / rows, (x - columns // 2) / columns

    def _handle_pointer(self, context: AppContext, chosen: Recorded) -> None:
        order, mouse = chosen.recording.orders[self._wavelength], imgui.get_io().mouse_pos
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
            if order != chosen.recording.orders[self._wavelength]:
                context.recording_editor.choose(chosen.with_order(self._wavelength, order))
        if imgui.is_item_deactivated():
            context.recording_editor.end_drag()


def _draw_numbers(context: AppContext, chosen: Recorded, wavelength: int) -> Order:
    """Centre and radius of the circle, to be typed; returns the order as it is then."""
    order = chosen.recording.orders[wavelength]
    shown = [order.carrier[1], order.carrier[0], order.radius]
    is_entered, (x, y, radius) = imgui.input_float3("x y r", shown, "%.4f", imgui.InputTextFlags_.enter_returns_true)
    is_entered = is_taken_over(is_entered)
    context.record_item_rect("numbers of the order")
    tooltip("Centre and radius of the circle, cycles a pixel; Enter takes them over.")
    if is_entered:
        centre = [float(f"{min(max(f, -0.5), 0.5):.6g}") for f in (y, x)]
        radius = min(max(float(f"{radius:.6g}"), _RADII[0]), _RADII[1])
        order = replace(order, carrier=(centre[0], centre[1]), radius=radius, origin="given")
        context.recording_editor.choose(chosen.with_order(wavelength, order))
        context.recording_editor.end_drag()
    return order
