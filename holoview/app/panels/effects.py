"""What real benches do beyond the plain model: a switch an effect, and its sliders, made from the effects' library."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.parameter_widgets import parameter_field, tooltip
from holoview.model.effects.active_effects import unmet_requirement
from holoview.model.effects.effect import Effect
from holoview.model.effects.parameter import Parameter
from holoview.model.effects.registry import listed_effects

_PLACES = {
    "source": "Source",
    "modulator 1": "Modulators",
    "modulator 2": "Modulators",
    "relay 1": "Relay 1",
    "relay 2": "Relay 2",
    "camera": "Camera (in captures only)",
}
Table = dict[str, dict[str, float]]


class EffectsPanel(Panel):
    """All effects by the place that they act on; what was set of one that is switched off is kept."""

    title = "Effects"
    dock = "Left"

    def __init__(self) -> None:
        self._query = ""
        self._switched_off: Table = {}

    def set_up(self, context: AppContext) -> None:
        """Adds the command."""
        add = context.commands.add
        add("Switch off all effects", lambda: self._switch_off(context), "Edit", help="The plain model of the bench.")

    def draw(self, context: AppContext) -> None:
        """A line an effect, its sliders where it is on."""
        system, effects = context.session.system, listed_effects()
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.56)
        _, self._query = imgui.input_text_with_hint("##words", "find an effect", self._query)
        imgui.same_line()
        imgui.begin_disabled(not system.effects)
        if imgui.button("All off", imgui.ImVec2(-1, 0)):
            self._switch_off(context)
        imgui.end_disabled()
        tooltip(f"{len(system.effects)} of {len(effects)} are switched on.")
        imgui.begin_child("effects")
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.5)
        for place, some in _by_place(self._found(effects.values())).items():
            imgui.separator_text(place)
            for one in some:
                imgui.push_id(one.id)
                self._draw_effect(context, one)
                imgui.pop_id()
        imgui.pop_item_width()
        imgui.end_child()

    def _found(self, effects: Iterable[Effect]) -> list[Effect]:
        words = self._query.lower().split()
        return [one for one in effects if all(word in f"{_name(one)} {one.id} {one.cause}".lower() for word in words)]

    def _draw_effect(self, context: AppContext, one: Effect) -> None:
        values = context.session.system.effect_values.get(one.id)
        lacking = unmet_requirement(one, context.session.system)
        imgui.begin_disabled(bool(lacking) and values is None)
        switched, is_on = imgui.checkbox(_name(one), values is not None)
        context.record_item_rect(f"effect {one.id}")
        imgui.end_disabled()
        tooltip(f"{one.cause}\n{_equation(one)}" + (f"\n\nIt can't be switched on: {lacking}." if lacking else ""))
        if switched:
            self._switch(context, one, is_on)
        elif values is not None:
            imgui.indent()
            self._draw_sliders(context, one, [p for p in one.parameters if not p.fine], values)
            self._draw_fine(context, one, [p for p in one.parameters if p.fine], values)
            imgui.unindent()

    def _draw_fine(self, context: AppContext, one: Effect, fine: list[Parameter], values: dict[str, float]) -> None:
        if fine and imgui.tree_node(f"{len(fine)} finer ones"):
            self._draw_sliders(context, one, fine, values)
            imgui.tree_pop()

    def _draw_sliders(self, context: AppContext, one: Effect, some: list[Parameter], values: dict[str, float]) -> None:
        for parameter in some:
            edited = parameter_field(parameter, values.get(parameter.name, parameter.identity))
            key = f"effects.{one.id}.{parameter.name}"
            context.record_item_rect(key)
            if edited is not None:
                context.change(f"Effect {_name(one)}", key, edited.value, is_held=edited.is_held)

    def _switch(self, context: AppContext, one: Effect, is_on: bool) -> None:
        table = context.session.system.effect_values
        if is_on:
            table[one.id] = self._switched_off.get(one.id) or _typical_values(one)
        else:
            self._switched_off[one.id] = table.pop(one.id)
        context.change(f"Effect {_name(one)} {'on' if is_on else 'off'}", "effects", table)

    def _switch_off(self, context: AppContext) -> None:
        self._switched_off |= context.session.system.effect_values
        context.change("All effects off", "effects", {})


def _by_place(effects: list[Effect]) -> dict[str, list[Effect]]:
    places: dict[str, list[Effect]] = {place: [] for place in _PLACES.values()}
    for one in effects:
        places[_PLACES[one.acts_on[0]]].append(one)
    return {place: some for place, some in places.items() if some}


def _typical_values(one: Effect) -> dict[str, float]:
    """Its first parameter as large as it commonly is, so that something is seen when it is switched on."""
    first = one.parameters[0]
    return {first.name: min(max(first.identity + first.prior, first.low), first.high)}


def _name(one: Effect) -> str:
    return one.id.replace("_", " ")


def _equation(one: Effect) -> str:
    """The first paragraph of its documentation, which says what it does to the light."""
    return (inspect.getdoc(type(one)) or "").partition("\n\n")[0]
