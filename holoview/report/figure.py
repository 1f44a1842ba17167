"""Matplotlib figures without a window and without its global state; nothing else imports matplotlib.

Matplotlib comes with the extra "plots": a command calls `require_matplotlib` before it spends time on what it draws.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from holoview.util.file_writer import write_file
from holoview.util.optional_library import import_optional
from holoview.util.text import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def require_matplotlib(purpose: str) -> None:
    """Raises UserError, which starts with `purpose` and names the extra, if matplotlib isn't installed."""
    import_optional("matplotlib.figure", purpose)


def new_figure(
    size_in: tuple[float, float],
    *,
    dpi: float | None = None,
    layout: str | None = "constrained",
    purpose: str = "figure",
) -> Figure:
    """An empty figure that is drawn in memory.

    size_in: width and height in inches. dpi: pixels an inch, matplotlib's default when None. layout: how axes are
    placed; None: as they are told. purpose: what the figure is for, see `require_matplotlib`.
    Raises UserError if matplotlib isn't installed.
    """
    figure: Figure = import_optional("matplotlib.figure", purpose).Figure(figsize=size_in, dpi=dpi, layout=layout)
    import_optional("matplotlib.backends.backend_agg", purpose).FigureCanvasAgg(figure)
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
