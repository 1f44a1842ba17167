"""A labelled figure of what is seen, as PNG or PDF: scale bar, focal plane, wavelengths, speckle contrast."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.measure import RegionMetrics, measure_region
from holoview.session.rendering import render_planes
from holoview.session.tone_mapping import tone_map
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.files import atomic_write

SUFFIXES = (".png", ".pdf")
_WIDTH_IN, _DPI = 6.4, 200
_BAR_SHARE = 0.2  # of the image's width, at most


def save_figure(session: EditingSession, path: Path) -> BackgroundJob:
    """Writes the figure in the background. Raises UserError for another suffix, and where matplotlib is missing."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=" or ".join(SUFFIXES))
    drawing = _drawing()
    state, target = session.displayed_document, session.target_at()

    def work(control: JobControl) -> Path:
        control.report(0, 2, "rendering")
        (xyz,) = render_planes(state.system, state.drive, [state.view_settings.plane_m], control.check)
        control.report(1, 2, "drawing")
        figures = measure_region(xyz, state.measured_region, target)
        with atomic_write(path) as temporary:
            _draw(drawing, temporary, state, tone_map(xyz, state.view_settings), figures)
        return path

    return session.jobs.start("Figure", work, lambda done: session.messages.post(f"figure written to {done}"))


def _drawing() -> Any:
    """matplotlib's figure module, which needs no display; UserError where it isn't installed."""
    try:
        return importlib.import_module("matplotlib.figure")
    except ImportError as error:
        remedy = 'install it with `pip install "holoview[export]"`'
        raise UserError("a figure", f"{error.name} isn't installed", remedy=remedy) from error


def _draw(drawing: Any, path: Path, state: Document, seen: NDArray[np.uint8], figures: RegionMetrics) -> None:
    rows, columns = seen.shape[:2]
    caption_in = 0.55
    figure = drawing.Figure((_WIDTH_IN, _WIDTH_IN * rows / columns + caption_in), dpi=_DPI)
    height = 1 - caption_in / figure.get_figheight()
    axes = figure.add_axes((0, 1 - height, 1, height))
    axes.imshow(seen, interpolation="nearest", aspect="auto")
    axes.set_axis_off()
    _draw_bar(axes, state, rows, columns)
    x, y, width, height_px = state.measured_region
    axes.plot(
        [x, x + width, x + width, x, x],
        [y, y, y + height_px, y + height_px, y],
        color="white",
        linewidth=0.8,
        alpha=0.8,
    )
    figure.text(0.015, 0.012, "\n".join(caption(state, figures)), fontsize=7.5, va="bottom")
    figure.savefig(
        path, metadata={"Creator": "holoview"} if path.suffix.lower() == ".pdf" else {"Software": "holoview"}
    )


def _draw_bar(axes: Any, state: Document, rows: int, columns: int) -> None:
    """A white bar of a round length on a dark edge, so that it reads on any picture."""
    pitch_m = state.system.modulators[0].pitch_m / state.system.sampling.upsample
    length_m = scale_bar_length(_BAR_SHARE * columns * pitch_m)
    x0, y = 0.04 * columns, 0.95 * rows
    for color, width in (("black", 5.0), ("white", 3.0)):
        axes.plot([x0, x0 + length_m / pitch_m], [y, y], color=color, linewidth=width, solid_capstyle="butt")
    text = axes.text(x0, y - 0.015 * rows, units.format_rounded(length_m, "mm"), color="white", fontsize=9, va="bottom")
    effects = importlib.import_module("matplotlib.patheffects")
    text.set_path_effects([effects.withStroke(linewidth=2, foreground="black")])


def scale_bar_length(most_m: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that isn't longer."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(step * power for step in (1, 2, 5) if step * power <= most_m * (1 + 1e-9))


def caption(state: Document, figures: RegionMetrics) -> list[str]:
    """What the figure says below the image."""
    system, look = state.system, state.view_settings
    lasers = ", ".join(f"{λ * 1e9:.4g}" for λ in system.wavelengths_m)
    fidelity = "" if figures.psnr_db is None else f", PSNR {figures.psnr_db:.1f} dB, ΔE2000 {figures.delta_e:.1f}"
    known = "" if figures.psnr_db is None else " (target divided out)"
    exposure = f", exposure {look.exposure_stops:+g} stops" if look.exposure_stops else ""
    return [
        f"{system.name or 'bench'}: {state.origin}",
        f"wavelengths {lasers} nm; focal plane {units.format_rounded(look.plane_m, 'mm')}{exposure}",
        f"in the frame: speckle contrast {figures.contrast:.3f}{known}, mean luminance {figures.mean:.3g}{fidelity}",
    ]
