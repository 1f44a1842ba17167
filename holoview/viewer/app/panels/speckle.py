"""The panel of speckle measurements: contrast of a region, histogram, contrast by wavelengths, line profile."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from imgui_bundle import imgui, implot

from holoview.holograms.metrics.speckle import SpeckleHistogram
from holoview.util.text import printable
from holoview.viewer.app import plots, theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.plots import draw_retinal_curve, draw_retinal_state
from holoview.viewer.app.widgets import (
    command_button,
    dimmed,
    header,
    is_taken_over,
    next_item,
    room_for_labels,
    share_of_width,
    tooltip,
    wrapped_text,
)
from holoview.viewer.document.measurements import ContrastCurve, ImageMeasurements, LineProfile
from holoview.viewer.document.optimisation_job import SchemeComparison, SchemeComparisonJob, start_scheme_comparison
from holoview.viewer.render.view_settings import NOW

_TIPS = {
    "Contrast": "Standard deviation over mean of the luminance. Fully developed speckle has 1; N independent patterns "
    "together have 1/√N. With a target, the picture's own structure is divided out; without one it counts, and the "
    "number is called raw. ± is one standard error, from the independent grains of the region.",
    "Cones": "Contrast of means over discs of 0.5 arcmin, the size of foveal cones: finer speckle isn't seen.",
    "Grains": "Width of a speckle grain, about the wavelength over the pupil, in minutes of arc.",
    "Mean": "Mean luminance of the region; 1 is the display's white.",
    "PSNR": "Peak signal-to-noise ratio to the target in this region, linear sRGB clipped to 0…1.",
    "ΔE2000": "Mean CIEDE2000 colour difference to the target in this region; 1 is about the least that can be seen.",
    "Patterns": "Independent speckle patterns that lasers, frames and sources could bring, by their brightness: "
    "(Σm)²/Σm².",
}
_PROFILE_COLOURS = {
    "R": imgui.ImVec4(0.85, 0.30, 0.28, 0.7),
    "G": imgui.ImVec4(0.25, 0.65, 0.32, 0.7),
    "B": imgui.ImVec4(0.35, 0.45, 0.90, 0.7),
}
_NARROW_EM = 14  # a panel of fewer heights of the font has no room for names beside whole values
_LEGEND_ROOM = 1.4  # of the height of a plot, over its values
_NAMES = {"Contrast": "speckle contrast", "Cones": "as cones see it", "Grains": "grains", "Mean": "mean luminance"}


class SpecklePanel(Panel):
    """Shows live measurements of the image, and compares two colour schemes."""

    title = "Speckle"
    dock = "Right"

    def __init__(self) -> None:
        self._comparison_job: SchemeComparisonJob | None = None
        self._iterations = 0

    def set_up(self, context: AppContext) -> None:
        """Adds the commands."""
        add, region, line = partial(context.commands.add, "Speckle"), "region", "line"
        add("Draw a region", lambda: _toggle_tool(context, region), "Shift+R", "Drag on the image; figures follow it.")
        profile = "Drag on the image; its profile is plotted."
        add("Draw a line", lambda: _toggle_tool(context, line), "Shift+L", profile)
        back = "Back to the central half of the image."
        add("Forget region, line and cursor", lambda: _clear_selection(context), help=back)
        both = "The same bench with 3 and with 8 wavelengths, side by side, each with its speckle contrast."
        add("Simultaneous beside HoloChrome", lambda: self._compare(context), "F5", both)

    def draw(self, context: AppContext) -> None:
        """Draws tools, numbers, plots, and the comparison of schemes."""
        context.wants_measurement = True
        _draw_tools(context)
        draw_retinal_state(context)
        measurements = context.live_measurement.measurements
        if measurements is None:
            imgui.text_disabled("The image is on its way.")
        else:
            if context.session.view_settings.shown != NOW:
                title = printable(context.session.document.title)
                text = f"Of 1, {title}, which is edited; the table of all regions has those of the shown one too."
                wrapped_text(text, theme.signal_colour("warning"))
            with dimmed(context.has_old_figures):
                _draw_numbers(context, measurements)
            draw_retinal_curve(context)
            with dimmed(context.has_old_figures):
                _draw_plots(measurements)
        self._draw_comparison(context)

    @property
    def comparison(self) -> SchemeComparison | None:
        """The result of the last comparison of schemes; None before it is done."""
        return None if self._comparison_job is None else self._comparison_job.result

    def _draw_comparison(self, context: AppContext) -> None:
        imgui.separator_text("Colour schemes")
        if context.session.target_spec is not None:
            label = next_item("iterations##showcase", 6 * imgui.get_font_size())
            _, self._iterations = imgui.input_int(label, self._iterations, 10, 50)
            self._iterations = min(max(self._iterations, 0), 1000)
            tooltip("0 takes random patterns for both; else both are optimised for the target, from equal starts.")
        job = self._comparison_job
        if job is not None and job.is_active:
            imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), job.note)
            if imgui.button("Cancel##showcase"):
                job.cancel()
            return
        command_button(context, "Simultaneous beside HoloChrome", "Compare##showcase", width=-1)
        if self.comparison is not None:
            for compared in (self.comparison.left, self.comparison.right):
                imgui.text_wrapped(f"{compared.name}: contrast {compared.words()}")
            imgui.text_disabled(self.comparison.method)

    def _compare(self, context: AppContext) -> None:
        with context.session.report_errors():
            self._comparison_job = start_scheme_comparison(context.session, self._iterations)


def _toggle_tool(context: AppContext, tool: str) -> None:
    context.drag_tool = "" if context.drag_tool == tool else tool


def _clear_selection(context: AppContext) -> None:
    context.drag_tool = ""
    context.session.edit_view(
        "Forget region, line and cursor", region=None, other_regions=(), profile=None, cursor=None
    )


def _draw_tools(context: AppContext) -> None:
    width = share_of_width(3)
    for tool in ("region", "line"):
        command_button(context, f"Draw a {tool}", tool.capitalize(), width=width, is_on=context.drag_tool == tool)
        imgui.same_line()
    command_button(context, "Forget region, line and cursor", "Forget", width=width)
    state = context.session.document
    with room_for_labels("x y w h"):
        by_enter = imgui.InputTextFlags_.enter_returns_true
        changed, numbers = imgui.input_int4("x y w h", list(state.measured_region), by_enter)
    changed = is_taken_over(changed)
    tooltip("The region in samples of the image: left, top, width, height. Enter takes them over, Escape drops them.")
    if changed:
        with context.session.report_errors("region"):
            x, y, w, h = numbers
            context.session.edit_view("Region", region=(x, y, w, h))
    command_button(context, "Regions", "All regions…", width=-1)


def _draw_numbers(context: AppContext, measurements: ImageMeasurements) -> None:
    if measurements.problem:
        wrapped_text(measurements.problem, theme.signal_colour("warning"))
    region = measurements.region
    if region is None or not _begin_numbers():
        return
    _row("Contrast", region.text)
    if region.psnr_db is not None:
        _row("Contrast", f"{region.raw_contrast:.3f}", "with the picture's structure")
    if measurements.retinal is not None:
        cones = measurements.retinal.cone_contrast
        seen = "withheld" if cones is None else f"{cones:.3f}"
        _row("Cones", seen, f"as cones see it{', raw' * bool(region.withheld)}")
        _row("Grains", f"{measurements.retinal.grain_arcmin:.2f} arcmin")
    _row("Mean", f"{region.mean:.4g}")
    if measurements.histogram is not None:
        _row("Patterns", f"{measurements.histogram.pattern_count:.2f}", "independent patterns, at most")
    if region.psnr_db is not None and region.delta_e is not None:
        _row("PSNR", f"{region.psnr_db:.2f} dB")
        _row("ΔE2000", f"{region.delta_e:.2f}")
    imgui.end_table()
    context.record_item_rect("figures")
    if region.withheld:
        wrapped_text(f"The contrast is withheld: {region.withheld}.", theme.signal_colour("warning"))
    if region.doubt:
        wrapped_text(f"Note: {region.doubt}.", theme.signal_colour("warning"))


def _begin_numbers() -> bool:
    """Begins the table, whose values are seen whole; names take the rest, in as many lines as they need.

    Where names would be broken inside words, values have lines too.
    """
    is_narrow = imgui.get_content_region_avail().x < _NARROW_EM * imgui.get_font_size()
    is_open = imgui.begin_table("numbers", 2)
    if is_open:
        imgui.table_setup_column("name", imgui.TableColumnFlags_.width_stretch, 1.3)
        kind = imgui.TableColumnFlags_.width_stretch if is_narrow else imgui.TableColumnFlags_.width_fixed
        imgui.table_setup_column("value", kind, 1.0 if is_narrow else 0.0)
    return is_open


def _row(key: str, value: str, label: str = "") -> None:
    imgui.table_next_row()
    imgui.table_next_column()
    imgui.text_wrapped(label or _NAMES.get(key, key))
    tooltip(_TIPS[key])
    imgui.table_next_column()
    if imgui.table_get_column_flags() & imgui.TableColumnFlags_.width_stretch:
        imgui.text_wrapped(value)
    else:
        imgui.text(value)


def _draw_plots(measurements: ImageMeasurements) -> None:
    if measurements.histogram is not None and header("Histogram"):
        _draw_histogram(measurements.histogram)
    if measurements.curve is not None and header("Contrast by wavelengths", "By wavelengths"):
        _draw_curve(measurements.curve)
    if measurements.profiles and header("Profile along the line", "Profile"):
        _draw_profiles(measurements.profiles)


def _draw_histogram(histogram: SpeckleHistogram) -> None:
    top = 1.1 * max(float(histogram.density.max()), 1.0)
    with plots.plot("histogram", "luminance / mean", "density", (0, histogram.edges[-1]), (0, top)) as is_open:
        if is_open:
            width = float(histogram.edges[1] - histogram.edges[0])
            plots.bars("image", histogram.centres, histogram.density, width)
            plots.line(
                "one laser", histogram.centres, histogram.fully_developed_density, theme.signal_colour("warning")
            )
            if histogram.pattern_count > 1:
                name = f"{histogram.pattern_count:.3g} patterns"
                plots.line(name, histogram.centres, histogram.expected_density, theme.curve_colour(plots.GREY))


def _draw_curve(curve: ContrastCurve) -> None:
    count = np.arange(1, len(curve.measured) + 1)
    top = 1.1 * max(float(curve.measured.max()), 1.0)
    low_left = implot.Location_.south_west  # contrast falls, and not to zero
    with plots.plot(
        "curve", "wavelengths, brightest first", "contrast", (0.5, count[-1] + 0.5), (0, top), low_left
    ) as is_open:
        if is_open:
            name = "image, raw" if curve.is_raw else "image"
            plots.line(name, count, curve.measured, theme.signal_colour("accent"), marked=True)
            plots.error_bars(name, count, curve.measured, curve.errors)
            plots.line("independent", count, curve.independent, theme.curve_colour(plots.GREY), marked=True)


def _draw_profiles(profiles: Sequence[LineProfile]) -> None:
    """Luminance, R, G and B of the first image, and the luminance of those beside it."""
    first = profiles[0]
    x, top = first.distance_m * 1e3, max(float(of.values.max()) for of in profiles)
    span, high, above = (0, float(x[-1])), (0, _LEGEND_ROOM * max(top, 1e-9)), implot.Location_.north
    with plots.plot("profile", "mm", "1 = white", span, high, above, has_flat_legend=True) as is_open:
        if is_open:
            for number, (name, colour) in enumerate(_PROFILE_COLOURS.items(), start=1):
                plots.line(name, x, first.values[:, number], theme.curve_colour(colour))
            plots.line("Y", x, first.values[:, 0], theme.signal_colour("accent"))
            for number, other in enumerate(profiles[1:]):
                colour = theme.signal_colour("warning") if number == 0 else theme.curve_colour(plots.GREY)
                plots.line(f"Y of {other.image}", other.distance_m * 1e3, other.values[:, 0], colour)
    tooltip("Y: luminance. R, G, B: linear sRGB. Of an image beside it, the luminance.")
