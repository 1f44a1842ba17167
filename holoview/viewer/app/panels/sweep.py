"""The panel of sweeps: a measure against a parameter of the bench, as a curve whose points one clicks."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from imgui_bundle import imgui, implot
from numpy.typing import NDArray

from holoview.viewer.app import plots, theme
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.panel import Panel
from holoview.viewer.app.widgets import button, combo, pale, room_for_labels, tooltip, wrapped_text
from holoview.viewer.document.sweep_job import SweepJob, start_sweep
from holoview.viewer.document.sweeper import MEASURES, SweepRequest, SweptCurve, usual_sweeps

_MARGIN = 0.08  # of the range of a curve, beside it
_OWN = "as written above"
_WITHHELD = "withheld, as the picture doesn't show the target there."
_HINT = "gap=1mm:3mm:9"
_VALUES = (
    "A parameter and its values, as of holoview sweep --set: gap=1mm:3mm:9 are nine values, gap=1mm,2mm these two. "
    "Keys are those of presets, effects.NAME.KEY and optimiser.KEY."
)


class SweepPanel(Panel):
    """Starts a sweep, draws its points as they come, and shows the one that is clicked.

    chosen: the index of the point that is shown; -1 for none.
    """

    title = "Sweep"
    dock = "Low right"
    starts_open = False

    def __init__(self) -> None:
        self._values, self._measure, self._iterations = "", "", 0
        self._job: SweepJob | None = None
        self.chosen = -1

    def set_up(self, context: AppContext) -> None:
        """Adds the command that opens the panel."""
        help = "PSNR, contrast or light against a parameter of the bench; a click on a point shows it."
        context.commands.add("Window", "Sweep a parameter", partial(context.show_panel, self.title), help=help)

    def draw(self, context: AppContext) -> None:
        """Draws the choices, or the progress of a running sweep, and the curve."""
        if context.session.sweeper is None:
            imgui.text_wrapped("A viewer that holoview view opens sweeps parameters; this one can't.")
            return
        job = self._job
        if job is not None and job.is_active:
            imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), f"{job.fraction:.0%}")
            wrapped_text(job.step, pale())
            if button(context, "Cancel##sweep", "Ends it; the points that are there stay.", name="cancel the sweep"):
                job.cancel()
        else:
            with room_for_labels("parameter", "iterations"):
                self._draw_choices(context)
        if job is not None and job.curve is not None and job.curve.points:
            self._draw_curve(context, job, job.curve)

    def has_changed(self, context: AppContext) -> bool:
        """While a sweep runs, the seconds pass."""
        return self._job is not None and self._job.is_active

    def start(self, context: AppContext, request: SweepRequest) -> None:
        """Starts a sweep in place of the one before."""
        self._job, self.chosen = start_sweep(context.session, request), -1

    def show(self, context: AppContext, index: int) -> None:
        """Shows the point of an index; the first and the last have none beside them."""
        if self._job is None or self._job.curve is None or not self._job.curve.points:
            return
        self.chosen = min(max(index, 0), len(self._job.curve.points) - 1)
        context.attempt(self._job.show, context.session, self._job.curve.points[self.chosen])

    def _draw_choices(self, context: AppContext) -> None:
        usual = usual_sweeps(context.session.system)
        self._values = self._values or (usual[0] if usual else "")
        _, self._values = imgui.input_text_with_hint("values", _HINT, self._values)
        tooltip(_VALUES)
        if usual:
            sweeps = {values.partition("=")[0]: values for values in usual}
            now = next((name for name, values in sweeps.items() if values == self._values), _OWN)
            tip = "Parameters that this bench has, from half to one and a half times their value."
            chosen = combo("parameter", now, (_OWN, *sweeps), tip)
            self._values = sweeps.get(chosen, self._values)
        has_target = context.session.target_spec is not None  # of which a contrast is mostly withheld beside its bench
        self._measure = self._measure or ("psnr" if has_target else "contrast")
        named = combo("measure", MEASURES[self._measure], tuple(MEASURES.values()), "As holoview sweep measures it.")
        self._measure = next(name for name, title in MEASURES.items() if title == named)
        self._iterations = min(max(imgui.input_int("iterations", self._iterations, 10, 50)[1], 0), 1000)
        tooltip("0 shows the present patterns at every point; else they are found anew by so many.")
        if button(context, "Sweep##start", width=-1, name="start the sweep"):
            request = SweepRequest(self._values, self._measure, self._iterations)
            context.attempt(self.start, context, request)

    def _draw_curve(self, context: AppContext, job: SweepJob, curve: SweptCurve) -> None:
        x, y, errors = (np.array([getattr(p, key) for p in curve.points]) for key in ("value", "measured", "error"))
        across, up = _widened(x), _widened(np.concatenate((y - errors, y + errors)))
        measure = MEASURES[job.request.measure]
        with plots.plot("sweep", curve.heading, measure, across, up, takes_input=True) as is_open:
            if is_open:
                plots.line("##points", x, y, theme.signal_colour("accent"), marked=True)
                if errors.any():
                    plots.error_bars("##points", x, y, errors)
                if 0 <= self.chosen < len(x):
                    at = self.chosen
                    plots.line("##chosen", x[at : at + 1], y[at : at + 1], theme.signal_colour("warning"), marked=True)
                if implot.is_plot_hovered() and imgui.is_mouse_clicked(imgui.MouseButton_.left):
                    self.show(context, _nearest(x, y))
        context.record_item_rect("curve of the sweep")
        if withheld := int(np.isnan(y).sum()):
            wrapped_text(f"{withheld} of {len(y)} points: {_WITHHELD}", theme.signal_colour("warning"))
        self._draw_point(context, curve)

    def _draw_point(self, context: AppContext, curve: SweptCurve) -> None:
        """The point that is shown in words, and buttons to its neighbours."""
        if imgui.arrow_button("##point before", imgui.Dir.left):
            self.show(context, self.chosen - 1)
        context.record_item_rect("point before")
        imgui.same_line()
        if imgui.arrow_button("##point after", imgui.Dir.right):
            self.show(context, self.chosen + 1)
        context.record_item_rect("point after")
        if not 0 <= self.chosen < len(curve.points):
            wrapped_text("A click on a point shows it.", pale())
            return
        point = curve.points[self.chosen]
        error = f" ± {point.error:.2g}" if point.error else ""
        found = "withheld" if math.isnan(point.measured) else f"{point.measured:.4g}{error}"
        wrapped_text(f"{point.text}: {found}", imgui.get_style_color_vec4(imgui.Col_.text))


def _widened(values: NDArray[np.float64]) -> tuple[float, float]:
    """The range of those values that are known with a margin, also where all are equal."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = _MARGIN * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


def _nearest(x: NDArray[np.float64], y: NDArray[np.float64]) -> int:
    """The point nearest to the mouse on the screen; one whose measure is withheld is anywhere above its value."""
    mouse = imgui.get_io().mouse_pos
    places = [implot.plot_to_pixels(float(a), float(b)) for a, b in zip(x, y, strict=True)]
    away = [
        math.hypot(place.x - mouse.x, 0.0 if math.isnan(b) else place.y - mouse.y)
        for place, b in zip(places, y, strict=True)
    ]
    return int(np.argmin(away))
