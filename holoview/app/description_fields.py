"""Draws a field of a description (a bench, a relay, an eye) as the widget that fits its type, and makes its edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.parameter_widgets import WidgetEdit, choice_field, count_field, format_value, number_field, tooltip
from holoview.app.stop_widgets import centre_field, square_field
from holoview.model.fields import Array, Choice, Coefficients, Integer, Nested, Number, Truth, fields_by_key
from holoview.model.stops import CentreField, SquareField, SquareStop

_FIRST_VALUE = {"iris_na": 0.02, "dc_block_na": 0.001, "apodisation_na": 0.02}
_LABELS = {
    "square": "square stop",
    "centre_na": "centre of the stops",
    "axis": "axis (°)",
    "chromatic": "chromatic aberration",
    "reference": "reference wavelength",
    "stiles_crawford": "Stiles–Crawford effect",
    "luminance": "luminance (cd/m²)",
    "age": "age (years)",
}


def draw_fields(context: AppContext, item: Any, reset: Any, path: str, without: Sequence[str] = ()) -> None:
    """Draws the fields of a description one below the other, but for nested ones and for the centre of no stop.

    item: the description, such as `system.relay1`. reset: one whose values a right click restores. path: its key in the
    system, with a dot, such as "relay1."; "" for the system itself. without: keys that aren't drawn.
    """
    for key, field in fields_by_key(type(item)).items():
        kind = field.metadata["kind"]
        if key in without or isinstance(kind, Nested) or (isinstance(kind, CentreField) and not item.has_aperture):
            continue
        imgui.push_id(path + key)
        value, first = getattr(item, field.name), getattr(reset, field.name)
        draw_field(context, path + key, kind, value, first, field.metadata["doc"])
        imgui.pop_id()


def draw_field(context: AppContext, path: str, kind: Any, value: Any, reset: Any, doc: str) -> None:
    """Draws the widget of a field; an edit changes the session's system.

    path: key of the field in the system, such as "relay1.iris_na". kind: its type. reset: the value that a right click
    restores. Types without a widget, and lengths that are None, draw nothing.
    """
    key, pitch_m = path.rpartition(".")[2], context.session.system.modulators[0].pitch_m
    name = _LABELS.get(key, key.replace("_", " ").replace(" na", " NA"))
    edited: WidgetEdit | None = None
    if isinstance(kind, Number) and kind.optional and key in _FIRST_VALUE:
        edited = _optional(name, kind, value, reset, doc, _FIRST_VALUE[key])
    elif isinstance(kind, Number):
        if value is None:
            return
        edited = number_field(name, kind, value, value if reset is None else reset, doc)
    elif isinstance(kind, Integer):
        edited = count_field(name, kind, value, reset, doc)
    elif isinstance(kind, Truth):
        edited = _truth(name, value, doc)
    elif isinstance(kind, Choice) and kind.options:
        edited = choice_field(name, kind, value, doc)
    elif isinstance(kind, Coefficients):
        edited = _coefficients(name, kind, value, doc)
    elif isinstance(kind, Array) and kind.axes == 1:
        edited = None if value is None else _lengths(name, kind, value, doc)
    elif isinstance(kind, SquareField):
        edited = square_field(name, value, pitch_m, doc)
    elif isinstance(kind, CentreField):
        edited = centre_field(value, reset, SquareStop().nominal_na(pitch_m), doc)
    context.record_item_rect(path)
    if edited is not None:
        context.change(name[:1].upper() + name[1:], path, edited.value, is_held=edited.is_held)


def _truth(name: str, value: bool, doc: str) -> WidgetEdit | None:
    changed, is_on = imgui.checkbox(name, value)
    tooltip(doc)
    return WidgetEdit(bool(is_on), False) if changed else None


def _optional(
    name: str, kind: Number, value: float | None, reset: float | None, doc: str, first: float
) -> WidgetEdit | None:
    changed, is_on = imgui.checkbox(f"##{name} on", value is not None)
    tooltip(f"Whether there is one. {doc}")
    imgui.same_line()
    if changed:
        imgui.text(name)
        return WidgetEdit((reset or first) if is_on else None, False)
    if value is None:
        imgui.text_disabled(f"no {name.removesuffix(' NA')}")
        return None
    imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.55)
    return number_field(name, kind, value, reset or first, doc)


def _coefficients(name: str, kind: Coefficients, value: tuple[tuple[int, float], ...], doc: str) -> WidgetEdit | None:
    imgui.text_disabled(name)
    tooltip(doc)
    terms: Mapping[int, float] = dict(value)
    for index, size in terms.items():
        edited = number_field(f"{kind.prefix}{index}", kind.item, size, 0.0, f"{doc} Right click takes it away.")
        if edited is not None:
            changed = {**terms, index: edited.value}
            return WidgetEdit(tuple((i, x) for i, x in changed.items() if x or edited.is_held), edited.is_held)
    if imgui.button(f"Add a term##{name}"):
        index = next(i for i in range(4, kind.highest + 1) if i not in terms)
        return WidgetEdit((*value, (index, 30e-9)), False)
    return None


def _lengths(name: str, kind: Array, value: Any, doc: str) -> WidgetEdit | None:
    shown = ", ".join(format_value(kind.item, float(x)).rpartition(" ")[0] for x in value)
    changed, text = imgui.input_text(f"{name} ({kind.item.unit})", shown, imgui.InputTextFlags_.enter_returns_true)
    tooltip(f"{doc} Several are parted by commas; Enter takes them over.")
    if not changed:
        return None
    return WidgetEdit([f"{part.strip()} {kind.item.unit}" for part in text.split(",") if part.strip()], False)
