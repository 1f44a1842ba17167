"""Writes a diagnosis as one HTML file with its pictures inside, and the pictures as PNG files beside it."""

from __future__ import annotations

import base64
import textwrap
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import numpy as np
from numpy.typing import NDArray

from holoview.bench.diagnose.fit_statistics import ExcessBin, SampleCapture
from holoview.bench.diagnose.intervals import format_value
from holoview.bench.diagnose.judge import Verdict
from holoview.bench.diagnose.report.diagnosis import Diagnosis
from holoview.bench.diagnose.report.display_gain import DisplayGain
from holoview.bench.diagnose.report.error_places import FreeMapFit, PixelMap
from holoview.util.figures import figure_bytes, new_figure
from holoview.util.file_writer import write_file
from holoview.util.progress import ProgressCallback
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_MEANINGS = {
    Verdict.CONSISTENT: "Nothing is wrong beyond the noise.",
    Verdict.EXPLAINED: "One cause, or several together, explain the captures down to the noise.",
    Verdict.PARTLY: "The causes below explain a good part; something else is wrong too.",
    Verdict.AMBIGUOUS: "More than one explanation fits; these captures can't tell which is true.",
    Verdict.UNEXPLAINED: "Something is wrong that no effect of the library explains.",
}


def write_report(
    folder: Path,
    title: str,
    diagnosis: Diagnosis,
    gain: DisplayGain | None = None,
    progress: ProgressCallback | None = None,
) -> Path:
    """Writes report.html and its PNG files into the folder; returns the path of the HTML file.

    gain: what the extended model gains on the display, if that was computed.
    """
    figures = {
        "residuals": residual_maps(diagnosis.samples),
        "excess": excess_bars(diagnosis),
        "held-out": held_out_psnr_bars(diagnosis),
        "candidates": candidate_excess_bars(diagnosis),
    }
    if diagnosis.free_maps:
        figures["free-maps"] = free_maps(diagnosis.free_maps)
    if diagnosis.pixel_maps:
        figures["pixel-maps"] = pixel_maps(diagnosis.pixel_maps)
    pictures = {}
    for number, (name, figure) in enumerate(figures.items(), 1):
        pictures[name] = figure_bytes(figure)
        if progress is not None:
            progress(number, len(figures) + 1, name)
    if gain is not None:
        pictures["display"] = gain.sheet
    for name, data in pictures.items():
        write_file(folder / f"{name}.png", data)
    path = folder / "report.html"
    write_file(path, _render_html(title, diagnosis, pictures, gain))
    if progress is not None:
        progress(len(figures) + 1, len(figures) + 1, "report.html")
    return path


def _render_html(title: str, found: Diagnosis, pictures: dict[str, bytes], gain: DisplayGain | None) -> str:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    template = environment.from_string(files(__package__).joinpath("report.html").read_text(encoding="utf-8"))
    return template.render(
        title=title,
        found=found,
        meaning=_MEANINGS[found.verdict],
        gain=gain,
        pictures={name: base64.b64encode(data).decode("ascii") for name, data in pictures.items()},
        notes=_notes(found),
        format_value=format_value,
    )


def _notes(found: Diagnosis) -> list[str]:
    prnu = [f"Pixels differ in sensitivity by {found.fixed_pattern:.2%}."] if found.fixed_pattern else []
    return [
        *prnu,
        f"Gains of captures vary by {found.gain_spread:.2%} about those of their wavelength; each was fitted.",
        f"Took {found.seconds:.0f} s.",
        *found.notes,
    ]


_BEFORE, _AFTER, _NOISE = "#c8553d", "#2f6f9f", "#888888"
_SIGMAS = 5.0  # residuals at the ends of the colour scale
_DPI = 110


def residual_maps(samples: Sequence[SampleCapture]) -> Figure:
    """A row for each capture: as captured, then prediction and residual (σ) of the nominal and the extended model."""
    heads = ("captured", "nominal model", "residual, nominal (σ)", "extended model", "residual, extended (σ)")
    rows, columns = samples[0].light.shape
    figure = new_figure((13.5, 0.35 + (2.4 * rows / columns + 0.15) * len(samples)), dpi=_DPI)
    axes = figure.subplots(len(samples), len(heads), squeeze=False)
    for axis, head in zip(axes[0], heads, strict=True):
        axis.set_title(head, fontsize=9)
    for sample, line in zip(samples, axes, strict=True):
        brightest = float(np.quantile(sample.light, 0.995))
        pictures = (sample.light, sample.predicted[0], sample.residual[0], sample.predicted[1], sample.residual[1])
        for axis, head, picture in zip(line, heads, pictures, strict=True):
            if "residual" in head:
                shown = axis.imshow(picture, cmap="RdBu_r", vmin=-_SIGMAS, vmax=_SIGMAS, interpolation="nearest")
                figure.colorbar(shown, ax=axis, fraction=0.035, pad=0.02).ax.tick_params(labelsize=7)
            else:
                axis.imshow(picture, cmap="gray", vmin=0, vmax=brightest, interpolation="nearest")
            axis.set_xticks([])
            axis.set_yticks([])
        line[0].set_ylabel(f"capture {sample.capture}\n{format_rounded(sample.wavelength_m, 'nm')}", fontsize=8)
    return figure


def excess_bars(diagnosis: Diagnosis) -> Figure:
    """χ²/n by each property, of the nominal and the extended model."""
    names = ("wavelength", "plane", "smoothness", "radius", "frequency", "brightness")
    figure = new_figure((13.5, 6), dpi=_DPI)
    for axis, name in zip(figure.subplots(2, 3).ravel(), names, strict=True):
        _paired_bars(axis, getattr(diagnosis.excess_before, name), getattr(diagnosis.excess_after, name))
        axis.set_title(f"by {name}" if name != "frequency" else "by spatial frequency", fontsize=10)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def held_out_psnr_bars(diagnosis: Diagnosis) -> Figure:
    """PSNR of held-out captures for each wavelength and plane, of both models."""
    groups = diagnosis.groups
    figure = new_figure((max(4.0, 1.3 * len(groups) + 1.5), 3.2), dpi=_DPI)
    axis = figure.subplots()
    positions = np.arange(len(groups))
    before, after = ([getattr(g, side).psnr_db for g in groups] for side in ("before", "after"))
    axis.bar(positions - 0.2, before, 0.4, color=_BEFORE, label="nominal model")
    axis.bar(positions + 0.2, after, 0.4, color=_AFTER, label="extended model")
    labels = [f"{format_rounded(g.wavelength_m, 'nm')}\n{format_rounded(g.distance_m, 'mm')}" for g in groups]
    axis.set_xticks(positions, labels, fontsize=8)
    axis.set_ylabel("PSNR, dB")
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure


def candidate_excess_bars(diagnosis: Diagnosis, max_candidates: int = 12) -> Figure:
    """χ²/n − 1 on held-out captures of the best candidates, on a logarithmic scale."""
    shown = diagnosis.candidates[:max_candidates]
    names = ["nominal model", *(" + ".join(c.causes) for c in shown)]
    excess = [diagnosis.before.chi2_per_pixel - 1, *(c.chi2_per_pixel - 1 for c in shown)]
    figure = new_figure((8, 0.9 + 0.27 * len(names)), dpi=_DPI)
    axis = figure.subplots()
    floor = 1e-3
    axis.barh(
        np.arange(len(names)), np.maximum(excess, floor) - floor, left=floor, color=[_BEFORE] + [_AFTER] * len(shown)
    )
    for row, value in enumerate(excess):
        axis.annotate(f"{value:.2g}", (max(value, floor), row), (3, 0), textcoords="offset points", va="center", size=7)
    axis.set_xscale("log")
    axis.set_xlim(floor, 3 * max(*excess, 10 * floor))
    axis.set_yticks(np.arange(len(names)), names, fontsize=8)
    axis.invert_yaxis()
    axis.set_xlabel("χ²/n − 1 on held-out captures")
    return figure


def free_maps(fits: Sequence[FreeMapFit]) -> Figure:
    """A row for each place with its fitted maps: surfaces as pictures, a few numbers as bars."""
    columns = max(len(fit.maps) for fit in fits)
    figure = new_figure((3.4 * columns, 2.5 * len(fits)), dpi=_DPI)
    for fit, line in zip(fits, figure.subplots(len(fits), columns, squeeze=False), strict=True):
        for axis in line[len(fit.maps) :]:
            axis.set_axis_off()
        for axis, shown in zip(line, fit.maps, strict=False):
            scale, unit = (1e9, "nm") if shown.unit == "m" else (100.0, "%")
            axis.set_title(f"{fit.location}: {shown.name} ({unit})", fontsize=9)
            axis.tick_params(labelsize=7)
            axis.set_xlabel(shown.axis, fontsize=7)
            if shown.values.ndim == 1:
                _number_bars(axis, scale * shown.values, shown.labels)
                continue
            most = max(scale * float(np.abs(shown.values).max()), 1e-9)
            colours = {"cmap": "RdBu_r", "vmin": -most, "vmax": most, "interpolation": "bicubic"}
            drawn = axis.imshow(scale * shown.values, extent=shown.extent, **colours)
            figure.colorbar(drawn, ax=axis, fraction=0.035, pad=0.02).ax.tick_params(labelsize=7)
    return figure


def pixel_maps(maps: Sequence[PixelMap]) -> Figure:
    """A row for each modulator: how far its pixels, its columns and its rows stand out."""
    figure = new_figure((13.5, 3.2 * len(maps)), dpi=_DPI)
    ratios = {"width_ratios": (1.3, 1.0, 1.0)}
    for shown, (picture, *profiles) in zip(
        maps, figure.subplots(len(maps), 3, squeeze=False, gridspec_kw=ratios), strict=True
    ):
        (top, left), (rows, columns) = shown.first_pixel, shown.pixels.shape
        extent = (left - 0.5, left + columns - 0.5, top + rows - 0.5, top - 0.5)
        most = max(float(shown.pixels.max()), 1.0)
        drawn = picture.imshow(shown.pixels, cmap="magma", vmin=0, vmax=most, extent=extent, interpolation="nearest")
        figure.colorbar(drawn, ax=picture, fraction=0.035, pad=0.02).ax.tick_params(labelsize=7)
        picture.set_title(f"{shown.name}: pixels (σ)", fontsize=9)
        picture.set_xlabel("column", fontsize=8)
        picture.set_ylabel("row", fontsize=8)
        picture.tick_params(labelsize=7)
        for axis, name, first, values in zip(
            profiles, ("column", "row"), (left, top), (shown.columns, shown.rows), strict=True
        ):
            axis.plot(first + np.arange(len(values)), values, color=_AFTER, linewidth=1, drawstyle="steps-mid")
            axis.set_title(f"{shown.name}: {name}s (σ)", fontsize=9)
            axis.set_xlabel(name, fontsize=8)
            axis.tick_params(labelsize=7)
    return figure


def _number_bars(axis: Axes, values: NDArray[np.float64], labels: Sequence[str]) -> None:
    """A few numbers, with their labels, or over 0 … 1."""
    if labels:
        axis.bar(labels, values, color=_AFTER, width=0.8 if len(labels) > 1 else 0.2)
        axis.set_xlim(-0.6, len(labels) - 0.4)
    else:
        axis.bar(np.linspace(0, 1, len(values)), values, color=_AFTER, width=0.8 / max(len(values) - 1, 1))


def _paired_bars(axis: Axes, before: Sequence[ExcessBin], after: Sequence[ExcessBin]) -> None:
    positions = np.arange(len(before))
    axis.bar(positions - 0.2, [b.chi2_per_pixel for b in before], 0.4, color=_BEFORE, label="nominal model")
    axis.bar(positions + 0.2, [b.chi2_per_pixel for b in after], 0.4, color=_AFTER, label="extended model")
    axis.axhline(1.0, color=_NOISE, linewidth=1, linestyle="--", label="noise alone")
    axis.set_xticks(positions, [_wrapped(b.name) for b in before], fontsize=7)
    if max(b.chi2_per_pixel for b in before) > 10:
        axis.set_yscale("log")
    axis.set_ylabel("χ²/n", fontsize=8)
    axis.tick_params(axis="y", labelsize=7)


def _wrapped(name: str) -> str:
    return textwrap.fill(name, 16)
