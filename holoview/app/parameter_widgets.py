"""Widgets for the parameters of a system, made from their metadata: unit, range, choices and description."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from imgui_bundle import imgui

from holoview.model.effects.parameter import ListParameter, Parameter
from holoview.model.fields import Choice, Integer, Number
from holoview.util import units

_RESET_MULTIPLE = 3.0  # the limit of a slider, as a multiple of the value that a right click restores
_MAX_RATIO = 1000.0  # of the limits of a kind, up to which a slider covers its whole range
_PRIOR_MULTIPLE = 5.0  # the limit of an effect's slider, as a multiple of the parameter's prior
_TOOLTIP_EM = 26.0  # width of tooltips, in heights of the font: about that of a panel


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
    entered, text = imgui.input_text(name, shown, imgui.InputTextFlags_.enter_returns_true)
    if _tooltip_and_reset(f"{p.doc}\nnumbers with commas; Enter accepts them, a right click empties the list"):
        return WidgetEdit(p.identity, False)
    return WidgetEdit(text, False) if entered else None


def count_field(name: str, kind: Integer, value: int, reset: int, doc: str) -> WidgetEdit | None:
    """Draws a slider for an integer; see `number_field`."""
    high = min(kind.high, max(4, 2 * reset))
    changed, shown = imgui.slider_int(name, value, kind.low, high)
    if _tooltip_and_reset(f"{doc}\nfrom {kind.low} to {kind.high}; right click: back to {reset}"):
        return WidgetEdit(reset, False)
    return WidgetEdit(int(shown), imgui.is_item_active()) if changed else None


def choice_field(name: str, kind: Choice, value: str, doc: str) -> WidgetEdit | None:
    """Draws a combo box of the kind's options; see `number_field`."""
    options = list(kind.options)
    changed, index = imgui.combo(name, options.index(value), options)
    _tooltip_and_reset(doc)
    return WidgetEdit(options[index], False) if changed else None


def unit_scale(kind: Number) -> float:
    """The factor from SI units to the unit in which values are shown."""
    if not kind.unit:
        return 1.0
    return 1.0 / units.parse(f"1 {kind.unit}", "unit", units.quantity_of(kind.unit))


def format_value(kind: Number, value: float) -> str:
    """A value in SI units as text with its unit."""
    return units.format_rounded(value, kind.unit).replace("um", "µm") if kind.unit else f"{value:.4g}"


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
    text = f"%.4g {scale.unit.replace('um', 'µm')}".strip()
    changed, shown = imgui.slider_float(
        name, value * scale.factor, low, high, text, imgui.SliderFlags_.no_round_to_format
    )
    if _tooltip_and_reset(note):
        return WidgetEdit(reset, False)
    return WidgetEdit(_rounded(shown) / scale.factor, imgui.is_item_active()) if changed else None


def _rounded(shown: float) -> float:
    """Rounds to six digits, so that a slider's float32 isn't written to a preset as 2.0000000949949026 mm."""
    return float(f"{shown:.6g}")


def tooltip(text: str) -> None:
    """Shows a tooltip while the pointer rests on the last item."""
    if text and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        show_tooltip(text)


def show_tooltip(text: str) -> None:
    """Shows a tooltip in this frame; lines that are longer than a panel is wide are wrapped."""
    if imgui.begin_tooltip():
        imgui.push_text_wrap_pos(_TOOLTIP_EM * imgui.get_font_size())
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


def _tooltip_and_reset(doc: str) -> bool:
    """Shows a tooltip for the last item; returns whether the item was clicked with the right button."""
    tooltip(doc)
    return imgui.is_item_clicked(imgui.MouseButton_.right)
