"""Charts that studies share, drawn by matplotlib without a display and without its global state."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.study import StudyFigure
from holoview.holograms.metrics.colour_speckle import INSIDE_95
from holoview.holograms.metrics.retinal import RetinalCurve
from holoview.holograms.metrics.speckle import (
    SpecklePattern,
    independent_patterns,
    speckle_density,
    speckle_histogram,
)
from holoview.util.figures import figure_bytes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from holoview.holograms.metrics.speckle_measurement import SpeckleMeasurement


_SIZE = (6.4, 4.0)
_DPI = 150
_SMALL_FONT_PT = 8
_LINE: Any = {"markersize": 4, "linewidth": 1.2}
_MAX_LEVEL_LABELS = 5
"""Most labels that fit side by side without rotation."""
_MAX_TWO_DECIMAL_BARS = 10
"""Most bars that are wide enough for two decimals above each."""


def make_figure(plot: StudyFigure) -> Figure:
    """The matplotlib figure of a study's figure."""
    figure = new_figure(_SIZE)
    plot.draw(figure)
    return figure


def render_figure(plot: StudyFigure) -> dict[str, bytes]:
    """The figure as the content of files, {"png": …, "pdf": …}."""
    figure = make_figure(plot)
    return {kind: figure_bytes(figure, kind, _DPI) for kind in ("png", "pdf")}


def data_uri(png: bytes) -> str:
    """A PNG as a data URI, to be embedded in an HTML page."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def bar_chart(
    labels: Sequence[str],
    values: Mapping[str, Sequence[float]],
    axis: str,
    errors: Mapping[str, Sequence[float]] = MappingProxyType({}),
) -> Callable[[Figure], None]:
    """A bar chart with a group of bars for each label, and a colour for each name in `values`.

    axis: title and unit. errors: of values, by their names, drawn as error bars.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        positions, width = np.arange(len(labels)), 0.8 / len(values)
        digits = "%.2f" if len(labels) * len(values) <= _MAX_TWO_DECIMAL_BARS else "%.1f"
        for i, (name, heights) in enumerate(values.items()):
            group = axes.bar(
                positions + (i - (len(values) - 1) / 2) * width, heights, width, label=name, yerr=errors.get(name)
            )
            axes.bar_label(group, fmt=digits, fontsize=_SMALL_FONT_PT)
        _label_bars(axes, labels, positions)
        axes.set_ylabel(axis)
        if len(values) > 1:
            _legend(figure, len(values))

    return draw


def bar_panels(labels: Sequence[str], values: Mapping[str, Sequence[float]]) -> Callable[[Figure], None]:
    """A panel of bars for each quantity in `values`, each with its own axis, for the same labels."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(values), squeeze=False)[0]
        for axes, (name, heights) in zip(panels, values.items(), strict=True):
            positions = np.arange(len(labels))
            axes.bar_label(axes.bar(positions, heights), fmt="%.2g", fontsize=_SMALL_FONT_PT)
            _label_bars(axes, labels, positions)
            axes.set_title(name, fontsize=10)

    return draw


def line_plot(
    curves: Mapping[str, tuple[Sequence[float] | NDArray[np.floating], Sequence[float] | NDArray[np.floating]]],
    x_axis: str,
    y_axis: str,
    *,
    dashed: Sequence[str] | Mapping[str, str] = (),
    logarithmic: bool = False,
    errors: Mapping[str, Sequence[float]] = MappingProxyType({}),
) -> Callable[[Figure], None]:
    """Curves (x, y) by name. logarithmic: both axes. errors: of y, by the names of curves, drawn as error bars.

    dashed: names of curves that are theory or reference; with the name of the curve before them to which each belongs,
    it has the colour of that.
    """
    partners = dashed if isinstance(dashed, Mapping) else {}

    def draw(figure: Figure) -> None:
        axes, colours = figure.subplots(), dict[str, Any]()
        for name, (x, y) in curves.items():
            style = {"color": colours.get(partners.get(name, ""), "black"), "linestyle": "--"} if name in dashed else {}
            style = {"marker": "" if name in dashed else "o"} | style
            drawn = axes.errorbar(x, y, errors.get(name), **style, **_LINE, label=name)
            colours[name] = drawn[0].get_color()
        axes.set_xlabel(x_axis)
        axes.set_ylabel(y_axis)
        if logarithmic:
            _double_logarithmic(axes)
        axes.grid(alpha=0.3)
        _legend(figure, len(curves))

    return draw


def heat_map(
    table: NDArray[np.floating], rows: tuple[str, Sequence[str]], columns: tuple[str, Sequence[str]], unit: str
) -> Callable[[Figure], None]:
    """A table (row, column) as colours with its numbers. rows, columns: title and labels of the axes."""

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


def _legend(figure: Figure, count: int) -> None:
    """A legend of `count` entries above the axes, where it covers nothing."""
    figure.legend(loc="outside upper center", ncols=count if count <= 3 else 2, fontsize=_SMALL_FONT_PT, frameon=False)


def _label_bars(axes: Axes, labels: Sequence[str], positions: NDArray[np.integer]) -> None:
    """Horizontal labels where they fit, otherwise rotated ones."""
    is_short = sum(map(len, labels)) <= 10 * _MAX_LEVEL_LABELS
    if is_short and len(labels) <= _MAX_LEVEL_LABELS:
        axes.set_xticks(positions, labels, fontsize=_SMALL_FONT_PT)
    else:
        axes.set_xticks(positions, labels, rotation=35, ha="right", rotation_mode="anchor", fontsize=_SMALL_FONT_PT)
    axes.margins(y=0.12)


def _double_logarithmic(axes: Axes) -> None:
    """Logarithmic axes with ticks at powers of two (x) and selected tenths (y), as plain numbers."""
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_yticks([tick for tick in (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0) if low <= tick <= high])
    for along in (axes.xaxis, axes.yaxis):
        along.set_major_formatter("{x:g}")
    axes.yaxis.minorticks_off()


# --- a region of speckle and its histogram beside the distributions of speckle statistics ---


_HIGHEST_QUANTILE = 0.999
_MOST_POINTS = 8000  # of a scatter that are drawn
_MIN_CONTRAST = 1e-3
"""Contrast below which the gamma distribution is too narrow to be drawn."""


def speckle_figure(pattern: SpecklePattern) -> Callable[[Figure], None]:
    """A function that draws the speckle of a region and the histogram of I/Ī in it beside the laws of speckle."""
    counted, shown = pattern.counted, np.where(pattern.usable, pattern.values, np.nan)
    contrast, mean = pattern.contrast.contrast, pattern.contrast.mean
    height, width = shown.shape

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
        left.imshow(shown / mean, cmap="gray", vmin=0, vmax=3)
        left.set_title(f"{width} x {height} samples", fontsize=9)
        left.set_axis_off()
        highest = max(float(np.quantile(counted / mean, _HIGHEST_QUANTILE)), 2.0)
        histogram = speckle_histogram(counted[None, :], (0, 0, counted.size, 1), max_ratio=highest)
        right.stairs(histogram.density, histogram.edges, fill=True, color="0.7", label="found")
        ratios = np.linspace(0, highest, 400)
        right.plot(ratios, speckle_density(ratios), "--", label="fully developed, C = 1")
        if contrast > _MIN_CONTRAST:
            pattern_count = independent_patterns(contrast)
            label = f"{pattern_count:.1f} patterns, C = {contrast:.2f}"
            right.plot(ratios, speckle_density(ratios, pattern_count), label=label)
        right.set_ylim(top=1.1 * max(1.0, right.get_ylim()[1] if contrast > _MIN_CONTRAST else 1.0))
        right.set_xlabel("intensity / mean")
        right.set_ylabel("probability density")
        right.legend(fontsize=8)

    return draw


def correlation_figure(names: Sequence[str], correlation: NDArray[np.float64]) -> Callable[[Figure], None]:
    """A function that draws the correlations (laser, laser) between the patterns of lasers."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.imshow(correlation, cmap="magma", vmin=0, vmax=1)
        axes.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=_SMALL_FONT_PT - 1)
        axes.set_yticks(range(len(names)), names, fontsize=_SMALL_FONT_PT - 1)
        for (y, x), value in np.ndenumerate(correlation):
            if len(names) <= _MAX_TWO_DECIMAL_BARS:
                colour = "w" if value < 0.6 else "k"
                text = f"{value:.2f}".replace("-0.00", "0.00").replace("0.", ".")
                axes.text(x, y, text, ha="center", va="center", fontsize=_SMALL_FONT_PT - 2, color=colour)

    return draw


def scatter_figure(found: SpeckleMeasurement) -> Callable[[Figure], None]:
    """A function that draws the scatter of the colours of a measurement in (u′, v′) and in (az, bz).

    With the 95 % ellipse as measured, and dashed that of independent lasers of the same contrasts.
    """

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2)
        together, apart = found.colour, found.independent_colour
        if together is None:
            return
        step = max(1, len(together.uv) // _MOST_POINTS)
        for axes, points, names in (
            (panels[0], together.uv, ("u\u2032", "v\u2032")),
            (panels[1], together.jzazbz[:, 1:], ("az", "bz")),
        ):
            axes.plot(*points[::step].T, ".", markersize=1, color="0.6", alpha=0.5, rasterized=True)
            axes.set_xlabel(names[0])
            axes.set_ylabel(names[1])
            axes.set_aspect("equal", adjustable="datalim")
            axes.grid(alpha=0.3)
            axes.locator_params(nbins=_MAX_LEVEL_LABELS)
        for colour, style, name in ((together, "-", "together"), (apart, "--", "independent")):
            if colour is None:
                continue
            uv = _ellipse(colour.mean_uv, colour.covariance_uv)
            panels[0].plot(*uv, "k" + style, label=f"{name}: {colour.area:.2e}")
            panels[1].plot(*_ellipse(colour.mean_jzazbz[1:], colour.covariance_jzazbz[1:, 1:]), "k" + style, label=name)
        panels[0].legend(fontsize=_SMALL_FONT_PT - 1, title="95 % ellipse", title_fontsize=_SMALL_FONT_PT - 1)

    return draw


def _ellipse(mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (2, n) of the ellipse that holds 95 % of a normal law."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 121)
    radii = np.sqrt(INSIDE_95 * np.maximum(values, 0.0))
    points: NDArray[np.float64] = mean[:, None] + vectors @ (radii[:, None] * np.stack([np.cos(angle), np.sin(angle)]))
    return points


def retinal_figure(curve: RetinalCurve) -> Callable[[Figure], None]:
    """A function that draws speckle contrasts against the pupil; a gap where they are withheld."""
    x = [found.pupil_m * 1e3 for found in curve.contrasts]
    curves: dict[str, tuple[Sequence[float], Sequence[float]]] = {
        "every sample": (x, np.array([found.contrast for found in curve.contrasts], dtype=np.float64).tolist()),
        "as cones see it": (x, np.array([found.cone_contrast for found in curve.contrasts], dtype=np.float64).tolist()),
        "independent patterns": (x, [curve.independent] * len(x)),
    }
    return line_plot(curves, "pupil (mm)", "speckle contrast", dashed=("independent patterns",))
