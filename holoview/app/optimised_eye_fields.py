"""The fields of the panel *Optimise* for the eye: places of its pupil, and what is done about its colour error."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.optimise.eyes import (
    CHROMATIC,
    MOST_ALONG_AXIS,
    MOST_DRAWN,
    PupilChoice,
    PupilDraw,
    PupilGrid,
    parse_pupils,
)

_KINDS = {
    "where it is": None,
    "on a grid": PupilGrid(3, 3, 0.6e-3),
    "drawn anew": PupilDraw(4, 0.8e-3),
}
_LEAST_MM, _MOST_MM = 0.1, 2.0
_TIPS = {
    "pupil": "Places of the pupil from each of which the target counts, about where it is. Drawn anew: other ones in "
    "each iteration, within a radius.",
    "colour error": "Ignore: patterns as for an eye without chromatic aberration; the picture is always what the eye "
    "sees.",
    "no eye": "An eye (Y) has these choices.",
}


def draw_eye_fields(context: AppContext) -> None:
    """Draws the choices; without an eye they are there, but can't be made."""
    session = context.session
    has_eye = session.system.eye is not None
    imgui.separator_text("the eye")
    if not has_eye:
        imgui.text_disabled(_TIPS["no eye"])
    imgui.begin_disabled(not has_eye)
    choices = session.optimisation_choices
    pupils = _edit_pupils(parse_pupils(choices.pupils) if choices.pupils else None)
    found, index = imgui.combo("colour error", CHROMATIC.index(choices.chromatic), list(CHROMATIC))
    tooltip(_TIPS["colour error"])
    imgui.end_disabled()
    chromatic = CHROMATIC[index] if found else choices.chromatic
    text = "" if pupils is None else str(pupils)
    session.choose_optimisation(replace(choices, pupils=text, chromatic=chromatic))


def _edit_pupils(pupils: PupilChoice | None) -> PupilChoice | None:
    """Draws where the pupil is; returns that as it is after the edit."""
    names = list(_KINDS)
    kind = next(name for name, usual in _KINDS.items() if type(usual) is type(pupils))
    found, index = imgui.combo("pupil", names.index(kind), names)
    tooltip(_TIPS["pupil"])
    if found and names[index] != kind:
        return _KINDS[names[index]]
    if isinstance(pupils, PupilGrid):
        _, (rows, columns) = imgui.input_int2("rows, columns", [pupils.rows, pupils.columns])
        rows, columns = (min(max(count, 1), MOST_ALONG_AXIS) for count in (rows, columns))
        return PupilGrid(rows, columns, _edit_length("spacing", pupils.spacing_m))
    if isinstance(pupils, PupilDraw):
        _, count = imgui.input_int("places", pupils.count)
        return PupilDraw(min(max(count, 1), MOST_DRAWN), _edit_length("radius", pupils.radius_m))
    return None


def _edit_length(name: str, length_m: float) -> float:
    """Draws a slider of millimetres; returns the length in metres, rounded to hundredths if it was moved."""
    flags = imgui.SliderFlags_.always_clamp
    moved, shown = imgui.slider_float(name, length_m * 1e3, _LEAST_MM, _MOST_MM, "%.2f mm", flags)
    return round(shown, 2) * 1e-3 if moved else length_m
