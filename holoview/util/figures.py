"""Contact sheets (a grid of pictures with titles over columns and captions) and matplotlib figures."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from holoview.util.file_writer import write_file
from holoview.util.fonts import picture_font
from holoview.util.packages import import_optional
from holoview.util.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    draw.text((_MARGIN_PX, _MARGIN_PX), title, _TEXT_COLOUR, picture_font(_TITLE_PX))
    for column, text in enumerate(column_titles):
        corner = (_MARGIN_PX + column * (width + _MARGIN_PX), 2 * _MARGIN_PX + _TITLE_PX)
        draw.text(corner, text, _TEXT_COLOUR, picture_font(_COLUMN_TITLE_PX))
    y = top
    for row, pictures, height in zip(rows, scaled, heights, strict=True):
        for column, (tile, picture) in enumerate(zip(row, pictures, strict=True)):
            x = _MARGIN_PX + column * (width + _MARGIN_PX)
            sheet.paste(picture, (x, y))
            draw.text((x, y + picture.height + 4), tile.caption, _CAPTION_COLOUR, picture_font(_CAPTION_PX))
        y += height
    return np.asarray(sheet)


def _scaled(pixels: NDArray[np.uint8], width: int) -> Image.Image:
    """The picture shrunk by area averages or enlarged by repeating pixels: neither adds structure to speckle."""
    picture = Image.fromarray(pixels)
    height = round(picture.height * width / picture.width)
    return picture.resize((width, height), Image.Resampling.BOX if picture.width > width else Image.Resampling.NEAREST)


# --- figures ----------------------------------------------------------------------------------------------------------

# Matplotlib comes with the extra "plots": a command calls `require_matplotlib` before it computes what a figure shows.


def require_matplotlib(purpose: str) -> None:
    """Raises UserError, which starts with `purpose` and names the extra, if matplotlib isn't installed."""
    import_optional("matplotlib.figure", purpose)


def new_figure(size_in: tuple[float, float], *, dpi: float | None = None, layout: str | None = "constrained") -> Figure:
    """An empty figure that is drawn in memory.

    size_in: width and height in inches. dpi: pixels an inch, matplotlib's default when None. layout: how axes are
    placed; None: as they are told.
    Raises UserError if matplotlib isn't installed.
    """
    figure: Figure = import_optional("matplotlib.figure", "figure").Figure(figsize=size_in, dpi=dpi, layout=layout)
    import_optional("matplotlib.backends.backend_agg", "figure").FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: Figure, file_format: str = "png", dpi: float | None = None) -> bytes:
    """The content of a file that shows the figure. file_format: "png" or "pdf". dpi: the figure's own when None."""
    buffer = io.BytesIO()
    metadata = {"Creator" if file_format == "pdf" else "Software": "holoview"}
    figure.savefig(buffer, format=file_format, dpi="figure" if dpi is None else dpi, metadata=metadata)
    return buffer.getvalue()


def label(text: str) -> str:
    """A name or title from a file as text for a figure: one line, in which matplotlib finds no formula."""
    return printable(text).replace("$", r"\$")


@contextmanager
def png_figure(path: str | os.PathLike[str], size_in: tuple[float, float]) -> Iterator[Figure]:
    """Yields an empty figure, and writes it as PNG at 120 dpi when the block ends without an exception.

    size_in: width and height in inches. The file is replaced only by a complete one.
    Raises UserError when that fails, and if matplotlib isn't installed.
    """
    figure = new_figure(size_in)
    yield figure
    write_file(path, figure_bytes(figure, dpi=120))
