"""Plots that several studies share, drawn without a display and without global state."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from holoview.study.study import Plot

_SIZE = (6.4, 4.0)
_DPI = 150


def figure_of(plot: Plot) -> Figure:
    """The drawn figure."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    plot.draw(figure)
    return figure


def png_bytes(plot: Plot) -> bytes:
    """The figure as PNG."""
    buffer = io.BytesIO()
    figure_of(plot).savefig(buffer, format="png", dpi=_DPI)
    return buffer.getvalue()


def data_uri(png: bytes) -> str:
    """A PNG for the inside of an HTML page."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def bars(labels: Sequence[str], values: Mapping[str, Sequence[float]], axis: str) -> Callable[[Figure], None]:
    """Groups of bars, a group a label and a colour a name in `values`."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        places, width = np.arange(len(labels)), 0.8 / len(values)
        for i, (name, heights) in enumerate(values.items()):
            drawn = axes.bar(places + (i - (len(values) - 1) / 2) * width, heights, width, label=name)
            axes.bar_label(drawn, fmt="%.2f", fontsize=8)
        axes.set_xticks(places, labels, rotation=15, ha="right")
        axes.set_ylabel(axis)
        if len(values) > 1:
            axes.legend(fontsize=8)

    return draw


def lines(
    curves: Mapping[str, tuple[Sequence[float] | NDArray[np.floating], Sequence[float] | NDArray[np.floating]]],
    x_axis: str,
    y_axis: str,
    *,
    dashed: Sequence[str] = (),
    logarithmic: bool = False,
) -> Callable[[Figure], None]:
    """Curves by name, (x, y) each; those in `dashed` are laws or references."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for name, (x, y) in curves.items():
            axes.plot(x, y, "--" if name in dashed else "o-", markersize=4, label=name)
        axes.set_xlabel(x_axis)
        axes.set_ylabel(y_axis)
        if logarithmic:
            axes.set_xscale("log", base=2)
            axes.set_yscale("log")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)

    return draw


def heat_map(
    table: NDArray[np.floating], rows: tuple[str, Sequence[str]], columns: tuple[str, Sequence[str]], unit: str
) -> Callable[[Figure], None]:
    """A table (row, column) as colours with the numbers in them; axes are (title, labels)."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        image = axes.imshow(table, cmap="viridis", aspect="auto")
        axes.set_yticks(range(len(rows[1])), rows[1])
        axes.set_xticks(range(len(columns[1])), columns[1])
        axes.set_ylabel(rows[0])
        axes.set_xlabel(columns[0])
        middle = float(np.nanmean(table))
        for (y, x), value in np.ndenumerate(table):
            axes.text(x, y, f"{value:.1f}", ha="center", va="center", color="w" if value < middle else "k")
        figure.colorbar(image, label=unit)

    return draw
