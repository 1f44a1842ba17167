"""Writes matplotlib figures as PNG files, and plots a fitted look-up table."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from holoview.calibrate.lut import Lut
from holoview.util.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def png_figure(path: str | os.PathLike[str], size: tuple[float, float]) -> Iterator[Figure]:
    """Yields an empty figure, and writes it as PNG at 120 dpi when the block ends without an exception.

    size: width and height in inches. The file is replaced only by a complete one; raises UserError when that fails.
    """
    # imported here: it takes a second, and calibrations without pictures don't need it
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    yield figure
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


def plot_lut(path: str | os.PathLike[str], lut: Lut, title: str) -> None:
    """Writes a PNG with two plots against grey level: measured and fitted power, and the fitted phase."""
    x = lut.sweep.levels
    with png_figure(path, (10.0, 4.2)) as figure:
        power, phase = figure.subplots(1, 2)
        power.plot(x, lut.sweep.power, ".", markersize=4, label="measured")
        power.plot(x, lut.fit.power, label="monotone LUT")
        power.set(xlabel="grey level", ylabel="first-order power", title=title)
        power.legend()
        phase.plot(x, lut.fit.phase / math.pi, label="fitted")
        phase.plot(x, lut.sweep.relative_levels * lut.fit.stroke / math.pi, "--", label="linear")
        phase.axhspan(*(bound / math.pi for bound in lut.stroke_interval), alpha=0.2, label="stroke, 95 %")
        phase.set(xlabel="grey level", ylabel="phase / π", title="phase of each level")
        phase.legend()
