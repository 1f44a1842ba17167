"""The panel of effects: a switch for each deviation of a real bench, and sliders for its parameters."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.parameter_widgets import parameter_field, tooltip
from holoview.model.effects.effect import Effect, Parameter
from holoview.model.effects.registry import listed_effects, unmet_requirement

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
    """Lists all effects by the part of the bench that they act on; switching off an effect keeps its values."""

    title = "Effects"
    dock = "Left"

    def __init__(self) -> None:
        self._query = ""
        self._switched_off: Table = {}

    def set_up(self, context: AppContext) -> None:
        """Adds the command that switches off all effects."""
        add = context.commands.add
        add("Switch off all effects", lambda: self._switch_off(context), "Edit", help="The plain model of the bench.")

    def draw(self, context: AppContext) -> None:
        """Draws a switch for each effect, and the sliders of those that are on."""
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
        for location, group in _by_place(self._found(effects.values())).items():
            imgui.separator_text(location)
            for effect in group:
                imgui.push_id(effect.id)
                self._draw_effect(context, effect)
                imgui.pop_id()
        imgui.pop_item_width()
        imgui.end_child()

    def _found(self, effects: Iterable[Effect]) -> list[Effect]:
        words = self._query.lower().split()
        return [
            effect
            for effect in effects
            if all(word in f"{_name(effect)} {effect.id} {effect.cause}".lower() for word in words)
        ]

    def _draw_effect(self, context: AppContext, effect: Effect) -> None:
        values = context.session.system.effect_values.get(effect.id)
        missing = unmet_requirement(effect, context.session.system)
        imgui.begin_disabled(bool(missing) and values is None)
        switched, is_on = imgui.checkbox(_name(effect), values is not None)
        context.record_item_rect(f"effect {effect.id}")
        imgui.end_disabled()
        tooltip(
            f"{effect.cause}\n{_equation(effect)}" + (f"\n\nIt can't be switched on: {missing}." if missing else "")
        )
        if switched:
            self._switch(context, effect, is_on)
        elif values is not None:
            imgui.indent()
            self._draw_sliders(context, effect, [p for p in effect.parameters if not p.secondary], values)
            self._draw_fine(context, effect, [p for p in effect.parameters if p.secondary], values)
            imgui.unindent()

    def _draw_fine(self, context: AppContext, effect: Effect, fine: list[Parameter], values: dict[str, float]) -> None:
        if fine and imgui.tree_node(f"{len(fine)} finer ones"):
            self._draw_sliders(context, effect, fine, values)
            imgui.tree_pop()

    def _draw_sliders(
        self, context: AppContext, effect: Effect, group: list[Parameter], values: dict[str, float]
    ) -> None:
        for parameter in group:
            edited = parameter_field(parameter, values.get(parameter.name, parameter.identity))
            key = f"effects.{effect.id}.{parameter.name}"
            context.record_item_rect(key)
            if edited is not None:
                context.change(f"Effect {_name(effect)}", key, edited.value, is_held=edited.is_held)

    def _switch(self, context: AppContext, effect: Effect, is_on: bool) -> None:
        table = context.session.system.effect_values
        if is_on:
            table[effect.id] = self._switched_off.get(effect.id) or _typical_values(effect)
        else:
            self._switched_off[effect.id] = table.pop(effect.id)
        context.change(f"Effect {_name(effect)} {'on' if is_on else 'off'}", "effects", table)

    def _switch_off(self, context: AppContext) -> None:
        self._switched_off |= context.session.system.effect_values
        context.change("All effects off", "effects", {})


def _by_place(effects: list[Effect]) -> dict[str, list[Effect]]:
    places: dict[str, list[Effect]] = {location: [] for location in _PLACES.values()}
    for effect in effects:
        places[_PLACES[effect.acts_on[0]]].append(effect)
    return {location: group for location, group in places.items() if group}


def _typical_values(effect: Effect) -> dict[str, float]:
    """Initial values: the first parameter is its prior away from its identity, so that the effect is visible."""
    first = effect.parameters[0]
    return {first.name: first.nudged(1.0)}


def _name(effect: Effect) -> str:
    return effect.id.replace("_", " ")


def _equation(effect: Effect) -> str:
    """The first paragraph of an effect's docstring, which says what it does to the light."""
    return (inspect.getdoc(type(effect)) or "").partition("\n\n")[0]
