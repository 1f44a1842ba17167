"""Draws a contact sheet: a grid of pictures with a title over each column and a caption under each picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

_BACKGROUND, _TEXT_COLOUR, _CAPTION_COLOUR = (24, 24, 27), (240, 240, 240), (170, 170, 178)
_MARGIN_PX, _TITLE_PX, _COLUMN_TITLE_PX, _CAPTION_PX = 16, 26, 22, 17


@dataclass(frozen=True)
class CaptionedTile:
    """A picture (y, x, 3) of 8-bit sRGB and the caption under it."""

    pixels: NDArray[np.uint8]
    caption: str


def greyscale_pixels(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Values 0 … 1 (y, x) as 8-bit grey pixels (y, x, 3); values beyond are clipped, NaN becomes medium grey."""
    shades = np.rint(255 * np.clip(np.nan_to_num(values, nan=0.5), 0, 1)).astype(np.uint8)
    return np.repeat(shades[..., None], 3, axis=-1)


def contact_sheet(
    title: str, column_titles: Sequence[str], rows: Sequence[Sequence[CaptionedTile]], width: int = 480
) -> NDArray[np.uint8]:
    """The sheet (y, x, 3) of 8-bit sRGB, with each tile scaled to `width` pixels."""
    scaled = [[_scaled(tile.pixels, width) for tile in row] for row in rows]
    columns = len(column_titles)
    caption_height = _CAPTION_PX + _MARGIN_PX
    heights = [max(picture.height for picture in row) + caption_height for row in scaled]
    top = 3 * _MARGIN_PX + _TITLE_PX + _COLUMN_TITLE_PX
    size = (columns * (width + _MARGIN_PX) + _MARGIN_PX, top + sum(heights) + _MARGIN_PX)
    sheet = Image.new("RGB", size, _BACKGROUND)
    draw = ImageDraw.Draw(sheet)
    draw.text((_MARGIN_PX, _MARGIN_PX), title, _TEXT_COLOUR, _font(_TITLE_PX))
    for column, text in enumerate(column_titles):
        corner = (_MARGIN_PX + column * (width + _MARGIN_PX), 2 * _MARGIN_PX + _TITLE_PX)
        draw.text(corner, text, _TEXT_COLOUR, _font(_COLUMN_TITLE_PX))
    y = top
    for row, pictures, height in zip(rows, scaled, heights, strict=True):
        for column, (tile, picture) in enumerate(zip(row, pictures, strict=True)):
            x = _MARGIN_PX + column * (width + _MARGIN_PX)
            sheet.paste(picture, (x, y))
            draw.text((x, y + picture.height + 4), tile.caption, _CAPTION_COLOUR, _font(_CAPTION_PX))
        y += height
    return np.asarray(sheet)


def _scaled(pixels: NDArray[np.uint8], width: int) -> Image.Image:
    """The picture shrunk by area averages or enlarged by repeating pixels: neither adds structure to speckle."""
    picture = Image.fromarray(pixels)
    height = round(picture.height * width / picture.width)
    return picture.resize((width, height), Image.Resampling.BOX if picture.width > width else Image.Resampling.NEAREST)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)
