"""The scale bar and the legend of a picture: what they say, and pictures with both below them.

The window draws them on the image. A saved picture has them below it, where they hide no sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from holoview.light.model.eye import sample_degrees
from holoview.util import units
from holoview.util.fonts import picture_font
from holoview.viewer.document.document import Document
from holoview.viewer.document.focus_edits import dioptres_text
from holoview.viewer.render.tone_mapping import colour_bar
from holoview.viewer.render.view_settings import ViewSettings

MAX_BAR_FRACTION = 0.2  # of the image's width
_TEXT_PX, _MARGIN_PX, _BAR_PX = 14, 6, 4
_LEAST_WIDTH_PX = 360  # of a picture with a legend below it
_COLOURS = 256


@dataclass(frozen=True)
class ScaleBar:
    """A bar some samples long, and its length in words."""

    samples: float
    text: str


def scale_bar(document: Document, most_samples: float) -> ScaleBar:
    """The bar of a round length in the focal plane that isn't longer than some samples; with an eye, also its angle."""
    pitch_m, eye = document.sample_pitch_m, document.system.eye
    length_m = scale_bar_length(most_samples * pitch_m)
    text = units.format_rounded(length_m, "mm")
    if eye is not None:
        text += f", {60 * sample_degrees(length_m, eye.eyepiece_m):.3g} arcmin"
    return ScaleBar(length_m / pitch_m, text)


def scale_bar_length(most_m: float) -> float:
    """The largest length of 1, 2 or 5 times a power of ten that isn't longer than `most_m`."""
    power = 10.0 ** math.floor(math.log10(most_m))
    return max(step * power for step in (1, 2, 5) if step * power <= most_m * (1 + 1e-9))


def legend_lines(document: Document) -> list[str]:
    """What is seen: focal plane, lasers that are on, frame, exposure and channel; signs that every font has."""
    system, view = document.system, document.view_settings
    plane = units.format_rounded(view.plane_m, "mm")
    dioptres = "" if system.eye is None else f" ({dioptres_text(system, view.plane_m)})"
    is_on = [
        view.shows_laser(i) and bool(np.any(system.amplitudes[:, i] > 0)) for i in range(len(system.wavelengths_m))
    ]
    lit = ", ".join(f"{nm:.4g}" for nm in system.wavelengths_m[is_on] * 1e9)
    further = []
    if view.is_one_frame and system.frames > 1:
        further.append(f"frame {view.frame + 1} of {system.frames}")
    if view.exposure_stops:
        further.append(f"exposure {view.exposure_stops:+.3g} stops")
    if view.channel != "colour":
        further.append(view.channel)
    lines = [f"plane {plane}{dioptres}", f"lasers {lit} nm" if lit else "no laser"]
    return [*lines, ", ".join(further)] if further else lines


@dataclass(frozen=True, eq=False)
class ColourBar:
    """The colours (n, 3), 8-bit sRGB, of a single channel, and the values of the first and of the last; 1 is white."""

    colours: NDArray[np.uint8]
    low: float
    high: float


def channel_colours(view: ViewSettings) -> ColourBar | None:
    """The colours that a single channel is shown in, or a difference of one; None for images in colour."""
    if view.channel == "colour":
        return None
    scale = 2.0**-view.exposure_stops
    low, high = view.low * scale, view.high * scale
    if view.compare == "difference":
        low, high = low - high, high - low
    return ColourBar(colour_bar(view, _COLOURS), low, high)


def with_notes(pixels: NDArray[np.uint8], document: Document) -> NDArray[np.uint8]:
    """A picture (y, x, 3), 8-bit sRGB, with the scale bar and the legend below it that the view settings ask for.

    A sample of the document is a pixel of the picture.
    """
    view = document.view_settings
    font = picture_font(_TEXT_PX)
    lines: list[str] = legend_lines(document) if view.has_legend else []
    bars = channel_colours(view) if view.has_legend else None
    if not (view.has_scale_bar or lines):
        return pixels
    rows = len(lines) + int(view.has_scale_bar) + int(bars is not None)
    height, width = pixels.shape[:2]
    line_px = _TEXT_PX + _MARGIN_PX
    canvas = Image.new("RGB", (max(width, _LEAST_WIDTH_PX), height + rows * line_px + _MARGIN_PX))
    canvas.paste(Image.fromarray(np.ascontiguousarray(pixels)), (0, 0))
    draw, y, left = ImageDraw.Draw(canvas), height + _MARGIN_PX, _MARGIN_PX
    if view.has_scale_bar:
        bar = scale_bar(document, MAX_BAR_FRACTION * document.image_shape[1])
        middle, length = y + line_px // 2 - _MARGIN_PX // 2, round(bar.samples)
        draw.rectangle((left, middle, left + length - 1, middle + _BAR_PX - 1), fill="white")
        draw.text((left + length + _MARGIN_PX, y), bar.text, font=font, fill="white")
        y += line_px
    if bars is not None:
        words = f"{bars.low:.3g}", f"{bars.high:.3g}"
        at = left + math.ceil(font.getlength(words[0])) + _MARGIN_PX
        strip = np.repeat(bars.colours[::2][None], _TEXT_PX, axis=0)
        draw.text((left, y), words[0], font=font, fill="white")
        canvas.paste(Image.fromarray(strip), (at, y + 2))
        draw.text((at + strip.shape[1] + _MARGIN_PX, y), words[1], font=font, fill="white")
        y += line_px
    for line in lines:
        draw.text((left, y), line, font=font, fill="white")
        y += line_px
    return np.asarray(canvas)
