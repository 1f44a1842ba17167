"""The panels of the bench: the system's parameters, and a switch with sliders for each effect.

Widgets are made from metadata, so that new parameters and effects appear by themselves.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from imgui_bundle import imgui

from holoview.light.model import fields as describe
from holoview.light.model.effects.effect import Effect, Parameter
from holoview.light.model.effects.on_element import OnElement, split_id
from holoview.light.model.effects.registry import ActiveEffects, effects_for, get_effect, unmet_requirement
from holoview.light.model.fields import Integer, Number, Shape
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.text import printable, printable_lines
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.parameter_widgets import (
    WidgetEdit,
    count_field,
    draw_fields,
    levels_field,
    number_field,
    parameter_field,
)
from holoview.viewer.app.widgets import button, tooltip

_ELSEWHERE = (
    "elements",
    "planes_from",
    "wavelengths",
    "amplitudes",
    "name",
    "description",
    "modulators",
    "source",
    "eye",
)
_TITLES = {
    "relay1": "Relay 1 (between the modulators)",
    "relay2": "Relay 2 (to the focal plane)",
    "sampling": "Simulation",
    "modulators": "Modulators",
    "source": "Source",
}
_HELP = {
    "modulators": "What all modulators of the bench have in common: pixels, stroke and levels.",
    "source": "The plane waves that light the first element: how many, and from where.",
}
_MAX_SOURCES = 7  # along each axis


class BenchPanel(Panel):
    """Edits all parameters of the system but its lasers."""

    title = "Bench"
    dock = "Left"

    def __init__(self) -> None:
        self._reset: System | None = None
        self._name: str | None = None
        self._grid = (3, 3)
        self._spacing_rad = 2e-3

    def draw(self, context: AppContext) -> None:
        system = context.session.system
        if self._name != system.name or self._reset is None or self._reset.is_chain != system.is_chain:
            self._reset, self._name = system, system.name
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.56)
        imgui.text_wrapped(printable_lines(system.description or system.name or "a bench of your own"))
        draw_fields(context, system, self._reset, "", without=_ELSEWHERE)
        _draw_frames(context, system, self._reset)
        if system.is_chain:
            imgui.text_wrapped("Its elements are edited in the panel Drawing.")
        else:
            self._draw_modulators(context, system)
        self._draw_source(context, system)
        for key, field in describe.fields_by_key(type(system)).items():
            if key in _ELSEWHERE or not isinstance(field.metadata["kind"], describe.Nested):
                continue
            if (key == "relay1" and system.gap_m is None) or (key in ("relay1", "relay2") and system.is_chain):
                continue
            if _header(context, _TITLES.get(key, key.capitalize()), field.metadata["doc"]):
                draw_fields(context, getattr(system, field.name), getattr(self._reset, field.name), f"{key}.")
        imgui.pop_item_width()

    # --- modulators and source --------------------------------------------------------------------------------------

    def _draw_modulators(self, context: AppContext, system: System) -> None:
        if not _header(context, "Field" if system.is_field else "Modulators", _HELP["modulators"]):
            return
        modulator, reset = system.modulators[0], self._reset.modulators[0] if self._reset else system.modulators[0]
        for key, field in describe.fields_by_key(type(modulator)).items():
            kind, doc, value = field.metadata["kind"], field.metadata["doc"], getattr(modulator, field.name)
            edited: WidgetEdit | None = None
            if key == "content" or (system.is_field and key not in ("pitch", "shape")):
                continue
            if isinstance(kind, Number):
                edited = number_field(key, kind, value, getattr(reset, field.name), doc)
            elif isinstance(kind, Shape):
                imgui.text_disabled(f"{value[1]} × {value[0]} {'samples' if system.is_field else 'pixels'}")
                tooltip(doc)
            else:
                edited = levels_field(key, value, doc)
            context.record_item_rect(f"modulators.{key}")
            if edited is not None:
                context.change(key.capitalize(), key, edited.value, is_held=edited.is_held)
        if system.is_field:
            return
        has_two = len(system.modulators) == 2
        if imgui.button("Leave out modulator 2" if has_two else "Add a second modulator"):
            changes: dict[str, Any] = {"modulators": system.modulators[:1], "gap": None}
            if not has_two:
                changes = {"modulators": system.modulators * 2, "gap": "2 mm"}
            context.attempt(context.session.change, "Modulators", changes)

    def _draw_source(self, context: AppContext, system: System) -> None:
        if not _header(context, "Source", _HELP["source"]):
            return
        count = len(system.source.directions_rad)
        imgui.text_disabled("one plane wave" if count == 1 else f"{count} plane waves, mutually incoherent")
        changed, grid = imgui.input_int2("grid", list(self._grid))
        tooltip("Rows and columns of sources. Several sources average out speckle and widen the eyebox.")
        self._grid = (min(max(grid[0], 1), _MAX_SOURCES), min(max(grid[1], 1), _MAX_SOURCES))
        kind = Number("mrad", low=0.0, high=0.2)
        spacing = number_field("spacing", kind, self._spacing_rad, 2e-3, "Angle between neighbouring sources.")
        if spacing is not None:
            self._spacing_rad = spacing.value
        if (changed or (spacing is not None and count > 1)) and max(self._grid) > 1:
            self._apply_grid(context)
        if imgui.button("Use this grid"):
            self._apply_grid(context)
        imgui.same_line()
        if imgui.button("One source"):
            context.attempt(context.session.change, "One source", {"source": {}})
        _tilt(context, system)
        _draw_light(context, system)

    def _apply_grid(self, context: AppContext) -> None:
        source = {"grid": list(self._grid), "spacing": units.format_exact(self._spacing_rad, "mrad")}
        context.attempt(context.session.change, "Source grid", {"source": source}, merge_key="source grid")


def _draw_frames(context: AppContext, system: System, reset: System) -> None:
    """Draws the number of frames, editable unless frames have different lasers, which the Lasers panel edits."""
    is_even = bool((system.amplitudes == system.amplitudes[0]).all())
    doc = "Patterns that are shown in turn and averaged by the eye, each with patterns of its own."
    imgui.begin_disabled(not is_even or system.is_field)
    edited = count_field("frames", Integer(1, 64), system.frames, reset.frames, doc)
    context.record_item_rect("frames")
    imgui.end_disabled()
    if not is_even:
        tooltip("These frames are lit by different lasers: their powers are in the table of lasers.")
    if edited is not None:
        context.change("Frames", "frames", edited.value, is_held=edited.is_held)


def _header(context: AppContext, title: str, doc: str) -> bool:
    """Draws a section's title, without what is in brackets where that has no room; returns whether it is open."""
    room = imgui.get_content_region_avail().x - 2 * imgui.get_font_size()
    is_open = imgui.collapsing_header(title if imgui.calc_text_size(title).x <= room else title.partition(" (")[0])
    context.record_item_rect(title)
    tooltip(doc)
    return is_open


def _tilt(context: AppContext, system: System) -> None:
    """Draws the mean direction of the sources; changing it tilts all of them."""
    kind = Number("mrad", low=-1.0, high=1.0)
    directions = system.source.directions_rad
    middle = directions.mean(axis=0)
    for axis, name in enumerate(("tilt y", "tilt x")):
        edited = number_field(name, kind, float(middle[axis]), 0.0, "Angle of incidence on the first element.")
        if edited is not None:
            moved = directions.copy()
            moved[:, axis] += edited.value - middle[axis]
            context.change(name.capitalize(), "source.directions", moved, is_held=edited.is_held)


def _draw_light(context: AppContext, system: System) -> None:
    """Draws the complex field that lights the first modulator, where there is one."""
    effect, values = get_effect("source_field"), system.effect_values.get("source_field")
    if values is None:
        return
    imgui.text_disabled(f"× the field of {printable(Path(values['file']).name)}")
    tooltip(f"{effect.cause}\n{printable_lines(values['file'])}")
    for parameter in effect.parameters[1:]:
        edited = parameter_field(parameter, values.get(parameter.name, parameter.identity))
        if edited is not None:
            context.change("Light", f"effects.source_field.{parameter.name}", edited.value, is_held=edited.is_held)
    if button(context, "Plane waves alone", name="plane waves alone"):
        without = {name: table for name, table in system.effect_values.items() if name != effect.id}
        context.change("Plane waves alone", "effects", without)


# --- effects ----------------------------------------------------------------------------------------------------------


_CAMERA = "Camera (in captures only)"
_PLACES = {
    "source": "Source",
    "modulator 1": "Modulators",
    "modulator 2": "Modulators",
    "relay 1": "Relay 1",
    "relay 2": "Relay 2",
    "camera": _CAMERA,
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
        help = "The plain model of the bench."
        context.commands.add("Edit", "Switch off all effects", lambda: self._switch_off(context), help=help)

    def draw(self, context: AppContext) -> None:
        """Draws a switch for each effect, and the sliders of those that are on."""
        system, effects = context.session.system, effects_for(context.session.system)
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.56)
        _, self._query = imgui.input_text_with_hint("##words", "find an effect", self._query)
        imgui.same_line()
        tip = f"{len(system.effects)} of {len(effects)} are switched on."
        if button(context, "All off", tip, width=-1, is_enabled=bool(system.effects)):
            self._switch_off(context)
        imgui.begin_child("effects", child_flags=imgui.ChildFlags_.nav_flattened)
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.5)
        for location, group in _by_place(self._found(effects), system).items():
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
            if all(
                word in f"{_name(effect)} {effect.id} {effect.cause} {' '.join(effect.acts_on)}".lower()
                for word in words
            )
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
        if fine and imgui.tree_node(f"{len(fine)} finer {'one' if len(fine) == 1 else 'ones'}"):
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
                context.change(f"Effect {_title(effect)}", key, edited.value, is_held=edited.is_held)

    def _switch(self, context: AppContext, effect: Effect, is_on: bool) -> None:
        system = context.session.system
        table = system.effect_values
        if is_on:
            table[effect.id] = self._switched_off.get(effect.id) or _typical_values(effect, system)
        else:
            self._switched_off[effect.id] = table.pop(effect.id)
        with context.session.report_errors():  # also an effect that this bench can't have changes nothing
            ActiveEffects(table).actual_system(system)
            context.change(f"Effect {_title(effect)} {'on' if is_on else 'off'}", "effects", table)

    def _switch_off(self, context: AppContext) -> None:
        self._switched_off |= context.session.system.effect_values
        context.change("All effects off", "effects", {})


def _by_place(effects: list[Effect], system: System) -> dict[str, list[Effect]]:
    """The effects by headings in the order of the light: parts of a short form, or the names of a chain's elements."""
    places = {**_PLACES, "relay 2": "To the focal plane"} if system.is_chain else _PLACES
    names = [*places.values(), *system.element_names]
    groups: dict[str, list[Effect]] = {name: [] for name in (*(n for n in names if n != _CAMERA), _CAMERA)}
    for effect in effects:
        groups.setdefault(places.get(effect.acts_on[0], effect.acts_on[0]), []).append(effect)
    return {location: group for location, group in groups.items() if group}


def _typical_values(effect: Effect, system: System) -> dict[str, Any]:
    """Initial values: the first parameter is its prior away from its identity, so that the effect is visible.

    Where that contradicts the others' identities, those of the effect's first starting point.
    """
    first = effect.parameters[0]
    values: dict[str, Any] = {first.name: first.nudged(1.0)}
    if effect.contradiction(effect.parameter_values(values)):
        return dict(next(iter(effect.starting_points(system)), values))
    return values


def _name(effect: Effect) -> str:
    """Of an effect on an element without the element, which is the heading."""
    return split_id(effect.id)[0].replace("_", " ")


def _title(effect: Effect) -> str:
    """Of a step of undo."""
    return f"{_name(effect)}{f' of {effect.element}' if isinstance(effect, OnElement) else ''}"


def _equation(effect: Effect) -> str:
    """The first paragraph of an effect's docstring, which says what it does to the light."""
    own = effect.effect if isinstance(effect, OnElement) else effect
    return (inspect.getdoc(type(own)) or "").partition("\n\n")[0]
