"""The panel with the keys of the chosen element of the bench, and what is done to it."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.light.model.chain import place_of
from holoview.light.model.elements import FieldPlane, Pixels, Space
from holoview.light.model.system import System
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.parameter_widgets import draw_element
from holoview.viewer.app.widgets import button, combo, pale, same_line_for, wrapped_text
from holoview.viewer.document import chain_edits

_ADD = "Add behind it …"


class ElementPanel(Panel):
    """Edits the element that is chosen in the drawing, the first if none is."""

    title = "Element"
    dock = "Left"
    starts_open = False

    def __init__(self) -> None:
        self._reset: System | None = None

    def draw(self, context: AppContext) -> None:
        """Draws which ones are switched off, what is done to the chosen one, and its keys."""
        system = context.session.system
        if self._reset is None or self._reset.element_names != system.element_names:
            self._reset = system
        self._draw_off(context)
        self._draw_actions(context)
        self._draw_keys(context)

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
        session, name = context.session, context.chosen_element
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
        same_line_for("Light behind it")
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
        context.chosen_element = chain_edits.add_element(context.session, kind, context.chosen_element)

    def _show_light(self, context: AppContext, name: str) -> None:
        stage = context.session.system.stage_behind(name)
        context.session.edit_view("Light behind", page="field", stage=stage, quantity="intensity", compare="off")
        context.show_panel("Image")

    def _draw_keys(self, context: AppContext) -> None:
        session, name = context.session, context.chosen_element
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
