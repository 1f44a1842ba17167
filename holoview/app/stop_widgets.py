"""Widgets for the stops of a relay: the square stop, and the centre of the iris and the square stop."""

from __future__ import annotations

from imgui_bundle import imgui

from holoview.app.parameter_widgets import WidgetEdit, number_field, tooltip
from holoview.model.fields import Number
from holoview.model.stops import APERTURE, SquareField, SquareStop

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
    now, kinds = _kind(value), list(_KINDS)
    changed, index = imgui.combo(name, kinds.index(now), kinds)
    tooltip(f"{doc}\n{_KINDS[now]}")
    if changed and kinds[index] != now:
        return WidgetEdit(SquareField().to_toml(_of_kind(kinds[index], value, pitch_m)), False)
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
