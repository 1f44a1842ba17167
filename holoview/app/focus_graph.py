"""A graph of which plane the eye sees at which wavelength, beside the focal planes of the bench."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from holoview.app import theme
from holoview.app.context import AppContext
from holoview.app.laser_colours import laser_colour
from holoview.app.parameter_widgets import tooltip
from holoview.document.eye_edits import dioptres_of, seen_planes_m

_HEIGHT = 170.0
_FLAGS = implot.Flags_.no_menus | implot.Flags_.no_legend | implot.Flags_.no_mouse_text | implot.Flags_.no_inputs
_AXIS = implot.AxisFlags_.no_grid_lines | implot.AxisFlags_.no_menus | implot.AxisFlags_.no_highlight
_FIRST_NM, _LAST_NM = 390.0, 710.0
_PLANE = imgui.ImVec4(0.55, 0.57, 0.60, 0.8)
_MARGIN = 0.1  # of the range, above and below


def draw_focus_graph(context: AppContext) -> None:
    """Draws the planes (mm, and dioptres on the right) over the wavelength: a curve, and a dot for each laser."""
    system, plane_m = context.session.system, context.session.view_settings.plane_m
    wavelengths_nm = np.linspace(_FIRST_NM, _LAST_NM, 65)
    curve, seen = (seen_planes_m(system, plane_m, at) for at in (wavelengths_nm * 1e-9, system.wavelengths_m))
    low, high = min(system.planes_m.min(), seen.min()), max(system.planes_m.max(), seen.max())
    margin = _MARGIN * (high - low) or 1e-3
    low, high = low - margin, high + margin
    if not implot.begin_plot("##focus of wavelengths", imgui.ImVec2(-1, _HEIGHT), _FLAGS):
        return
    implot.setup_axes("wavelength (nm)", "plane seen (mm)", _AXIS, _AXIS)
    implot.setup_axis(implot.ImAxis_.y2, "dioptres", _AXIS | implot.AxisFlags_.opposite)
    implot.setup_axis_limits(implot.ImAxis_.x1, _FIRST_NM, _LAST_NM, imgui.Cond_.always)
    implot.setup_axis_limits(implot.ImAxis_.y1, low * 1e3, high * 1e3, imgui.Cond_.always)
    ends = dioptres_of(system, low), dioptres_of(system, high)
    implot.setup_axis_limits(implot.ImAxis_.y2, *ends, imgui.Cond_.always)
    for plane in system.planes_m.tolist():
        line = np.array([plane, plane]) * 1e3
        implot.plot_line("##planes", np.array([_FIRST_NM, _LAST_NM]), line, implot.Spec(line_color=_PLANE))
    implot.plot_line("##curve", wavelengths_nm, curve * 1e3, implot.Spec(line_color=theme.ACCENT, line_weight=1.5))
    for index, (wavelength, plane) in enumerate(zip(system.wavelengths_m.tolist(), seen.tolist(), strict=True)):
        _draw_dot(f"##{index}", wavelength, plane)
    implot.end_plot()
    context.record_item_rect("focus of wavelengths")
    tooltip(
        "A dot for each laser: the plane that the eye sees in its light. Grey lines are the focal planes of the bench: "
        "what they hold is sharp for a laser whose dot lies on them."
    )


def _draw_dot(name: str, wavelength_m: float, plane_m: float) -> None:
    colour = laser_colour(wavelength_m)
    spec = implot.Spec(marker=implot.Marker_.circle, marker_size=4, marker_fill_color=colour, marker_line_color=colour)
    implot.plot_scatter(name, np.array([wavelength_m * 1e9]), np.array([plane_m * 1e3]), spec)
