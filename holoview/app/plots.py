"""Small ImPlot plots in the style that all panels share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import ArrayLike, NDArray

from holoview.app import theme

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
) -> Iterator[bool]:
    """A context that draws a plot over the panel's width with fixed ranges; yields whether it is visible.

    legend: its place, where there are no data. has_flat_legend: whether its entries stand beside each other.
    height_em: its height, in heights of the font.
    """
    size = imgui.ImVec2(-1, height_em * imgui.get_font_size())
    is_open = implot.begin_plot(f"##{name}", size, _FLAGS | implot.Flags_.no_inputs)
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
    spec = implot.Spec(fill_color=theme.ACCENT, fill_alpha=0.55, line_color=theme.ACCENT, line_weight=0.0)
    implot.plot_bars(name, _doubles(centres), _doubles(heights), width, spec)


def line(name: str, x: ArrayLike, y: ArrayLike, colour: imgui.ImVec4, *, marked: bool = False) -> None:
    """Draws a line; `marked` adds a marker at each value."""
    marker = implot.Marker_.circle if marked else implot.Marker_.none
    spec = implot.Spec(line_color=colour, line_weight=1.6, marker=marker, marker_size=3.0, marker_fill_color=colour)
    implot.plot_line(name, _doubles(x), _doubles(y), spec)


def _doubles(values: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(values, dtype=np.float64)
