"""The panel of the chromaticity diagram and its observer: gamuts of lasers and displays, colours of the image."""

from __future__ import annotations

from functools import cache

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from holoview.holograms.metrics.gamut import chromaticity, convex_hull
from holoview.light.colour import observer_range_m, observer_weights, to_srgb8, xyz_to_linear_srgb
from holoview.light.model.fields import Number
from holoview.light.model.system import System
from holoview.light.observers import AGE_YEARS, FIELD_DEG, parse_observer
from holoview.viewer.app import plots
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.parameter_widgets import number_field
from holoview.viewer.app.theme import curve_colour
from holoview.viewer.app.widgets import combo
from holoview.viewer.render.view_settings import NOW

_TRIANGLE_COLOURS = {"sRGB": imgui.ImVec4(0.75, 0.75, 0.75, 1.0), "Display P3": imgui.ImVec4(0.95, 0.72, 0.30, 1.0)}
_LASER_LINE = imgui.ImVec4(0.35, 0.75, 1.0, 1.0)
_OUTLINE = imgui.ImVec4(0.55, 0.57, 0.60, 1.0)
_MAX_CLOUD_POINTS = 1500


class GamutPanel(Panel):
    """Draws the gamut of the lasers and those of displays."""

    title = "Gamut"
    dock = "Right"

    def __init__(self) -> None:
        self._cloud: tuple[object, NDArray[np.float64], NDArray[np.uint8]] | None = None

    def draw(self, context: AppContext) -> None:
        _draw_observer(context)
        system = context.session.system
        flags = implot.Flags_.equal | implot.Flags_.no_menus
        if not implot.begin_plot("##gamut", imgui.ImVec2(-1, -1), flags):
            return
        implot.push_style_var(implot.StyleVar_.legend_inner_padding, imgui.ImVec2(3, 1))  # as small as it can be: the
        implot.push_style_var(implot.StyleVar_.legend_padding, imgui.ImVec2(2, 2))  # lasers are beside it
        implot.setup_axes("x", "y")
        implot.setup_axes_limits(-0.02, 0.78, -0.02, 0.88)
        implot.setup_legend(implot.Location_.north_east, implot.LegendFlags_.no_buttons)
        _plot_outline("spectrum", spectral_locus(system.observer), _OUTLINE)
        for name, corners in DISPLAY_PRIMARIES.items():
            _plot_outline(name, np.array(corners), _TRIANGLE_COLOURS[name])
        self._draw_cloud(context)
        _plot_outline("lasers", laser_gamut(system), _LASER_LINE, 2.0)
        for index, (x, y) in enumerate(laser_chromaticities(system)):
            plots.laser_mark(index, float(system.wavelengths_m[index]), x, y)
        _dot("##white", *D65_XY, imgui.ImVec4(1, 1, 1, 1), 3)
        implot.end_plot()
        implot.pop_style_var(2)

    def _draw_cloud(self, context: AppContext) -> None:
        xyz = context.side_renderers.xyz(NOW)
        if xyz is not None and (self._cloud is None or self._cloud[0] is not xyz):
            points, colours = image_chromaticities(
                xyz * 2.0**context.session.view_settings.exposure_stops, _MAX_CLOUD_POINTS
            )
            self._cloud = (xyz, points, colours)
        if self._cloud is None or len(self._cloud[1]) == 0:
            return
        _, points, _ = self._cloud
        spec = implot.Spec(
            marker=implot.Marker_.circle,
            marker_size=1.0,
            marker_line_color=imgui.ImVec4(0.8, 0.8, 0.85, 0.35),
            marker_fill_color=imgui.ImVec4(0.8, 0.8, 0.85, 0.35),
        )
        implot.plot_scatter("image", _column(points, 0), _column(points, 1), spec=spec)


_EYE, _MORE = "eye by age and field", "person or table"
_KINDS = {_EYE: "eye", "CIE 1931, 2°": "cie1931", "CIE 1964, 10°": "cie1964", "mono camera": "mono"}
_OBSERVER_DOC = (
    "Who looks: an eye of an age and a size of the field (CIE 2006), colour-matching functions, or a camera. "
    "People and tables are chosen on the command line, by --observer."
)


def _draw_observer(context: AppContext) -> None:
    """Draws the choice of an observer, and of an eye its age and field."""
    who = parse_observer(context.session.system.observer)
    is_eye = who.kind == "eye" or (who.kind == "person" and not who.parameters)
    now = _EYE if is_eye else next((name for name, kind in _KINDS.items() if kind == who.kind), _MORE)
    width = imgui.get_content_region_avail().x
    imgui.push_item_width(0.6 * width)
    chosen = combo("observer", now, [*_KINDS, _MORE] if now == _MORE else list(_KINDS), _OBSERVER_DOC)
    context.record_item_rect("observer")
    if chosen != now and chosen != _MORE:
        context.change("Observer", "observer", _KINDS[chosen])
    imgui.pop_item_width()
    if is_eye:
        imgui.push_item_width(0.25 * width)
        age = number_field("age", Number("", *AGE_YEARS), who.age_years, 32.0, "Years.", AGE_YEARS)
        context.record_item_rect("age")
        imgui.same_line()
        field = number_field("field (°)", Number("", *FIELD_DEG), who.field_deg, 2.0, "Degrees.", FIELD_DEG)
        context.record_item_rect("field")
        if edited := age or field:
            terms = (age.value if age else who.age_years, field.value if field else who.field_deg)
            text = "age {:.3g}, field {:.3g}".format(*terms)
            context.change("Observer", "observer", text, is_held=edited.is_held)
        imgui.pop_item_width()


def _column(points: NDArray[np.float64], index: int) -> NDArray[np.float64]:
    return np.ascontiguousarray(points[:, index])


def _plot_outline(name: str, points: NDArray[np.float64], colour: imgui.ImVec4, weight: float = 1.0) -> None:
    if len(points) == 0:
        return
    closed = np.vstack([points, points[:1]])
    spec = implot.Spec(line_color=curve_colour(colour), line_weight=weight)
    implot.plot_line(name, _column(closed, 0), _column(closed, 1), spec=spec)


def _dot(name: str, x: float, y: float, colour: imgui.ImVec4, size: float) -> None:
    spec = implot.Spec(
        marker=implot.Marker_.circle,
        marker_size=size,
        marker_fill_color=colour,
        marker_line_color=imgui.ImVec4(0, 0, 0, 1),
    )
    implot.plot_scatter(name, np.array([x]), np.array([y]), spec=spec)


# Data of the chromaticity diagram: spectral locus, display primaries, gamut of the lasers, colours of an image.
#
# All are chromaticities x = X/(X+Y+Z), y = Y/(X+Y+Z). For the observer "eye" they are computed from the XYZ_F of the
# cone fundamentals (CIE 170-2) and drawn in the same diagram as CIE 1931, from which they differ slightly.


Floats = NDArray[np.float64]

DISPLAY_PRIMARIES: dict[str, tuple[tuple[float, float], ...]] = {
    "sRGB": ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060)),
    "Display P3": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),
}
"""Chromaticities of the primaries red, green, blue: IEC 61966-2-1 and SMPTE EG 432-1."""
D65_XY = (0.3127, 0.3290)
"""Chromaticity of the daylight illuminant D65, CIE 1931."""
_LOCUS_RANGE_M = (390e-9, 700e-9)  # the locus turns back by less than a line's width beyond 700 nm
_LOCUS_POINTS = 156
_MIN_LUMINANCE = 0.01


@cache
def spectral_locus(observer: str = "eye") -> Floats:
    """Chromaticities (wavelength, 2) of monochromatic light from 390 to 700 nm; CIE 1931 for a camera."""
    kind = "cie1931" if parse_observer(observer).kind in ("mono", "camera") else observer
    low, high = observer_range_m(kind)
    at_m = np.linspace(max(low, _LOCUS_RANGE_M[0]), min(high, _LOCUS_RANGE_M[1]), _LOCUS_POINTS)
    xy = chromaticity(observer_weights(kind, at_m))
    xy.setflags(write=False)
    return xy


def laser_chromaticities(system: System) -> Floats:
    """Chromaticities (wavelength, 2) of the lasers for the system's observer; for the eye if that is a camera."""
    kind = "eye" if parse_observer(system.observer).kind in ("mono", "camera") else system.observer
    return chromaticity(observer_weights(kind, system.wavelengths_m))


def laser_gamut(system: System) -> Floats:
    """Corners (n, 2) of the convex hull of the lasers that are on: the colours that they can mix, in order."""
    on = np.any(system.amplitudes > 0, axis=0)
    return convex_hull(laser_chromaticities(system)[on])


def image_chromaticities(xyz: NDArray[np.floating], most: int = 3000) -> tuple[Floats, NDArray[np.uint8]]:
    """Chromaticities (n, 2) and 8-bit sRGB (n, 3) of at most `most` evenly chosen samples of XYZ (y, x, 3).

    Samples with a luminance below 1 % of white are left out, since their chromaticity is mostly noise.
    """
    flat = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)
    bright = flat[flat[:, 1] > _MIN_LUMINANCE]
    chosen = bright[:: max(-(-len(bright) // most), 1)]
    return chromaticity(chosen), to_srgb8(xyz_to_linear_srgb(chosen))
