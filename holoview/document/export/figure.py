"""Writes a labelled figure of the displayed image as PNG or PDF: scale bar, focal plane, wavelengths, contrast."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.export.suffix import check_suffix
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.document.measure import RegionMetrics, measure_region
from holoview.render.plane_images import render_planes
from holoview.render.tone_mapping import tone_map
from holoview.report.images import figure_bytes, label, new_figure, require_matplotlib
from holoview.util import units
from holoview.util.file_writer import write_file
from holoview.util.packages import import_optional

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".pdf")
_WIDTH_IN, _DPI = 6.4, 200
_MAX_BAR_FRACTION = 0.2  # of the image's width


def save_figure(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes the figure in the background. Raises UserError for another suffix, and if matplotlib isn't installed."""
    path = check_suffix(path, SUFFIXES)
    require_matplotlib("a figure")
    document, target = session.displayed_document, session.target_at()

    def work(control: JobControl) -> Path:
        control.report(0, 2, "rendering")
        (xyz,) = render_planes(document.system, document.drive, [document.view_settings.plane_m], control.check)
        control.report(1, 2, "drawing")
        metrics = measure_region(xyz, document.measured_region, target)
        figure = _draw(document, tone_map(xyz, document.view_settings), metrics)
        write_file(path, figure_bytes(figure, path.suffix.lower().removeprefix(".")))
        return path

    return session.jobs.start("Figure", work, lambda written: session.messages.post(f"figure written to {written}"))


def _draw(document: Document, pixels: NDArray[np.uint8], metrics: RegionMetrics) -> Figure:
    rows, columns = pixels.shape[:2]
    caption_in = 0.55
    figure = new_figure((_WIDTH_IN, _WIDTH_IN * rows / columns + caption_in), dpi=_DPI, layout=None)
    height = 1 - caption_in / figure.get_figheight()
    axes = figure.add_axes((0, 1 - height, 1, height))
    axes.imshow(pixels, interpolation="nearest", aspect="auto")
    axes.set_axis_off()
    _draw_bar(axes, document, rows, columns)
    x, y, width, height_px = document.measured_region
    axes.plot(
        [x, x + width, x + width, x, x],
        [y, y, y + height_px, y + height_px, y],
        color="white",
        linewidth=0.8,
        alpha=0.8,
    )
    figure.text(0.015, 0.012, "\n".join(map(label, caption(document, metrics))), fontsize=7.5, va="bottom")
    return figure


def _draw_bar(axes: Any, document: Document, rows: int, columns: int) -> None:
    """A scale bar of a round length, white with a black outline."""
    pitch_m = document.sample_pitch_m
    length_m = scale_bar_length(_MAX_BAR_FRACTION * columns * pitch_m)
    x0, y = 0.04 * columns, 0.95 * rows
    for color, width in (("black", 5.0), ("white", 3.0)):
        axes.plot([x0, x0 + length_m / pitch_m], [y, y], color=color, linewidth=width, solid_capstyle="butt")
    text = axes.text(x0, y - 0.015 * rows, units.format_rounded(length_m, "mm"), color="white", fontsize=9, va="bottom")
    effects = import_optional("matplotlib.patheffects", "a figure")
    text.set_path_effects([effects.withStroke(linewidth=2, foreground="black")])


def scale_bar_length(most_m: float) -> float:
    """The largest length of 1, 2 or 5 times a power of ten that isn't longer than `most_m`."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(step * power for step in (1, 2, 5) if step * power <= most_m * (1 + 1e-9))


def caption(document: Document, metrics: RegionMetrics) -> list[str]:
    """The lines of text below the image."""
    system, view = document.system, document.view_settings
    lasers = ", ".join(f"{λ * 1e9:.4g}" for λ in system.wavelengths_m)
    fidelity = "" if metrics.psnr_db is None else f", PSNR {metrics.psnr_db:.1f} dB, ΔE2000 {metrics.delta_e:.1f}"
    known = "" if metrics.psnr_db is None else " (target divided out)"
    exposure = f", exposure {view.exposure_stops:+g} stops" if view.exposure_stops else ""
    return [
        f"{system.name or 'bench'}: {document.origin}",
        f"wavelengths {lasers} nm; focal plane {units.format_rounded(view.plane_m, 'mm')}{exposure}",
        f"in the frame: speckle contrast {metrics.contrast:.3f}{known}, mean luminance {metrics.mean:.3g}{fidelity}",
    ]
