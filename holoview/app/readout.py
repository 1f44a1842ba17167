"""The line below the image: the position of the pointer and the values of the sample there."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.app.context import AppContext
from holoview.app.parameter_widgets import tooltip
from holoview.app.score_choice import choose_next_score
from holoview.document.live_score import ImageScore, image_psnr_db
from holoview.document.measure import sample_pixel
from holoview.metrics.perceptual_scores import PERCEPTUAL_SCORES, samples_per_degree
from holoview.render.view_settings import DERIVED_PAGES, NOW, ViewSettings, displayed_side
from holoview.util.text import printable


def draw_readout(context: AppContext, position: tuple[float, float] | None) -> None:
    """Draws the line. position: of the pointer, as fractions (x, y) of the image; None outside it."""
    view, shape = context.session.view_settings, context.session.document.image_shape
    if position is None or view.page in DERIVED_PAGES:
        imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(imgui.Col_.text_disabled))
        imgui.text_wrapped(describe_image(context))
        imgui.pop_style_color()
        _offer_next_score(context, view)
        return
    imgui.text_wrapped(describe_pixel(context, int(position[0] * shape[1]), int(position[1] * shape[0])))
    context.record_item_rect("readout")
    tooltip(
        "Linear sRGB and XYZ at this sample; 1 is white. Intensities are those of the lasers, in the table's order."
    )


def readout_height(context: AppContext, width: float) -> float:
    """The height that the values need in a panel of this width; reserved always, so that the image doesn't move."""
    rows, columns = context.session.document.image_shape
    three, lasers = "0.000  0.000  0.000", " ".join(["0.00"] * len(context.session.system.wavelengths_m))
    text = f"x {columns}  y {rows}   RGB {three}   XYZ {three}   I {lasers}"
    return imgui.calc_text_size(text, wrap_width=width).y + imgui.get_style().item_spacing.y


def describe_pixel(context: AppContext, x: int, y: int) -> str:
    """The values of a sample in a line of text."""
    side = displayed_side(context.session.view_settings)
    xyz = context.side_renderers.xyz(side)
    values = (
        None
        if xyz is None
        else sample_pixel(x, y, xyz, context.side_renderers.now.intensities() if side == NOW else None)
    )
    if values is None:
        return f"x {x}  y {y}   values follow with the full image"
    parts = [f"x {x}  y {y}", f"RGB {_format_triple(values.linear_rgb)}", f"XYZ {_format_triple(values.xyz)}"]
    if values.intensity is not None:
        parts.append("I " + " ".join(f"{value:.2f}" for value in values.intensity))
    return "   ".join(parts)


def _format_triple(values: NDArray[np.float64]) -> str:
    return "  ".join(f"{value:.3f}" for value in values)


def describe_image(context: AppContext) -> str:
    """What the page shows in a line of text: size, origin and scores of an image."""
    rows, columns = context.session.document.image_shape
    if context.session.view_settings.page == "spectrum":
        if context.session.system.eye is not None:
            return "the eyebox at the eye's pupil, up to the edge of the longest wavelength; drag the pupil"
        return "the eyebox: light by direction, up to ±λ/(2·pitch)"
    if context.session.view_settings.page == "target":
        return "what the hologram should show here" + (
            f": {context.session.target_spec.title}" if context.session.target_spec else ""
        )
    if context.session.view_settings.page == "phase":
        return "phase at the laser in the middle of the spectrum; a turn of hue is a wave"
    origin = printable(context.session.document.origin)
    return f"{columns} × {rows} samples   {origin}{_scores_text(context)}"


def _offer_next_score(context: AppContext, view: ViewSettings) -> None:
    """The idle line of an image: a click shows another score."""
    if view.page == "image":
        context.record_item_rect("scores")
        tooltip("Click for another score beside the PSNR; the menu Image has all of them.")
        if imgui.is_item_clicked():
            choose_next_score(context)


def _scores_text(context: AppContext) -> str:
    """PSNR of the displayed plane and the chosen score beside it; empty without a target, and until it is measured."""
    if displayed_side(context.session.view_settings) != NOW:
        return ""
    xyz = context.side_renderers.xyz(NOW)
    target = None if xyz is None else context.session.target_at()
    if xyz is None or target is None:
        return "   PSNR follows" if context.session.target_builder.is_building else ""
    psnr_db = context.live_psnr.get(xyz, target, image_psnr_db)
    text = "" if psnr_db is None else f"   PSNR {psnr_db:.1f} dB"
    document, name = context.session.document, context.session.view_settings.score
    if name:
        density = samples_per_degree(document.sample_pitch_m, document.system.eye)
        value = context.live_score.get(xyz, target, ImageScore(name, density))
        text += "" if value is None else f"   {PERCEPTUAL_SCORES[name].format(value)}"
    return text
