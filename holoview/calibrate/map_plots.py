"""Plots the learned maps (source, look-up tables, warp, pupils), and residuals before and after calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.calibrate.calibration_result import PredictSignals
from holoview.calibrate.train import TrainingData
from holoview.calibrate.training_plan import DataSplit
from holoview.captures.dataset import Captures
from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.model.effects.learned_maps import LearnedMaps
from holoview.report.images import png_figure
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.floating]

_MAX_RESIDUAL_ROWS = 4
_PUPIL_SAMPLES = 129


def plot_calibration(
    folder: Path,
    data: TrainingData,
    learned: LearnedMaps,
    split: DataSplit,
    predict_nominal: PredictSignals,
    predict_calibrated: PredictSignals,
) -> list[Path]:
    """Writes source.png, lut.png, residual.png and, where there are such maps, warp.png and pupils.png.

    folder: must exist. Returns the paths of the files.
    """
    captures = data.captures
    with torch.no_grad():
        plots: dict[str, Callable[[Path], None]] = {
            "source": lambda path: _plot_source(path, learned, captures),
            "lut": lambda path: _plot_tables(path, learned),
            "residual": lambda path: _plot_residuals(path, data, split, predict_nominal, predict_calibrated),
        }
        if learned.has("warp_m"):
            plots["warp"] = lambda path: _plot_warp(path, learned, captures)
        if learned.has("zernike2_m"):
            plots["pupils"] = lambda path: _plot_pupils(path, learned)
        paths = [folder / f"{name}.png" for name in plots]
        for path, plot in zip(paths, plots.values(), strict=True):
            plot(path)
    return paths


def _plot_source(path: Path, learned: LearnedMaps, captures: Captures) -> None:
    """Amplitude and optical path of the light on modulator 1 at every anchor wavelength."""
    shape = (captures.levels.shape[2], captures.levels.shape[3])
    slm = captures.slms[0]
    anchors = learned.layout.anchors_m
    with png_figure(path, (4.0 * len(anchors), 6.4)) as figure:
        for axes, anchor in zip(_columns(figure, 2, len(anchors)), anchors, strict=True):
            at = ModulatorContext(0, anchor, slm.opd_range_m, slm.pitch_m, shape, captures.upsample)
            amplitude = learned.source_map("source_log_amplitude", at).exp()
            opd_m = learned.source_map("source_opd_m", at)
            title = format_rounded(anchor, "nm")
            _show_map(figure, axes[0], amplitude.numpy(), f"amplitude, {title}", "viridis")
            _show_map(
                figure, axes[1], ((opd_m - opd_m.mean()) * 1e9).numpy(), f"optical path / nm, {title}", "RdBu", 0.0
            )


def _plot_tables(path: Path, learned: LearnedMaps) -> None:
    """The look-up table of each modulator beside the nominal straight line."""
    drive = np.linspace(0, 1, learned.layout.knots)
    with png_figure(path, (5.0, 4.2)) as figure:
        axes = figure.subplots()
        for modulator in range(learned.layout.modulators):
            axes.plot(
                drive, learned.response_table(modulator).numpy(), "o-", markersize=3, label=f"modulator {modulator + 1}"
            )
        axes.plot([0, 1], [0, 1], "--", color="grey", label="nominal")
        axes.set(xlabel="drive", ylabel="optical path / nominal stroke", title="look-up tables")
        axes.legend()


def _plot_warp(path: Path, learned: LearnedMaps, captures: Captures) -> None:
    """Displacement of modulator 2 in pixels: its magnitude as a map, and arrows."""
    rows, columns = captures.levels.shape[2:]
    pitch_m = captures.slms[0].pitch_m
    shift = (learned.displacement((rows, columns)) / pitch_m).numpy()
    step = max(1, columns // 16)
    y, x = np.mgrid[step // 2 : rows : step, step // 2 : columns : step]
    with png_figure(path, (7.0, 5.0)) as figure:
        axes = figure.subplots()
        _show_map(figure, axes, np.hypot(*shift), "displacement of modulator 2 / pixels", "viridis")
        if shift.any():
            axes.quiver(x, y, shift[1][y, x], shift[0][y, x], angles="xy", color="white")


def _plot_pupils(path: Path, learned: LearnedMaps) -> None:
    """Optical path and amplitude of each relay at the reference wavelength."""
    layout = learned.layout
    relays = [relay for relay in range(2) if learned.has(f"zernike{relay + 1}_m")]
    with png_figure(path, (4.4 * len(relays), 7.2)) as figure:
        for axes, relay in zip(_columns(figure, 2, len(relays)), relays, strict=True):
            sine = layout.sine2 if relay else layout.sine1
            side = torch.linspace(-sine, sine, _PUPIL_SAMPLES, dtype=torch.float64)
            at = RelayContext(relay, layout.reference_m, side[:, None], side[None, :], sine)
            inside = (torch.hypot(side[:, None], side[None, :]) <= sine).numpy()
            opd_nm = np.where(inside, learned.relay_opd(at).numpy() * 1e9, np.nan)
            amplitude = np.where(inside, learned.relay_amplitude(at).numpy(), np.nan)
            title = f"relay {relay + 1}, {format_rounded(layout.reference_m, 'nm')}"
            _show_map(figure, axes[0], opd_nm, f"optical path / nm, {title}", "RdBu", 0.0)
            _show_map(figure, axes[1], amplitude, f"amplitude, {title}", "viridis")


def _plot_residuals(
    path: Path,
    data: TrainingData,
    split: DataSplit,
    predict_nominal: PredictSignals,
    predict_calibrated: PredictSignals,
) -> None:
    """For a held-out capture of each wavelength: the image, and residuals of both models over the noise's σ."""
    shown = _examples(data.captures, split)
    heads = ("seen / counts", "left before / σ", "left after / σ")
    with png_figure(path, (12.0, 3.2 * len(shown))) as figure:
        for axes, capture in zip(figure.subplots(len(shown), 3, squeeze=False), shown, strict=True):
            image = data.weighted_image(capture)
            title = f"{format_rounded(float(data.captures.wavelength_m[capture]), 'nm')}, capture {capture}"
            _show_map(figure, axes[0], image.light.numpy(), f"{heads[0]}, {title}", "magma")
            residuals = []
            for predict in (predict_nominal, predict_calibrated):
                signal = predict([capture])[0]
                residuals.append((image.weight.sqrt() * (image.light - image.best_gain(signal) * signal)).numpy())
            limit = max(3.0, float(np.quantile(np.abs(residuals[0]), 0.99)))
            for map_axes, residual, head in zip(axes[1:], residuals, heads[1:], strict=True):
                rms = np.sqrt(np.mean(residual[residual != 0] ** 2))
                _show_map(figure, map_axes, residual, f"{head}, r.m.s. {rms:.3g}", "RdBu", 0.0, limit)


def _examples(captures: Captures, split: DataSplit) -> list[int]:
    """The first held-out capture of each wavelength, at most four; training captures if none is held out."""
    indices = np.concatenate([split.validation, split.unseen_planes, split.unseen_wavelengths]).astype(np.intp)
    indices = indices if len(indices) else split.train
    wavelengths = captures.wavelength_m[indices]
    first = [int(indices[wavelengths == wavelength][0]) for wavelength in np.unique(wavelengths)]
    return first[:_MAX_RESIDUAL_ROWS]


def _columns(figure: Figure, rows: int, columns: int) -> Iterator[Sequence[Axes]]:
    return iter(figure.subplots(rows, columns, squeeze=False).T)


def _show_map(
    figure: Figure, axes: Any, values: Floats, title: str, colours: str, centre: float | None = None, limit: float = 0.0
) -> None:
    """Shows a map (y, x) with a colour bar.

    centre: value about which the colours are symmetric; None for a range from the lowest to the highest value.
    limit: largest difference from the centre that the colours show; 0 for that of the map.
    """
    limits = {}
    if centre is not None:
        limit = limit or float(np.nanmax(np.abs(values - centre))) or 1.0
        limits = {"vmin": centre - limit, "vmax": centre + limit}
    mappable = axes.imshow(values, cmap=colours, **limits)
    axes.set_title(title, fontsize=9)
    axes.set_xticks([])
    axes.set_yticks([])
    figure.colorbar(mappable, ax=axes, shrink=0.8)
