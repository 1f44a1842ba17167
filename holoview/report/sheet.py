"""A contact sheet: a grid of pictures, a title over each column, a caption under each picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

_PAPER, _INK, _FAINT = (24, 24, 27), (240, 240, 240), (170, 170, 178)
_MARGIN, _TITLE, _HEAD, _CAPTION = 16, 26, 22, 17


@dataclass(frozen=True)
class Tile:
    """A picture (y, x, 3) of 8-bit sRGB and the caption under it."""

    pixels: NDArray[np.uint8]
    caption: str


def contact_sheet(
    title: str, heads: Sequence[str], rows: Sequence[Sequence[Tile]], width: int = 480
) -> NDArray[np.uint8]:
    """The sheet (y, x, 3): each row of tiles scaled to `width` pixels a tile, one head over each column."""
    scaled = [[_scaled(tile.pixels, width) for tile in row] for row in rows]
    columns = len(heads)
    line = _CAPTION + _MARGIN
    heights = [max(picture.height for picture in row) + line for row in scaled]
    top = 3 * _MARGIN + _TITLE + _HEAD
    size = (columns * (width + _MARGIN) + _MARGIN, top + sum(heights) + _MARGIN)
    sheet = Image.new("RGB", size, _PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((_MARGIN, _MARGIN), title, _INK, _font(_TITLE))
    for column, head in enumerate(heads):
        draw.text((_MARGIN + column * (width + _MARGIN), 2 * _MARGIN + _TITLE), head, _INK, _font(_HEAD))
    y = top
    for row, pictures, height in zip(rows, scaled, heights, strict=True):
        for column, (tile, picture) in enumerate(zip(row, pictures, strict=True)):
            x = _MARGIN + column * (width + _MARGIN)
            sheet.paste(picture, (x, y))
            draw.text((x, y + picture.height + 4), tile.caption, _FAINT, _font(_CAPTION))
        y += height
    return np.asarray(sheet)


def _scaled(pixels: NDArray[np.uint8], width: int) -> Image.Image:
    """Shrunk by area averages, enlarged by whole pixels, so that speckle is neither invented nor smoothed away."""
    picture = Image.fromarray(pixels)
    height = round(picture.height * width / picture.width)
    return picture.resize((width, height), Image.Resampling.BOX if picture.width > width else Image.Resampling.NEAREST)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
