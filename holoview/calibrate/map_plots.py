"""Pictures of what a calibration learned: source, tables, warp, pupils, and residuals before and after."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.calibrate.data_split import DataSplit
from holoview.calibrate.figure_file import png_figure
from holoview.calibrate.prediction_score import PredictSignals
from holoview.calibrate.training_data import TrainingData
from holoview.captures.dataset import Captures
from holoview.effects.learned_maps import LearnedMaps
from holoview.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.floating]

_MOST_ROWS = 4
_PUPIL_SAMPLES = 129


def plot_calibration(
    folder: Path,
    material: TrainingData,
    learned: LearnedMaps,
    split: DataSplit,
    predict_nominal: PredictSignals,
    predict_calibrated: PredictSignals,
) -> list[Path]:
    """Writes the pictures into a folder that exists; returns their paths."""
    captures = material.captures
    with torch.no_grad():
        drawn: dict[str, Callable[[Path], None]] = {
            "source": lambda path: _source(path, learned, captures),
            "lut": lambda path: _tables(path, learned),
            "residual": lambda path: _residuals(path, material, split, predict_nominal, predict_calibrated),
        }
        if learned.has("warp_m"):
            drawn["warp"] = lambda path: _warp(path, learned, captures)
        if learned.has("zernike2_m"):
            drawn["pupils"] = lambda path: _pupils(path, learned)
        paths = [folder / f"{name}.png" for name in drawn]
        for path, draw in zip(paths, drawn.values(), strict=True):
            draw(path)
    return paths


def _source(path: Path, learned: LearnedMaps, captures: Captures) -> None:
    """Amplitude and optical path of the light on modulator 1 at every anchor."""
    shape = (captures.levels.shape[2], captures.levels.shape[3])
    panel = captures.slms[0]
    anchors = learned.layout.anchors_m
    with png_figure(path, (4.0 * len(anchors), 6.4)) as figure:
        for axes, anchor in zip(_columns(figure, 2, len(anchors)), anchors, strict=True):
            at = ModulatorContext(0, anchor, panel.opd_range_m, panel.pitch_m, shape, captures.upsample)
            amplitude = learned.source_map("source_log_amplitude", at).exp()
            path_m = learned.source_map("source_opd_m", at)
            title = format_rounded(anchor, "nm")
            _show_map(figure, axes[0], amplitude.numpy(), f"amplitude, {title}", "viridis")
            _show_map(
                figure, axes[1], ((path_m - path_m.mean()) * 1e9).numpy(), f"optical path / nm, {title}", "RdBu", 0.0
            )


def _tables(path: Path, learned: LearnedMaps) -> None:
    """The table of each modulator beside the nominal straight line."""
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


def _warp(path: Path, learned: LearnedMaps, captures: Captures) -> None:
    """How far what modulator 2 shows is displaced."""
    rows, columns = captures.levels.shape[2:]
    pitch_m = captures.slms[0].pitch_m
    moved = (learned.displacement((rows, columns)) / pitch_m).numpy()
    step = max(1, columns // 16)
    y, x = np.mgrid[step // 2 : rows : step, step // 2 : columns : step]
    with png_figure(path, (7.0, 5.0)) as figure:
        axes = figure.subplots()
        _show_map(figure, axes, np.hypot(*moved), "displacement of modulator 2 / pixels", "viridis")
        if moved.any():
            axes.quiver(x, y, moved[1][y, x], moved[0][y, x], angles="xy", color="white")


def _pupils(path: Path, learned: LearnedMaps) -> None:
    """Optical path and amplitude of each relay at the reference wavelength."""
    layout = learned.layout
    relays = [relay for relay in range(2) if learned.has(f"zernike{relay + 1}_m")]
    with png_figure(path, (4.4 * len(relays), 7.2)) as figure:
        for axes, relay in zip(_columns(figure, 2, len(relays)), relays, strict=True):
            sine = layout.sine2 if relay else layout.sine1
            side = torch.linspace(-sine, sine, _PUPIL_SAMPLES, dtype=torch.float64)
            at = RelayContext(relay, layout.reference_m, side[:, None], side[None, :], sine)
            inside = (torch.hypot(side[:, None], side[None, :]) <= sine).numpy()
            delay = np.where(inside, learned.relay_opd(at).numpy() * 1e9, np.nan)
            gain = np.where(inside, learned.relay_amplitude(at).numpy(), np.nan)
            title = f"relay {relay + 1}, {format_rounded(layout.reference_m, 'nm')}"
            _show_map(figure, axes[0], delay, f"optical path / nm, {title}", "RdBu", 0.0)
            _show_map(figure, axes[1], gain, f"amplitude, {title}", "viridis")


def _residuals(
    path: Path,
    material: TrainingData,
    split: DataSplit,
    predict_nominal: PredictSignals,
    predict_calibrated: PredictSignals,
) -> None:
    """A held-out capture of every wavelength: what was seen, and what is left before and after, in the noise's σ."""
    shown = _examples(material.captures, split)
    heads = ("seen / counts", "left before / σ", "left after / σ")
    with png_figure(path, (12.0, 3.2 * len(shown))) as figure:
        for axes, capture in zip(figure.subplots(len(shown), 3, squeeze=False), shown, strict=True):
            seen = material.weighted_image(capture)
            title = f"{format_rounded(float(material.captures.wavelength_m[capture]), 'nm')}, capture {capture}"
            _show_map(figure, axes[0], seen.light.numpy(), f"{heads[0]}, {title}", "magma")
            rests = []
            for signals in (predict_nominal, predict_calibrated):
                signal = signals([capture])[0]
                rests.append((seen.weight.sqrt() * (seen.light - seen.best_gain(signal) * signal)).numpy())
            reach = max(3.0, float(np.quantile(np.abs(rests[0]), 0.99)))
            for one, rest, head in zip(axes[1:], rests, heads[1:], strict=True):
                _show_map(
                    figure,
                    one,
                    rest,
                    f"{head}, r.m.s. {np.sqrt(np.mean(rest[rest != 0] ** 2)):.3g}",
                    "RdBu",
                    0.0,
                    reach,
                )


def _examples(captures: Captures, split: DataSplit) -> list[int]:
    """A held-out capture of every wavelength, at most a few."""
    held = np.concatenate([split.validation, split.unseen_planes, split.unseen_wavelengths]).astype(np.intp)
    held = held if len(held) else split.train
    first = [int(held[captures.wavelength_m[held] == λ][0]) for λ in np.unique(captures.wavelength_m[held])]
    return first[:_MOST_ROWS]


def _columns(figure: Figure, rows: int, columns: int) -> Iterator[Sequence[Axes]]:
    return iter(figure.subplots(rows, columns, squeeze=False).T)


def _show_map(
    figure: Figure, axes: Any, values: Floats, title: str, colours: str, middle: float | None = None, reach: float = 0.0
) -> None:
    """A map with its scale; a `middle` makes the colours symmetric about it."""
    limits = {}
    if middle is not None:
        reach = reach or float(np.nanmax(np.abs(values - middle))) or 1.0
        limits = {"vmin": middle - reach, "vmax": middle + reach}
    shown = axes.imshow(values, cmap=colours, **limits)
    axes.set_title(title, fontsize=9)
    axes.set_xticks([])
    axes.set_yticks([])
    figure.colorbar(shown, ax=axes, shrink=0.8)
