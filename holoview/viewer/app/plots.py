"""Small plots, marks of lasers in them, and the speckle contrast on the retina against the diameter of the pupil."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import ArrayLike, NDArray

from holoview.holograms.metrics.retinal import RetinalCurve
from holoview.holograms.metrics.speckle import independent_patterns
from holoview.viewer.app import theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.theme import laser_colour
from holoview.viewer.app.widgets import button, header, tooltip
from holoview.viewer.document.focus_edits import dioptres_text, pupil_diameter_m

HEIGHT_EM = 9.5
_FLAGS = implot.Flags_.no_menus | implot.Flags_.no_box_select | implot.Flags_.no_mouse_text
_AXIS = implot.AxisFlags_.no_grid_lines | implot.AxisFlags_.no_menus | implot.AxisFlags_.no_highlight
GREY = imgui.ImVec4(0.60, 0.62, 0.66, 1.0)


@contextmanager
def plot(
    name: str,
    x_label: str,
    y_label: str,
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    legend: int = implot.Location_.north_east,
    *,
    has_flat_legend: bool = False,
    height_em: float = HEIGHT_EM,
    takes_input: bool = False,
) -> Iterator[bool]:
    """A context that draws a plot over the panel's width with fixed ranges; yields whether it is visible.

    legend: its place, where there are no data. has_flat_legend: whether its entries stand beside each other.
    height_em: its height, in heights of the font. takes_input: whether it knows of the mouse.
    """
    size = imgui.ImVec2(-1, height_em * imgui.get_font_size())
    is_open = implot.begin_plot(f"##{name}", size, _FLAGS | (0 if takes_input else implot.Flags_.no_inputs))
    try:
        if is_open:
            implot.setup_axes(x_label, y_label, _AXIS, _AXIS)
            implot.setup_axes_limits(*x_range, *y_range, implot.Cond_.always)
            flat = implot.LegendFlags_.horizontal if has_flat_legend else implot.LegendFlags_.none
            implot.setup_legend(legend, implot.LegendFlags_.no_buttons | flat)
        yield is_open
    finally:
        if is_open:
            implot.end_plot()


def bars(name: str, centres: ArrayLike, heights: ArrayLike, width: float) -> None:
    """Draws bars in the accent colour."""
    accent = theme.signal_colour("accent")
    spec = implot.Spec(fill_color=accent, fill_alpha=0.55, line_color=accent, line_weight=0.0)
    implot.plot_bars(name, _doubles(centres), _doubles(heights), width, spec)


def line(name: str, x: ArrayLike, y: ArrayLike, colour: imgui.ImVec4, *, marked: bool = False) -> None:
    """Draws a line; `marked` adds a marker at each value."""
    marker = implot.Marker_.circle if marked else implot.Marker_.none
    spec = implot.Spec(line_color=colour, line_weight=1.6, marker=marker, marker_size=3.0, marker_fill_color=colour)
    implot.plot_line(name, _doubles(x), _doubles(y), spec)


def error_bars(name: str, x: ArrayLike, y: ArrayLike, errors: ArrayLike) -> None:
    """Draws a standard error to either side of each value of a line of the same name."""
    spec = implot.Spec(line_color=theme.signal_colour("accent"), line_weight=1.0, size=4.0)
    implot.plot_error_bars(name, _doubles(x), _doubles(y), _doubles(errors), spec)


LASER_MARKERS = tuple(
    getattr(implot.Marker_, name) for name in ("circle", "square", "diamond", "up", "down", "left", "right")
)
"""Shapes of the lasers' marks, in turn, so that they differ without their colours."""


def laser_mark(index: int, wavelength_m: float, x: float, y: float) -> None:
    """Marks the laser of an index at a place of the present plot: its colour, a shape of its own, and its number."""
    ink = imgui.get_style_color_vec4(imgui.Col_.text)
    spec = implot.Spec(
        marker=LASER_MARKERS[index % len(LASER_MARKERS)],
        marker_size=5.0,
        marker_fill_color=laser_colour(wavelength_m),
        marker_line_color=ink,
    )
    implot.plot_scatter(f"##laser{index}", _doubles([x]), _doubles([y]), spec)
    implot.push_style_color(implot.Col_.inlay_text, ink)
    size = imgui.get_font_size()
    implot.plot_text(str(index + 1), x, y, imgui.ImVec2(0.75 * size, -0.5 * size))
    implot.pop_style_color()


def _doubles(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)


# --- What the panel of speckle says of the retina: through which pupil, and the contrast against its diameter ---


_CONES = imgui.ImVec4(0.45, 0.80, 0.50, 1.0)
_MARGIN_MM = 0.2
_LEGEND_SHARE = 0.35  # of the height of the plot


def draw_retinal_state(context: AppContext) -> None:
    """Says that the figures are those of the retinal image, at which accommodation and through which pupil."""
    session = context.session
    if session.system.eye is None:
        return
    dioptres = dioptres_text(session.system, session.view_settings.plane_m)
    pupil_mm = pupil_diameter_m(session.system) * 1e3
    imgui.text_wrapped(f"On the retina, focused at {dioptres}, pupil {pupil_mm:.3g} mm:")


def draw_retinal_curve(context: AppContext) -> None:
    """Draws the contrast against the pupil, or the button that has it computed."""
    curves = context.retinal_curves
    if context.session.system.eye is None or not header("Contrast by the pupil", "By the pupil"):
        return
    job = curves.job
    if job is not None:
        imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), job.note)
        if imgui.button("Cancel##pupils"):
            job.cancel()
    elif curves.curve is None:
        tip = "Contrast of the region for pupils of 2 to 6 mm at this place and focus, in the background."
        if button(context, "Compute##pupils", tip, width=-1, name="contrast by the pupil"):
            context.attempt(curves.start)
    if curves.curve is not None:
        _draw_curve(curves.curve, pupil_diameter_m(context.session.system) * 1e3)


def _draw_curve(curve: RetinalCurve, pupil_mm: float) -> None:
    x = np.array([contrast.pupil_m * 1e3 for contrast in curve.contrasts])
    every, cones = (
        np.array([getattr(contrast, name) for contrast in curve.contrasts], dtype=np.float64)
        for name in ("contrast", "cone_contrast")
    )
    top = 1.4 * max(float(np.nanmax(every, initial=0.0)), curve.independent)
    span = (min(x[0], pupil_mm) - _MARGIN_MM, max(x[-1], pupil_mm) + _MARGIN_MM)
    legend = implot.Location_.south if np.nanmin(cones, initial=top) > _LEGEND_SHARE * top else implot.Location_.north
    with plot("contrast by pupil", "pupil (mm)", "contrast", span, (0, top), legend, has_flat_legend=True) as is_open:
        if is_open:
            line("samples", x, every, theme.signal_colour("accent"), marked=True)
            line("cones", x, cones, theme.curve_colour(_CONES), marked=True)
            law = f"1/√{independent_patterns(curve.independent):.3g}"
            line(law, np.array(span), np.full(2, curve.independent), theme.curve_colour(GREY))
            line("##now", np.full(2, pupil_mm), np.array([0, top]), theme.signal_colour("warning"))
    tooltip(
        "Blue: contrast at every sample. Green: of its means over foveal cones (0.5 arcmin), which hide fine speckle. "
        "Grey: of independent patterns of these lasers, whatever the pupil. Yellow: the pupil as it is."
        + (" The target's structure is divided out, as the same eye sees it." if curve.has_target else "")
        + (f" Where there is no mark, the contrast is withheld: {curve.withheld}." if curve.withheld else "")
    )
