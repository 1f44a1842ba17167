"""Widgets for a bench's parameters, made from what their metadata say: unit, range, choices, a sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from imgui_bundle import imgui

from holoview.model.effects.parameter import Parameter
from holoview.model.field_types import Choice, Integer, Number
from holoview.util import units

_SPAN = 3.0  # a slider reaches to so many times the value that "reset" gives back
_WIDEST_RATIO = 1000.0
_PRIORS = 5.0  # times what is common, to which an effect's slider reaches


@dataclass(frozen=True)
class WidgetEdit:
    """What a widget did: the new value, whether the hand still holds it."""

    value: Any
    is_held: bool


def number_field(
    name: str, kind: Number, value: float, reset: float, doc: str, span: tuple[float, float] | None = None
) -> WidgetEdit | None:
    """A slider with its unit, Ctrl+click for exact entry, right click to reset; the new value in SI, or None.

    The slider covers `span` (SI), or what is near `reset`; exact entry takes all that the kind allows.
    """
    low, high = slider_range(kind, reset) if span is None else span
    note = f"{doc}\n{kind.format_range()}; right click: back to {format_value(kind, reset)}"
    return _slider(name, _Scale(kind.unit, unit_scale(kind)), value, reset, (low, high), note)


def parameter_field(parameter: Parameter, value: float) -> WidgetEdit | None:
    """A slider for a parameter of an effect, over what is common; right click to its identity."""
    p = parameter
    kind = Number(p.shown if p.is_quantity else "", p.low, p.high)
    reach = _PRIORS * p.prior
    first, last, _ = p.scan or (p.identity, p.identity, 0.0)
    low, high = max(p.low, min(p.identity - reach, first)), min(p.high, max(p.identity + reach, last))
    note = f"{p.doc}\n{kind.format_range()}; right click: back to {p.format(p.identity)}, where it does nothing"
    return _slider(p.name.replace("_", " "), _Scale(p.shown, unit_scale(kind)), value, p.identity, (low, high), note)


def count_field(name: str, kind: Integer, value: int, reset: int, doc: str) -> WidgetEdit | None:
    """A slider for a whole number."""
    high = min(kind.high, max(4, 2 * reset))
    changed, shown = imgui.slider_int(name, value, kind.low, high)
    if _tooltip_and_reset(f"{doc}\nfrom {kind.low} to {kind.high}; right click: back to {reset}"):
        return WidgetEdit(reset, False)
    return WidgetEdit(int(shown), imgui.is_item_active()) if changed else None


def choice_field(name: str, kind: Choice, value: str, doc: str) -> WidgetEdit | None:
    """A list to choose from."""
    options = list(kind.options)
    changed, index = imgui.combo(name, options.index(value), options)
    _tooltip_and_reset(doc)
    return WidgetEdit(options[index], False) if changed else None


def unit_scale(kind: Number) -> float:
    """What SI values are multiplied by to be shown."""
    if not kind.unit:
        return 1.0
    quantity: units.Quantity = "angle" if kind.unit.endswith("rad") else "length"
    return 1.0 / units.parse(f"1 {kind.unit}", "unit", quantity)


def format_value(kind: Number, value: float) -> str:
    """A value as people write it."""
    return units.format_rounded(value, kind.unit).replace("um", "µm") if kind.unit else f"{value:.4g}"


def slider_range(kind: Number, reset: float) -> tuple[float, float]:
    """What a slider covers, SI: all that is allowed where that is a narrow range, else what is near `reset`."""
    is_narrow = math.isfinite(kind.low) and math.isfinite(kind.high) and kind.low > -math.inf
    if is_narrow and kind.low > 0 and kind.high / kind.low <= _WIDEST_RATIO:
        return kind.low, kind.high
    reach = _SPAN * abs(reset) or 10.0 / unit_scale(kind)
    low = -reach if kind.low < 0 else 0.0
    return max(low, kind.low), min(reach, kind.high)


@dataclass(frozen=True)
class _Scale:
    """A unit, and what SI values are multiplied by to be shown in it."""

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
    """Six digits: a slider's f32 shouldn't show as 2.0000000949949026 mm in a preset."""
    return float(f"{shown:.6g}")


def tooltip(text: str) -> None:
    """The tooltip of the last item."""
    if text and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        imgui.set_tooltip(text)


def _tooltip_and_reset(doc: str) -> bool:
    """The tooltip of the last item; whether it was clicked with the right button."""
    tooltip(doc)
    return imgui.is_item_clicked(imgui.MouseButton_.right)
