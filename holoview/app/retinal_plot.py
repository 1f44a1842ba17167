"""What the panel of speckle says of the retina: through which pupil, and the contrast against its diameter."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from holoview.app import plots, theme
from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.document.eye_edits import dioptres_text, pupil_diameter_m
from holoview.document.retinal_curve import RetinalCurve
from holoview.metrics.speckle import independent_patterns

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
    if context.session.system.eye is None or not imgui.collapsing_header(
        "Contrast by the pupil", imgui.TreeNodeFlags_.default_open
    ):
        return
    job = curves.job
    if job is not None:
        imgui.progress_bar(job.fraction, imgui.ImVec2(-1, 0), job.note)
        if imgui.button("Cancel##pupils"):
            job.cancel()
    elif curves.curve is None:
        if imgui.button("Compute##pupils", imgui.ImVec2(-1, 0)):
            context.attempt(curves.start)
        context.record_item_rect("contrast by the pupil")
        tooltip("Contrast of the region for pupils of 2 to 6 mm at this place and focus, in the background.")
    if curves.curve is not None:
        _draw_curve(curves.curve, pupil_diameter_m(context.session.system) * 1e3)


def _draw_curve(curve: RetinalCurve, pupil_mm: float) -> None:
    x = np.array([contrast.pupil_m * 1e3 for contrast in curve.contrasts])
    every, cones = (
        np.array([getattr(contrast, name) for contrast in curve.contrasts]) for name in ("contrast", "cone_contrast")
    )
    top = 1.4 * max(float(every.max()), curve.independent)
    span = (min(x[0], pupil_mm) - _MARGIN_MM, max(x[-1], pupil_mm) + _MARGIN_MM)
    legend = implot.Location_.south if cones.min() > _LEGEND_SHARE * top else implot.Location_.north
    with plots.plot(
        "contrast by pupil", "pupil (mm)", "contrast", span, (0, top), legend, has_flat_legend=True
    ) as is_open:
        if is_open:
            plots.line("samples", x, every, theme.ACCENT, marked=True)
            plots.line("cones", x, cones, _CONES, marked=True)
            law = f"1/√{independent_patterns(curve.independent):.3g}"
            plots.line(law, np.array(span), np.full(2, curve.independent), plots.GREY)
            plots.line("##now", np.full(2, pupil_mm), np.array([0, top]), theme.WARNING)
    tooltip(
        "Blue: contrast at every sample. Green: of its means over foveal cones (0.5 arcmin), which hide fine speckle. "
        "Grey: of independent patterns of these lasers, whatever the pupil. Yellow: the pupil as it is."
        + (" The target's structure is divided out, as the same eye sees it." if curve.has_target else "")
    )
