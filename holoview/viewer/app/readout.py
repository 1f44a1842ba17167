"""Texts of the image panel: values of the sample under the pointer, scores of the image, names of compared sides."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from holoview.holograms.metrics.perceptual_scores import PERCEPTUAL_SCORES, installed_scores, samples_per_degree
from holoview.util.text import printable
from holoview.viewer.app.context import AppContext
from holoview.viewer.app.viewport import Viewport
from holoview.viewer.app.widgets import pale, tooltip, wrapped_text
from holoview.viewer.document.document import Document
from holoview.viewer.document.legend import MAX_BAR_FRACTION, ColourBar, channel_colours, legend_lines, scale_bar
from holoview.viewer.document.measurements import ImageScore, difference_db, image_psnr_db, sample_pixel
from holoview.viewer.render.page_images import SeenField
from holoview.viewer.render.view_settings import (
    DERIVED_PAGES,
    NOW,
    TARGET,
    ComparisonSide,
    ViewSettings,
    displayed_side,
)

_DARK, _WHITE = imgui.IM_COL32(0, 0, 0, 170), imgui.IM_COL32(255, 255, 255, 255)


def draw_readout(context: AppContext, position: tuple[float, float] | None) -> None:
    """Draws the line. position: of the pointer, as fractions (x, y) of the image; None outside it."""
    view, shape = context.session.view_settings, context.session.document.image_shape
    if position is not None and view.page == "field" and context.page_images.seen_field is not None:
        imgui.text_wrapped(describe_field(context.page_images.seen_field, *position))
        context.record_item_rect("readout")
        tooltip(f"Amplitude and phase, real and imaginary part of this sample. {context.page_images.seen_field.scale}")
        return
    if position is None or view.page in DERIVED_PAGES:
        wrapped_text(describe_image(context), pale())
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


def describe_field(field: SeenField, u: float, v: float) -> str:
    """The value of a field at a place, given as fractions (x, y) of its picture, in a line of text."""
    rows, columns = field.values.shape
    x, y = int(u * columns), int(v * rows)
    if not np.iscomplexobj(field.values):
        return f"x {x}  y {y}   Y {float(field.values[y, x]):.6g}"
    value = complex(field.values[y, x])
    polar = f"amplitude {abs(value):.6g}  phase {cmath.phase(value):+.5f} rad"
    return f"x {x}  y {y}   {polar}   {value.real:+.6g} {value.imag:+.6g}i"


def _format_triple(values: NDArray[np.float64]) -> str:
    return "  ".join(f"{value:.3f}" for value in values)


def describe_image(context: AppContext) -> str:
    """The page in a line of text: size, origin and scores of an image."""
    rows, columns = context.session.document.image_shape
    if context.session.view_settings.page == "spectrum":
        if context.session.system.eye is not None:
            return "the eyebox at the eye's pupil, up to the edge of the longest wavelength; drag the pupil"
        return "the eyebox: light by direction, up to ±λ/(2·pitch)"
    if context.session.view_settings.page == "target":
        return "what the hologram should show here" + (
            f": {context.session.target_spec.title}" if context.session.target_spec else ""
        )
    if context.session.view_settings.page == "field":
        field = context.page_images.seen_field
        return "" if field is None else field.scale
    if context.session.view_settings.page == "phase":
        return "phase at the laser in the middle of the spectrum; a turn of hue is a wave"
    origin = printable(context.session.previewed_document.origin)
    shown = context.session.snapshots.get(displayed_side(context.session.view_settings).name)
    if shown is not None and context.session.view_settings.compare == "off":
        (rows, columns), origin = shown.image_shape, printable(shown.origin)
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
    view = context.session.view_settings
    side = displayed_side(view)
    if view.compare == "off" and side.kind == "snapshot":
        return _shown_text(context, side)
    if side != NOW:
        return ""
    if view.compare != "off" and view.b not in (NOW, TARGET):
        return _difference_text(context, view)
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


def _shown_text(context: AppContext, side: ComparisonSide) -> str:
    """The PSNR of a hologram that is shown in place of the edited one: to its target, else to number 1."""
    xyz, target = context.side_renderers.xyz(side), context.session.target_for(side)
    if xyz is None:
        return ""
    if target is not None:
        psnr_db = context.live_psnr.get(xyz, target, image_psnr_db)
        return "" if psnr_db is None else f"   PSNR {psnr_db:.1f} dB"
    now = context.side_renderers.xyz(NOW)
    psnr_db = None if now is None else context.live_psnr.get(xyz, now, difference_db)
    if psnr_db == math.inf:
        return "   equal to 1"
    return "" if psnr_db is None else f"   PSNR to 1 {psnr_db:.1f} dB"


def _difference_text(context: AppContext, view: ViewSettings) -> str:
    """How alike both sides of a comparison are; empty until both are computed, and for images of different sizes."""
    a, b = context.side_renderers.xyz(NOW), context.side_renderers.xyz(view.b)
    psnr_db = None if a is None or b is None else context.live_psnr.get(a, b, difference_db)
    if psnr_db == math.inf:
        return "   A and B are equal"
    return "" if psnr_db is None else f"   PSNR of A to B {psnr_db:.1f} dB"


# --- Texts in the image panel: names of the compared sides, and what is shown while there is no image ---


def side_labels(view: ViewSettings, shows_b: bool, has_target: bool, names: Sequence[str]) -> list[tuple[str, float]]:
    """Texts above the image and their positions as fractions of its width.

    names: of the holograms that are open, the edited one first; the shown one is named if there are several.
    """
    if view.page != "image":
        return []
    if view.compare == "off":
        number = 1 + names[1:].index(view.shown.name) if view.shown.name in names[1:] else 0
        return [(f"{number + 1}  {printable(names[number])}", 0.0)] if len(names) > 1 else []
    a, b = (
        "no target yet: open a picture" if side == TARGET and not has_target else side.label
        for side in (view.a, view.b)
    )
    if view.compare == "hold":
        return [(b if shows_b else f"{a}   (hold B: {b})", 0.0)]
    if view.compare == "difference":
        return [(f"{a} − {b}", 0.0)]
    return [(a, 0.0), (b, 0.5 if view.compare == "side-by-side" else view.wipe)]


def draw_label(draw_list: imgui.ImDrawList, text: str, position: imgui.ImVec2) -> None:
    """Draws a white text on a dark rectangle; position: its upper left corner on the screen."""
    size = imgui.calc_text_size(text)
    low = imgui.ImVec2(position.x - 4, position.y - 2)
    high = imgui.ImVec2(position.x + size.x + 4, position.y + size.y + 2)
    draw_list.add_rect_filled(low, high, _DARK, 3)
    draw_list.add_text(position, _WHITE, text)


_NOTE_MARGIN_PX, _BAR_PX, _COLOUR_BAR_PX = 10.0, 4.0, 128.0


def draw_notes(draw_list: imgui.ImDrawList, document: Document, picture: Viewport) -> None:
    """Draws the scale bar and the legend that the view settings ask for, at the lower left of an image."""
    view, line_px = document.view_settings, imgui.get_text_line_height_with_spacing()
    left, y = picture.corner.x + _NOTE_MARGIN_PX, picture.end.y - _NOTE_MARGIN_PX - line_px
    for line in reversed(legend_lines(document) if view.has_legend else []):
        draw_label(draw_list, line, imgui.ImVec2(left, y))
        y -= line_px
    bar = channel_colours(view) if view.has_legend else None
    if bar is not None:
        _draw_colours(draw_list, bar, imgui.ImVec2(left, y))
        y -= line_px
    if view.has_scale_bar:
        end, columns = picture.to_screen(*picture.shape[::-1]), picture.shape[1]
        px_per_sample = (end.x - picture.to_screen(0, 0).x) / columns
        seen = picture.size[0] / len(picture.panes) / px_per_sample  # samples
        length = scale_bar(document, MAX_BAR_FRACTION * min(seen, columns))
        width = length.samples * px_per_sample
        low = imgui.ImVec2(left, y + line_px / 2 - _BAR_PX)
        draw_list.add_rect_filled(
            imgui.ImVec2(low.x - 2, low.y - 2), imgui.ImVec2(low.x + width + 2, low.y + _BAR_PX + 2), _DARK
        )
        draw_list.add_rect_filled(low, imgui.ImVec2(low.x + width, low.y + _BAR_PX), _WHITE)
        draw_label(draw_list, length.text, imgui.ImVec2(low.x + width + 10, y))


def _draw_colours(draw_list: imgui.ImDrawList, bar: ColourBar, place: imgui.ImVec2) -> None:
    """Draws the colours of a channel between the values of the first and the last."""
    low, high = f"{bar.low:.3g}", f"{bar.high:.3g}"
    draw_label(draw_list, low, place)
    x = place.x + imgui.calc_text_size(low).x + 8
    step, height = _COLOUR_BAR_PX / len(bar.colours), imgui.get_text_line_height()
    for number, (red, green, blue) in enumerate(bar.colours.tolist()):
        start = imgui.ImVec2(x + number * step, place.y)
        end = imgui.ImVec2(x + (number + 1) * step, place.y + height)
        draw_list.add_rect_filled(start, end, imgui.IM_COL32(red, green, blue, 255))
    draw_label(draw_list, high, imgui.ImVec2(x + _COLOUR_BAR_PX + 8, place.y))


def waiting_text(context: AppContext, view: ViewSettings) -> str:
    """The sentence that is shown in place of a missing image."""
    if view.page == "target" and context.session.target_spec is None:
        return "no target yet: open a picture"
    return "computing the first image" if context.is_busy else "nothing to show"


def draw_centred_text(text: str, size: tuple[int, int]) -> None:
    """Draws a text in the middle of the area of the image."""
    imgui.dummy(imgui.ImVec2(*size))
    corner = imgui.get_item_rect_min()
    position = imgui.ImVec2(corner.x + size[0] / 2 - imgui.calc_text_size(text).x / 2, corner.y + size[1] / 2)
    imgui.get_window_draw_list().add_text(position, imgui.get_color_u32(imgui.Col_.text_disabled), text)


# --- Which score stands beside the PSNR below the image: a command for each, and the next one by a click ---


def add_score_commands(context: AppContext) -> None:
    """Adds a command for each score, and one for none, to the menu of the image."""
    add, choose = partial(context.commands.add, "Image"), partial(_choose, context)
    add("Score: PSNR alone", partial(choose, ""), help="No other score beside it.")
    for name, score in PERCEPTUAL_SCORES.items():
        add(f"Score: {score.title}", partial(choose, name), help=f"Beside the PSNR: {score.summary}.")


def choose_next_score(context: AppContext) -> None:
    """The next of the scores that are installed, and after the last one none."""
    options = ("", *installed_scores())
    present = context.session.view_settings.score
    _choose(context, options[(options.index(present) + 1) % len(options)] if present in options else "")


def _choose(context: AppContext, name: str) -> None:
    context.edit_view("Score", score=name)
