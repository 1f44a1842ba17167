"""Plots a fitted look-up table."""

from __future__ import annotations

import math
import os

from holoview.calibrate.lut import Lut
from holoview.report.images import label, png_figure


def plot_lut(path: str | os.PathLike[str], lut: Lut, title: str) -> None:
    """Writes a PNG with two plots against grey level: measured and fitted power, and the fitted phase."""
    x = lut.sweep.levels
    with png_figure(path, (10.0, 4.2)) as figure:
        power, phase = figure.subplots(1, 2)
        power.plot(x, lut.sweep.power, ".", markersize=4, label="measured")
        power.plot(x, lut.fit.power, label="monotone LUT")
        power.set(xlabel="grey level", ylabel="first-order power", title=label(title))
        power.legend()
        phase.plot(x, lut.fit.phase / math.pi, label="fitted")
        phase.plot(x, lut.sweep.relative_levels * lut.fit.stroke / math.pi, "--", label="linear")
        phase.axhspan(*(bound / math.pi for bound in lut.stroke_interval), alpha=0.2, label="stroke, 95 %")
        phase.set(xlabel="grey level", ylabel="phase / π", title="phase of each level")
        phase.legend()
