"""The panel of the system's parameters; widgets are made from metadata, so that new parameters appear by themselves."""

from __future__ import annotations

from typing import Any

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.panel import Panel
from holoview.app.parameter_widgets import WidgetEdit, count_field, draw_fields, number_field, tooltip
from holoview.model import fields as describe
from holoview.model.fields import Integer, Number, Shape
from holoview.model.system import System
from holoview.util import units
from holoview.util.text import printable_lines

_ELSEWHERE = ("wavelengths", "amplitudes", "name", "description", "modulators", "source", "eye")
_LEVELS = {"continuous": None, "2": 2, "4": 4, "8": 8, "16": 16, "64": 64, "256": 256}
_TITLES = {
    "relay1": "Relay 1 (between the modulators)",
    "relay2": "Relay 2 (to the focal plane)",
    "sampling": "Simulation",
    "modulators": "Modulators",
    "source": "Source",
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
        if self._name != system.name or self._reset is None:
            self._reset, self._name = system, system.name
        imgui.push_item_width(imgui.get_content_region_avail().x * 0.56)
        imgui.text_wrapped(printable_lines(system.description or system.name or "a bench of your own"))
        draw_fields(context, system, self._reset, "", without=_ELSEWHERE)
        _draw_frames(context, system, self._reset)
        self._draw_modulators(context, system)
        self._draw_source(context, system)
        for key, field in describe.fields_by_key(type(system)).items():
            if key in _ELSEWHERE or not isinstance(field.metadata["kind"], describe.Nested):
                continue
            if key == "relay1" and system.gap_m is None:
                continue
            if _header(context, _TITLES.get(key, key.capitalize())):
                tooltip(field.metadata["doc"])
                draw_fields(context, getattr(system, field.name), getattr(self._reset, field.name), f"{key}.")
        imgui.pop_item_width()

    # --- modulators and source --------------------------------------------------------------------------------------

    def _draw_modulators(self, context: AppContext, system: System) -> None:
        if not _header(context, "Field" if system.is_field else "Modulators"):
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
                edited = _levels(key, value, doc)
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
        if not _header(context, "Source"):
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

    def _apply_grid(self, context: AppContext) -> None:
        source = {"grid": list(self._grid), "spacing": units.format_exact(self._spacing_rad, "mrad")}
        context.attempt(context.session.change, "Source grid", {"source": source}, merge_key="source grid")


def _draw_frames(context: AppContext, system: System, reset: System) -> None:
    """Draws the number of frames; it is disabled if frames have different lasers, which the Lasers panel edits."""
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


def _header(context: AppContext, title: str) -> bool:
    is_open = imgui.collapsing_header(title)
    context.record_item_rect(title)
    return is_open


def _tilt(context: AppContext, system: System) -> None:
    """Draws the mean direction of the sources; changing it tilts all of them."""
    kind = Number("mrad", low=-1.0, high=1.0)
    directions = system.source.directions_rad
    middle = directions.mean(axis=0)
    for axis, name in enumerate(("tilt y", "tilt x")):
        edited = number_field(name, kind, float(middle[axis]), 0.0, "Angle of incidence on the first modulator.")
        if edited is not None:
            moved = directions.copy()
            moved[:, axis] += edited.value - middle[axis]
            context.change(name.capitalize(), "source.directions", moved, is_held=edited.is_held)


def _levels(name: str, value: Any, doc: str) -> WidgetEdit | None:
    count = "continuous" if value is None else str(len(value))
    options = list(_LEVELS) + ([] if count in _LEVELS else [count])
    changed, index = imgui.combo(name, options.index(count), options)
    tooltip(doc)
    return WidgetEdit(_LEVELS[options[index]], False) if changed and options[index] in _LEVELS else None
