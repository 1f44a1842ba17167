"""Widgets made from a parameter's metadata: sliders, fields of a description, the stops of a relay."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imgui_bundle import imgui

from holoview.light.model.bench_parts import Relay
from holoview.light.model.effects.effect import ListParameter, Parameter
from holoview.light.model.elements import Element, Pixels, Space
from holoview.light.model.fields import (
    Array,
    Choice,
    Coefficients,
    Integer,
    LevelFractions,
    Maybe,
    Nested,
    Number,
    Several,
    Shape,
    Truth,
    fields_by_key,
)
from holoview.light.model.stops import APERTURE, CentreField, SquareField, SquareStop
from holoview.light.model.system import System
from holoview.util import units
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.widgets import combo, fine_slider, fine_slider_int, is_item_held, is_taken_over, tooltip

_RESET_MULTIPLE = 3.0  # the limit of a slider, as a multiple of the value that a right click restores
_MAX_RATIO = 1000.0  # of the limits of a kind, up to which a slider covers its whole range
_PRIOR_MULTIPLE = 5.0  # the limit of an effect's slider, as a multiple of the parameter's prior


@dataclass(frozen=True)
class WidgetEdit:
    """A new value from a widget, and whether the mouse button is still held on it."""

    value: Any
    is_held: bool


def number_field(
    name: str, kind: Number, value: float, reset: float, doc: str, span: tuple[float, float] | None = None
) -> WidgetEdit | None:
    """Draws a slider with a unit; returns the new value in SI units, or None if it wasn't edited.

    Ctrl+click enters a value, within the range of the kind; a right click restores `reset`. span: limits of the
    slider in SI units; `slider_range` when None.
    """
    low, high = slider_range(kind, reset) if span is None else span
    note = f"{doc}\n{kind.format_range()}; right click: back to {format_value(kind, reset)}"
    return _slider(name, _Scale(kind.unit, unit_scale(kind)), value, reset, (low, high), note)


def parameter_field(parameter: Parameter, value: Any) -> WidgetEdit | None:
    """Draws a slider for a parameter of an effect; a right click restores its identity, where it has no effect.

    A list is a line of text, which Enter accepts.
    """
    p = parameter
    if isinstance(p, ListParameter):
        return _list_field(p, value)
    kind = Number(p.display_unit if p.is_quantity else "", p.low, p.high)
    reach = _PRIOR_MULTIPLE * p.prior
    first, last, _ = p.scan or (p.identity, p.identity, 0.0)
    low, high = max(p.low, min(p.identity - reach, first)), min(p.high, max(p.identity + reach, last))
    note = f"{p.doc}\n{kind.format_range()}; right click: back to {p.format(p.identity)}, where it does nothing"
    return _slider(
        p.name.replace("_", " "), _Scale(p.display_unit, unit_scale(kind)), value, p.identity, (low, high), note
    )


def _list_field(p: ListParameter, value: Any) -> WidgetEdit | None:
    name, shown = p.name.replace("_", " "), p.format(value, digits=6)
    entered, text = imgui.input_text(name, shown, _ENTER)
    entered = is_taken_over(entered)
    if _tooltip_and_reset(f"{p.doc}\nnumbers with commas; Enter accepts them, a right click empties the list"):
        return WidgetEdit(p.identity, False)
    return WidgetEdit(text, False) if entered else None


def count_field(name: str, kind: Integer, value: int, reset: int, doc: str) -> WidgetEdit | None:
    """Draws a slider for an integer; see `number_field`."""
    high = min(kind.high, max(4, 2 * reset))
    changed, shown = fine_slider_int(name, value, kind.low, high)
    if _tooltip_and_reset(f"{doc}\nfrom {kind.low} to {kind.high}; right click: back to {reset}"):
        return WidgetEdit(reset, False)
    return WidgetEdit(int(shown), is_item_held()) if changed else None


def choice_field(name: str, kind: Choice, value: str, doc: str) -> WidgetEdit | None:
    """Draws a combo box of the kind's options; see `number_field`."""
    chosen = combo(name, value, kind.options, doc)
    return WidgetEdit(chosen, False) if chosen != value else None


def unit_scale(kind: Number) -> float:
    """The factor from SI units to the unit in which values are shown."""
    if not kind.unit:
        return 1.0
    return 1.0 / units.parse(f"1 {kind.unit}", "unit", units.quantity_of(kind.unit))


def format_value(kind: Number, value: float) -> str:
    """A value in SI units as text with its unit."""
    return units.with_symbols(units.format_rounded(value, kind.unit)) if kind.unit else f"{value:.4g}"


def slider_range(kind: Number, reset: float) -> tuple[float, float]:
    """The limits of a slider in SI units: those of the kind if they are close to each other, else around `reset`."""
    is_narrow = math.isfinite(kind.low) and math.isfinite(kind.high) and kind.low > -math.inf
    if is_narrow and kind.low > 0 and kind.high / kind.low <= _MAX_RATIO:
        return kind.low, kind.high
    reach = _RESET_MULTIPLE * abs(reset) or 10.0 / unit_scale(kind)
    low = -reach if kind.low < 0 else 0.0
    return max(low, kind.low), min(reach, kind.high)


@dataclass(frozen=True)
class _Scale:
    """A unit, and the factor from SI units to it."""

    unit: str
    factor: float


def _slider(
    name: str, scale: _Scale, value: float, reset: float, span: tuple[float, float], note: str
) -> WidgetEdit | None:
    low, high = (limit * scale.factor for limit in span)
    text = f"%.4g {units.with_symbols(scale.unit)}".strip()
    changed, shown = fine_slider(name, value * scale.factor, low, high, text, imgui.SliderFlags_.no_round_to_format)
    if _tooltip_and_reset(note):
        return WidgetEdit(reset, False)
    return WidgetEdit(_rounded(shown) / scale.factor, is_item_held()) if changed else None


def _rounded(shown: float) -> float:
    """Rounds to six digits, so that a slider's float32 isn't written to a preset as 2.0000000949949026 mm."""
    return float(f"{shown:.6g}")


def _tooltip_and_reset(doc: str) -> bool:
    """Shows a tooltip for the last item; returns whether the item was clicked with the right button."""
    tooltip(doc)
    return imgui.is_item_clicked(imgui.MouseButton_.right)


# Draws a field of a description (a bench, a relay, an eye) as the widget that fits its type, and makes its edit.


_ENTER = imgui.InputTextFlags_.enter_returns_true
_LEVELS = {"continuous": None, "2": 2, "4": 4, "8": 8, "16": 16, "64": 64, "256": 256}
_FIRST_VALUE = {"iris_na": 0.02, "dc_block_na": 0.001, "apodisation_na": 0.02}
_LABELS = {
    "square": "square stop",
    "centre_na": "centre of the stops",
    "axis": "axis (°)",
    "chromatic": "chromatic aberration",
    "reference": "reference λ",
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


def draw_element(context: AppContext, system: System, element: Element, reset: Element, name: str) -> None:
    """Draws the keys of an element of a system; of a short form's modulator pitch and shape are those of both.

    reset: an element of its kind whose values a right click restores. name: of the element.
    """
    is_space = isinstance(element, Space)
    hidden = ("name", *(fields_by_key(Relay) if is_space else ()))
    if not system.is_chain and isinstance(element, Pixels):
        hidden = (*hidden, "offset", "shared", "held", "step")
    for key, field in fields_by_key(type(element)).items():
        if key in hidden:
            continue
        kind, doc = field.metadata["kind"], field.metadata["doc"]
        is_of_both = not system.is_chain and key in ("pitch", "shape")
        path = key if is_of_both else f"elements.{name}.{key}"
        imgui.push_id(path)
        draw_field(context, path, kind, getattr(element, field.name), getattr(reset, field.name), doc)
        imgui.pop_id()
    if isinstance(element, Space) and isinstance(reset, Space):
        draw_fields(context, element.relay, reset.relay, f"elements.{name}.")


def draw_field(context: AppContext, path: str, kind: Any, value: Any, reset: Any, doc: str) -> None:
    """Draws the widget of a field; an edit changes the session's system.

    path: key of the field in the system, such as "relay1.iris_na". kind: its type. reset: the value that a right click
    restores. Types without a widget, and lengths that are None, draw nothing.
    """
    key, pitch_m = path.rpartition(".")[2], context.session.system.way.finest_m
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
    elif isinstance(kind, LevelFractions):
        edited = levels_field(name, value, doc)
    elif isinstance(kind, Shape | Maybe) and value is not None:
        edited = _shape(name, value, doc)
    elif isinstance(kind, Several):
        edited = _places(name, kind, value, doc)
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


def levels_field(name: str, value: Any, doc: str) -> WidgetEdit | None:
    """Draws a combo box of numbers of levels; see `number_field`."""
    count = "continuous" if value is None else str(len(value))
    options = list(_LEVELS) + ([] if count in _LEVELS else [count])
    chosen = combo(name, count, options, doc)
    return WidgetEdit(_LEVELS[chosen], False) if chosen != count and chosen in _LEVELS else None


def _shape(name: str, value: tuple[int, int], doc: str) -> WidgetEdit | None:
    parts = _entered(f"{name} (y, x)", f"{value[0]}, {value[1]}", doc)
    return None if parts is None else WidgetEdit([int(part) if part.isdecimal() else part for part in parts], False)


def _entered(label: str, shown: str, doc: str) -> list[str] | None:
    """Draws a text of values with commas between them; the values once Enter takes them over, else None."""
    changed, text = imgui.input_text(label, shown, _ENTER)
    changed = is_taken_over(changed)
    tooltip(f"{doc} Enter takes them over, Escape drops them.")
    return [part.strip() for part in text.split(",")] if changed else None


def _entered_lengths(name: str, item: Number, value: Iterable[float], doc: str) -> list[str] | None:
    """Draws lengths in the unit of their type; the lengths as text once Enter takes them over, else None."""
    shown = ", ".join(format_value(item, float(x)).rpartition(" ")[0] for x in value)
    parts = _entered(f"{name} ({units.with_symbols(item.unit)})", shown, doc)
    return None if parts is None else [f"{part} {item.unit}" for part in parts]


def _places(name: str, kind: Several, value: tuple[float, ...], doc: str) -> WidgetEdit | None:
    if not kind.item.unit:
        numbers = _entered(name, ", ".join(f"{x:g}" for x in value), doc)
        return None if numbers is None else WidgetEdit(", ".join(numbers), False)
    lengths = _entered_lengths(name, kind.item, value, f"{doc} Down, right.")
    return None if lengths is None else WidgetEdit(lengths, False)


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
    lengths = _entered_lengths(name, kind.item, value, f"{doc} Several are parted by commas.")
    return None if lengths is None else WidgetEdit([length for length in lengths if not length.startswith(" ")], False)


# --- Widgets for the stops of a relay: the square stop, and the centre of the iris and the square stop ---


_NONE, _IDEAL, _REAL, _APERTURE = "none", "first order", "first order at one wavelength", "aperture"
_KINDS = {
    _NONE: "No square stop.",
    _IDEAL: "As wide as the modulators' first order at every wavelength.",
    _REAL: "A real aperture, as wide as the modulators' first order at one wavelength.",
    _APERTURE: "A real aperture, by the direction sine at the middle of a side.",
}
_WAVELENGTH = Number("nm", low=100e-9, high=10e-6)
_VISIBLE_M = (400e-9, 700e-9)  # of the slider
_REFERENCE_M = 550e-9  # at which a new real aperture is as wide as the first order
_WIDTH, _WIDTH_SPAN = Number(low=0.01, high=100.0), (0.1, 2.0)
_SINE = Number(low=-1.0, high=1.0)


def square_field(name: str, value: SquareStop | None, pitch_m: float, doc: str) -> WidgetEdit | None:
    """Draws a combo box of the kinds of square stops, and sliders of the stop's size.

    pitch_m: of the modulators: a new aperture is as wide as their first order, or as the stop that it replaces.

    Returns what a preset would state: None, a number or text; None instead of an edit if nothing was edited.
    """
    now = _kind(value)
    chosen = combo(name, now, tuple(_KINDS), f"{doc}\n{_KINDS[now]}")
    if chosen != now:
        return WidgetEdit(SquareField().to_toml(_of_kind(chosen, value, pitch_m)), False)
    return None if value is None else _size_field(value, pitch_m)


def centre_field(value: tuple[float, float], reset: tuple[float, float], reach: float, doc: str) -> WidgetEdit | None:
    """Draws a slider for each direction of the stops' centre; see `number_field`. reach: limit of the sliders."""
    found: WidgetEdit | None = None
    for axis, name in enumerate(("centre y", "centre x")):
        edited = number_field(name, _SINE, value[axis], reset[axis], doc, (-reach, reach))
        if edited is not None:
            moved = [*value]
            moved[axis] = edited.value
            found = WidgetEdit(moved, edited.is_held)
    return found


def _kind(square: SquareStop | None) -> str:
    if square is None:
        return _NONE
    if square.half_side_na is not None:
        return _APERTURE
    return _IDEAL if square.wavelength_m is None else _REAL


def _of_kind(kind: str, before: SquareStop | None, pitch_m: float) -> SquareStop | None:
    """A stop of another kind, as wide as the one before where that is possible."""
    before = before or SquareStop()
    scale = before.scale if before.half_side_na is None else 1.0
    stops = {
        _IDEAL: SquareStop(scale=scale),
        _REAL: SquareStop(wavelength_m=_REFERENCE_M, scale=scale),
        _APERTURE: SquareStop(half_side_na=before.nominal_na(pitch_m)),
    }
    return stops.get(kind)


def _size_field(square: SquareStop, pitch_m: float) -> WidgetEdit | None:
    if square.half_side_na is not None:
        reset = SquareStop().nominal_na(pitch_m)
        return number_field("half side NA", APERTURE, square.half_side_na, reset, "Half the side, as an aperture.")
    edited = None
    if square.wavelength_m is not None:
        doc = "Where the stop is as wide as the first order."
        edited = number_field("at", _WAVELENGTH, square.wavelength_m, _REFERENCE_M, doc, _VISIBLE_M)
    if edited is not None:
        at_m = float(f"{edited.value:.6g}")  # as precise as a slider, so that the text is "620 nm"
        return WidgetEdit(SquareStop(wavelength_m=at_m, scale=square.scale).text, edited.is_held)
    wider = number_field("width", _WIDTH, square.scale, 1.0, "Of the stop over that of the first order.", _WIDTH_SPAN)
    if wider is None:
        return None
    return WidgetEdit(SquareStop(wavelength_m=square.wavelength_m, scale=wider.value).text, wider.is_held)
