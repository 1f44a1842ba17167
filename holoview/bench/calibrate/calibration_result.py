"""The result of a calibration: response of the lasers, scores before and after, and the preset with its maps.

fit_laser_response   each laser's scale and power-law exponent, from the gains of the captures
score_predictions    χ² per pixel and PSNR before and after, by group of captures and wavelength
CalibrationResult    the preset, the file of its maps, and the scores as JSON
format_score         the scores as a table
CalibrationTask      the whole calibration, from captures to the result

The predicted signal s of a capture is proportional to power · exposure. The gain, by which it is multiplied to fit the
image best, shows how the light departs from that proportionality:

    gain = scale(λ) · power^e(λ)

scale(λ) is the relative brightness of a wavelength: laser, optics and camera together. The laser emits in proportion
to power^(1 + e); e is called the excess exponent and is 0 for an ideal laser. It is a linear regression of log gain on
log power, and is left undetermined where the captures of a wavelength were taken at nearly one power.

The signals that a model predicts are scaled by one gain per wavelength, fitted to the training captures of that
wavelength (to its own captures for a wavelength that was held out whole); the gain of the calibrated model also
follows the laser's power law. With light y and weights w, each capture of n used pixels and gain g has

    χ²/n = Σ w·(y − g·s)² / n        PSNR = 10·log₁₀(peak²·n / Σ (y − g·s)²),   peak = 99.9th percentile of y

Both models are scored with the same weights, from the camera's noise at the signal of the calibrated model.

plot_calibration draws the learned maps, and residuals before and after calibration.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.bench.calibrate.train import (
    CalibrationCheckpoint,
    CalibrationModel,
    CalibrationSettings,
    DataSplit,
    Indices,
    TrainingData,
    TrainingState,
    WeightedImage,
    captures_digest,
    default_epochs,
    map_layout_for,
    split_captures,
    train,
)
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.prepared_captures import FitQuality
from holoview.light.model import preset
from holoview.light.model.effects.hook_contexts import ModulatorContext, RelayContext
from holoview.light.model.effects.learned_maps import LearnedMaps, MapLayout, write_calibration
from holoview.light.model.elements import AmplitudeModulator
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.figures import png_figure
from holoview.util.progress import ProgressCallback
from holoview.util.units import format_rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Tensor = torch.Tensor
Floats = NDArray[np.float64]

_MIN_LOG_POWER_RMS = 0.05  # spread of log power that a regression needs
_MIN_CAPTURES = 4  # of a wavelength
_SIGNIFICANCE = 3.0  # σ
_MIN_EXCESS_EXPONENT = 0.003  # smaller ones change no image visibly
_MAX_EXPONENT_SIGMA = 0.1  # gains that scatter more are those of a model that is still wrong
_PLAUSIBLE_EXPONENTS = (-0.9, 3.0)


@dataclass(frozen=True)
class LaserResponse:
    """The response of each laser, (wavelength,) each. `result` relies on the order of the fields.

    scale: gain at power 1.
    excess_exponent: e of gain ∝ power^e; 0 where it is undetermined.
    exponent_sigma: standard deviation of e; infinite where it is undetermined.
    """

    wavelength_m: Floats
    scale: Floats
    excess_exponent: Floats
    exponent_sigma: Floats

    @property
    def common_exponent(self) -> tuple[float, float]:
        """Weighted mean of e over the wavelengths, and its standard deviation; (0, inf) if all are undetermined."""
        weight = 1 / np.square(self.exponent_sigma)
        if not weight.sum() > 0:
            return 0.0, math.inf
        return float((weight * self.excess_exponent).sum() / weight.sum()), float(weight.sum() ** -0.5)

    @property
    def is_nonlinear(self) -> bool:
        """Whether the common exponent differs from 0 significantly, by a plausible and relevant amount."""
        exponent, sigma = self.common_exponent
        return (
            sigma < _MAX_EXPONENT_SIGMA
            and abs(exponent) > max(_MIN_EXCESS_EXPONENT, _SIGNIFICANCE * sigma)
            and _PLAUSIBLE_EXPONENTS[0] < exponent < _PLAUSIBLE_EXPONENTS[1]
        )


def fit_laser_response(captures: Captures, indices: NDArray[np.intp], gains: Floats) -> LaserResponse:
    """The response of the lasers, from captures of these indices (n,) and their gains (n,)."""
    wavelengths = np.unique(captures.wavelength_m[indices])
    rows = []
    for wavelength in wavelengths:
        mask = captures.wavelength_m[indices] == wavelength
        rows.append(_fit_power_law(np.log(captures.power[indices[mask]]), np.log(np.maximum(gains[mask], 1e-30))))
    scale, exponent, sigma = (np.array(column) for column in zip(*rows, strict=True))
    return LaserResponse(wavelengths, scale, exponent, sigma)


def _fit_power_law(log_power: Floats, log_gain: Floats) -> tuple[float, float, float]:
    """Scale, excess exponent and its σ for one wavelength, by linear regression."""
    centred = log_power - log_power.mean()
    if len(log_power) < _MIN_CAPTURES or float(np.sqrt(np.mean(centred**2))) < _MIN_LOG_POWER_RMS:
        return math.exp(float(log_gain.mean())), 0.0, math.inf
    exponent = float(centred @ log_gain / (centred @ centred))
    residual = log_gain - log_gain.mean() - exponent * centred
    sigma = math.sqrt(float(residual @ residual) / (len(residual) - 2) / float(centred @ centred))
    return math.exp(float(log_gain.mean()) - exponent * float(log_power.mean())), exponent, max(sigma, 1e-6)


PredictSignals = Callable[[list[int]], Tensor]
"""A model: predicts the signals (capture, y, x) of captures of some indices."""


# --- scores ---


_PEAK_QUANTILE = 0.999
_TINY = 1e-300  # avoids division by zero for an image without light


@dataclass(frozen=True)
class RegressionSums:
    """Sums over the used pixels of each capture, from which the errors for any gain follow.

    weighted: (capture, 3), Σ w·y², Σ w·y·s, Σ w·s².
    plain: (capture, 3), Σ y², Σ y·s, Σ s².
    pixels: (capture,), number of used pixels.
    peak: (capture,), 99.9th percentile of the light.
    """

    weighted: Floats
    plain: Floats
    pixels: Floats
    peak: Floats

    @staticmethod
    def from_rows(rows: Floats) -> RegressionSums:
        """From an array (capture, 8) with the fields side by side."""
        return RegressionSums(rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7])

    @property
    def best_gains(self) -> Floats:
        """The gain of each capture with the lowest χ², (capture,)."""
        return self.weighted[:, 1] / np.maximum(self.weighted[:, 2], _TINY)

    def chi2(self, gain: Floats) -> Floats:
        """χ² per pixel of each capture for gains (capture,)."""
        return _squared_error(self.weighted, gain) / self.pixels

    def psnr_db(self, gain: Floats) -> Floats:
        """PSNR of each capture for gains (capture,)."""
        return 10 * np.log10(self.peak**2 * self.pixels / np.maximum(_squared_error(self.plain, gain), _TINY))


@dataclass(frozen=True)
class ScoreRow:
    """The score of the captures of a group (a key of `DataSplit.groups`) and a wavelength (None: all of the group).

    captures: how many there are. before, after: means over them, of the nominal and of the calibrated model.
    """

    group: str
    wavelength_m: float | None
    captures: int
    before: FitQuality
    after: FitQuality


@dataclass(frozen=True)
class PredictionScore:
    """The scores of all groups and wavelengths, and the response of the lasers that the gains show."""

    rows: tuple[ScoreRow, ...]
    response: LaserResponse


def score_predictions(
    data: TrainingData,
    split: DataSplit,
    predict_nominal: PredictSignals,
    predict_calibrated: PredictSignals,
    progress: ProgressCallback,
) -> PredictionScore:
    """Scores the nominal and the calibrated model on all captures.

    split: groups to score; the gains are fitted to `split.train`.
    progress: called after each capture.
    """
    captures = data.captures
    sums = _regression_sums(data, predict_nominal, predict_calibrated, progress)
    response = fit_laser_response(captures, split.train, sums[1].best_gains[split.train])
    gains = [_gain_per_capture(captures, split, *model) for model in zip(sums, (None, response), strict=True)]
    rows = tuple(
        ScoreRow(
            group, wavelength_m, len(indices), *(_mean_quality(*m, indices) for m in zip(sums, gains, strict=True))
        )
        for group, wavelength_m, indices in _groups(captures, split)
    )
    return PredictionScore(rows, response)


def _groups(captures: Captures, split: DataSplit) -> Iterator[tuple[str, float | None, Indices]]:
    """Name, wavelength and indices of each group: first all its captures, then those of each wavelength."""
    for name, indices in split.groups().items():
        yield name, None, indices
        wavelengths = captures.wavelength_m[indices]
        for wavelength in np.unique(wavelengths):
            yield name, float(wavelength), indices[wavelengths == wavelength]


def _regression_sums(
    data: TrainingData, predict_nominal: PredictSignals, predict_calibrated: PredictSignals, progress: ProgressCallback
) -> tuple[RegressionSums, RegressionSums]:
    """The sums of the nominal and of the calibrated model, with the same weights."""
    count = len(data.captures)
    nominal_rows, calibrated_rows = [], []
    for k in range(count):
        nominal, calibrated = predict_nominal([k])[0], predict_calibrated([k])[0]
        image = data.weighted_image(k)
        image = image.reweighted(data.captures.camera, image.best_gain(calibrated) * calibrated)
        nominal_rows.append(_sums(image, nominal))
        calibrated_rows.append(_sums(image, calibrated))
        progress(k + 1, count, "scoring")
    return RegressionSums.from_rows(np.array(nominal_rows)), RegressionSums.from_rows(np.array(calibrated_rows))


def _sums(image: WeightedImage, signal: Tensor) -> list[float]:
    """The fields of `RegressionSums` for one capture, side by side."""
    used = image.weight > 0
    s, y, w = (values[used].double() for values in (signal, image.light, image.weight))
    pairs = ((y, y), (y, s), (s, s))
    weighted, plain = [float((w * a * b).sum()) for a, b in pairs], [float((a * b).sum()) for a, b in pairs]
    return [*weighted, *plain, float(used.sum()), float(np.quantile(y.numpy(), _PEAK_QUANTILE))]


def _gain_per_capture(
    captures: Captures, split: DataSplit, sums: RegressionSums, response: LaserResponse | None
) -> Floats:
    """The gain of each capture, (capture,): one factor per wavelength times power^e of the laser's response."""
    power_law = np.ones(len(captures)) if response is None else _power_law(captures, response)
    is_train = np.isin(np.arange(len(captures)), split.train)
    factors = np.empty(len(captures))
    for wavelength in captures.wavelengths_m:
        of_wavelength = captures.wavelength_m == wavelength
        fitted = of_wavelength & is_train if (of_wavelength & is_train).any() else of_wavelength
        _, ys, ss = sums.weighted[fitted].T
        law = power_law[fitted]
        factors[of_wavelength] = (law * ys).sum() / max(float((law**2 * ss).sum()), _TINY)
    return factors * power_law


def _power_law(captures: Captures, response: LaserResponse) -> Floats:
    """power^e of each capture, (capture,), with the common e for wavelengths whose own is undetermined."""
    if not response.is_nonlinear:
        return np.ones(len(captures))
    common = response.common_exponent[0]
    exponents = {
        wavelength: exponent if math.isfinite(sigma) else common
        for wavelength, exponent, sigma in zip(
            response.wavelength_m, response.excess_exponent, response.exponent_sigma, strict=True
        )
    }
    conditions = zip(captures.wavelength_m, captures.power, strict=True)
    return np.array([power ** exponents.get(wavelength, common) for wavelength, power in conditions])


def _mean_quality(sums: RegressionSums, gain: Floats, indices: Indices) -> FitQuality:
    chi2, psnr = sums.chi2(gain)[indices], sums.psnr_db(gain)[indices]
    return FitQuality(float(chi2.mean()), float(psnr.mean()))


def _squared_error(sums: Floats, gain: Floats) -> Floats:
    """Σ (y − g·s)² = Σ y² − 2g·Σ y·s + g²·Σ s² of each capture, (capture,)."""
    yy, ys, ss = sums.T
    return yy - 2 * gain * ys + gain**2 * ss


# --- the result ---


_GROUPS = {
    "train": "learned from",
    "captures": "other captures",
    "planes": "another plane",
    "wavelengths": "another wavelength",
}
_GEOMETRY_TOLERANCE = 1e-6  # relative


@dataclass(frozen=True)
class CalibrationResult:
    """The result of a calibration.

    bench: nominal bench with its known effects. learned: its maps. score: how well they predict the captures.
    normalise_amplitudes: set the bench's laser amplitudes to the relative brightness of the wavelengths that the
    camera recorded (`LaserResponse.scale`).
    """

    captures: Captures
    bench: System
    learned: LearnedMaps
    score: PredictionScore
    normalise_amplitudes: bool = False

    def calibrated_system(self, maps: Path) -> System:
        """The bench with the effect `calibrated`, whose maps are in the file `maps`.

        Where the lasers' light isn't proportional to power, their exponent is added to the effect `laser_power`.
        """
        effects: dict[str, Any] = {**self.bench.effect_values, "calibrated": {"file": str(maps.resolve())}}
        response = self.score.response
        if response.is_nonlinear:
            known_exponent = effects.get("laser_power", {}).get("exponent", 0.0)
            effects["laser_power"] = {"exponent": known_exponent + response.common_exponent[0]}
        changes: dict[str, Any] = {"effects": effects}
        if self.normalise_amplitudes:
            scale = np.interp(self.bench.wavelengths_m, response.wavelength_m, response.scale)
            changes["amplitudes"] = [(scale / scale.max()).tolist()]
        return self.bench.edit(changes)

    def as_json(self) -> dict[str, Any]:
        """Digest of the captures, scores, and response of the lasers, for JSON."""
        response = self.score.response
        common, sigma = response.common_exponent
        lasers = [
            {"wavelength_nm": _nm(λ), "scale": float(a), "exponent": _rounded(1 + e), "sigma": _rounded(s)}
            for λ, a, e, s in zip(*dataclasses.astuple(response), strict=True)
        ]
        return {
            "captures": captures_digest(self.captures),
            "scores": [_row_as_json(row) for row in self.score.rows],
            "lasers": lasers,
            "laser_exponent": {"value": _rounded(1 + common), "sigma": _rounded(sigma)},
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the maps beside the preset, then the preset, each atomically. Returns the path of the maps."""
        maps = maps_path(Path(path))
        write_calibration(maps, self.learned, self.as_json())
        preset.save(self.calibrated_system(maps), path)
        return maps


def maps_path(path: Path) -> Path:
    """The file beside a preset into which its maps are written: the same name with the suffix .safetensors."""
    return path.with_suffix(".safetensors")


def starting_bench(captures: Captures, preset_system: System | None, name: str) -> System:
    """The bench that the calibration begins with: the captures' nominal bench, or a preset of the same geometry.

    preset_system: the preset, whose effects count as known; None for the nominal bench.
    name: of the nominal bench.

    Raises UserError, naming the quantity, where the preset's geometry differs from that of the captures, or if the
    preset has learned maps already.
    """
    nominal = captures.nominal_system()
    if preset_system is None:
        return nominal.edit({"name": name, "description": f"Calibrated from {len(captures)} captures."})
    if "calibrated" in preset_system.effect_values:
        raise UserError("preset", "is calibrated already", remedy="start from the preset without [effects.calibrated]")
    if preset_system.is_chain != nominal.is_chain:
        kinds = {True: "a chain of elements", False: "one or two equal phase modulators"}
        found, expected = kinds[preset_system.is_chain], f"{kinds[nominal.is_chain]}, as the captures' file tells"
        raise UserError("preset", found, expected=expected)
    pairs = zip(_geometry(preset_system).items(), _geometry(nominal).items(), strict=False)
    for (key, stated), (own, expected) in pairs:
        if key != own:
            raise UserError("preset: elements", f'"{key}"', expected=f'"{own}" there, as the captures\' file tells')
        if not _nearly_equal(stated, expected):
            raise UserError(
                f"preset: {key}",
                _format_value(stated),
                expected=f"{_format_value(expected)}, as the captures' file tells",
                remedy="change the preset with --set, or leave it out",
            )
    return preset_system


def _geometry(system: System) -> dict[str, Any]:
    """What captures tell of a bench, by the keys of presets, in a fixed order."""
    if not system.is_chain:
        keys = {"gap": "gap_m", "relay1": "relay1", "modulators": "modulators", "relay2": "relay2"}
        return {key: getattr(system, attribute) for key, attribute in keys.items()}
    parts: dict[str, Any] = {"number of elements": len(system.elements), "planes_from": system.planes_from}
    for name, element in zip(system.element_names, system.elements, strict=True):
        parts[f"elements.{name}.kind"] = element.kind
        own = [field.name for field in dataclasses.fields(element) if field.name not in ("name", "levels")]
        parts |= {f"elements.{name}.{key.removesuffix('_m')}": getattr(element, key) for key in own}
    return parts


def _nearly_equal(a: Any, b: Any) -> bool:
    """Whether two parts of a System are equal except for rounding; the levels of modulators may differ."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(_nearly_equal(x, y) for x, y in zip(a, b, strict=True))
    if dataclasses.is_dataclass(a) and type(a) is type(b):
        names = [field.name for field in dataclasses.fields(a) if field.name != "levels"]
        return all(_nearly_equal(getattr(a, name), getattr(b, name)) for name in names)
    if isinstance(a, float) and isinstance(b, float | int):
        return math.isclose(a, b, rel_tol=_GEOMETRY_TOLERANCE)
    return bool(np.all(a == b))


def _format_value(value: Any) -> str:
    return units.format_rounded(value, "mm", 6) if isinstance(value, float) else str(value)


def _row_as_json(row: ScoreRow) -> dict[str, Any]:
    return {
        "group": row.group,
        "wavelength_nm": None if row.wavelength_m is None else _nm(row.wavelength_m),
        "captures": row.captures,
        "before": {"chi2_per_pixel": _rounded(row.before.chi2_per_pixel), "psnr_db": _rounded(row.before.psnr_db)},
        "after": {"chi2_per_pixel": _rounded(row.after.chi2_per_pixel), "psnr_db": _rounded(row.after.psnr_db)},
    }


def format_score(score: PredictionScore) -> list[str]:
    """The scores as lines of a table, and the exponent of the lasers if it was determined."""
    lines = [f"{'':22}{'captures':>9}{'PSNR before':>14}{'after':>9}{'chi2/n before':>15}{'after':>9}"]
    for row in score.rows:
        name = _GROUPS[row.group] if row.wavelength_m is None else f"  {_nm(row.wavelength_m):g} nm"
        lines.append(
            f"{name:22}{row.captures:>9}{row.before.psnr_db:>11.1f} dB{row.after.psnr_db:>6.1f} dB"
            f"{row.before.chi2_per_pixel:>15.3g}{row.after.chi2_per_pixel:>9.3g}"
        )
    exponent, sigma = score.response.common_exponent
    if math.isfinite(sigma):
        remark = "" if score.response.is_nonlinear else ": no departure from proportionality is told"
        lines.append(f"lasers' light rises as power to the {1 + exponent:.3f} ± {max(sigma, 5e-4):.3f}{remark}")
    return lines


def _nm(wavelength_m: float) -> float:
    return round(wavelength_m * 1e9, 3)


def _rounded(value: float) -> float | None:
    """The value with six significant digits; None, which JSON can hold, for one that isn't finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


# --- the whole calibration --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CalibrationTask:
    """The data of a calibration: captures, nominal bench, split, maps and settings.

    normalises: whether the amplitudes of the preset are scaled, as it states none itself.
    """

    captures: Captures
    bench: System
    split: DataSplit
    layout: MapLayout
    settings: CalibrationSettings
    normalises: bool

    @property
    def padded_samples(self) -> int:
        """Samples of a simulated field."""
        return self.settings.sampling.padded_samples(self.captures)

    @property
    def notes(self) -> list[str]:
        """Limits of the captures: properties of the bench that they can't show."""
        notes = []
        if len(self.captures.wavelengths_m) == 1:
            notes.append("one wavelength only: what changes with the wavelength can't be known")
        if len(set(self.captures.distance_m.tolist())) == 1 and not self.captures.is_fourier:
            to_camera = self.layout.relay_maps[-1].name
            notes.append(f"one plane only: {to_camera} and the camera can't be told apart")
        chain = self.captures.chain
        pairs = () if chain is None else zip(chain.element_names, chain.elements, strict=True)
        if black := [name for name, element in pairs if isinstance(element, AmplitudeModulator)]:
            which = " and ".join(black)
            notes.append(f"tables begin at 0: what black pixels of {which} let through is for a diagnosis (--preset)")
        return notes

    def train(self, resume: CalibrationCheckpoint | None) -> Iterator[TrainingState]:
        """A state after each epoch, from the beginning or from a checkpoint; see `train`."""
        return train(self.captures, self.bench.effect_values, self.split, self.layout, self.settings, resume)

    def result(
        self, maps: LearnedMaps, progress: ProgressCallback, pictures: Path | None
    ) -> tuple[CalibrationResult, list[Path]]:
        """Scores maps, and draws them into a folder if one is given; returns the drawn files too."""
        data = TrainingData(self.captures, self.bench.effect_values)
        model = CalibrationModel(self.captures, self.layout, self.bench.effect_values, self.settings.sampling)
        model.set_maps(maps.tensors)
        score = score_predictions(data, self.split, model.predict_nominal, model.predict, progress)
        drawn: list[Path] = []
        if pictures is not None:
            drawn += plot_calibration(pictures, data, maps, self.split, model.predict_nominal, model.predict)
        return CalibrationResult(self.captures, self.bench, maps, score, normalise_amplitudes=self.normalises), drawn


def plan_calibration(
    captures: Captures, start: System | None, name: str, settings: Mapping[str, Any], pixels_a_node: int | None
) -> CalibrationTask:
    """The task of learning from captures. start: the bench that a preset states. name: of the calibrated bench.

    settings: the `CalibrationSettings` that differ from the default, where "epochs" depend on the captures.
    pixels_a_node: how coarse the source's maps are. Raises UserError as `starting_bench` and `split_captures` do.
    """
    bench = starting_bench(captures, start, name)
    full = CalibrationSettings(**settings)
    split = split_captures(captures, full.share, full.seed)
    if "epochs" not in settings:
        full = dataclasses.replace(full, epochs=default_epochs(len(split.train), full.batch))
    coarseness = {} if pixels_a_node is None else {"pixels_per_node": pixels_a_node}
    layout = map_layout_for(captures, split.train, **coarseness)
    return CalibrationTask(captures, bench, split, layout, full, normalises=start is None)


# --- plots ------------------------------------------------------------------------------------------------------------


Reals = NDArray[np.floating]

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
        if learned.has(learned.layout.relay_maps[-1].zernike):
            plots["pupils"] = lambda path: _plot_pupils(path, learned)
        paths = [folder / f"{name}.png" for name in plots]
        for path, plot in zip(paths, plots.values(), strict=True):
            plot(path)
    return paths


def _plot_source(path: Path, learned: LearnedMaps, captures: Captures) -> None:
    """Amplitude and optical path of the light on the first modulator or element at every anchor wavelength."""
    shape = (captures.levels.shape[2], captures.levels.shape[3])
    slm, chain = captures.slms[0], captures.chain
    own = (slm.opd_range_m, slm.pitch_m, shape, captures.upsample)
    own = own if chain is None else (0.0, chain.way.sample_m, chain.way.shape, 1)
    anchors = learned.layout.anchors_m
    with png_figure(path, (4.0 * len(anchors), 6.4)) as figure:
        for axes, anchor in zip(_columns(figure, 2, len(anchors)), anchors, strict=True):
            at = ModulatorContext(0, anchor, *own)
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
    names = learned.layout.elements or [f"modulator {number + 1}" for number in range(learned.layout.modulators)]
    with png_figure(path, (5.0, 4.2)) as figure:
        axes = figure.subplots()
        for modulator, name in enumerate(names):
            axes.plot(drive, learned.response_table(modulator).numpy(), "o-", markersize=3, label=name)
        axes.plot([0, 1], [0, 1], "--", color="grey", label="nominal")
        of = "what pixels show" if learned.layout.elements else "optical path / nominal stroke"
        axes.set(xlabel="drive", ylabel=of, title="look-up tables")
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
    relays = [(number, own) for number, own in enumerate(layout.relay_maps) if learned.has(own.zernike)]
    with png_figure(path, (4.4 * len(relays), 7.2)) as figure:
        for axes, (relay, own) in zip(_columns(figure, 2, len(relays)), relays, strict=True):
            sine = own.sine
            side = torch.linspace(-sine, sine, _PUPIL_SAMPLES, dtype=torch.float64)
            at = RelayContext(relay, layout.reference_m, side[:, None], side[None, :], sine)
            inside = (torch.hypot(side[:, None], side[None, :]) <= sine).numpy()
            opd_nm = np.where(inside, learned.relay_opd(at).numpy() * 1e9, np.nan)
            amplitude = np.where(inside, learned.relay_amplitude(at).numpy(), np.nan)
            title = f"{own.name}, {format_rounded(layout.reference_m, 'nm')}"
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
    figure: Figure, axes: Any, values: Reals, title: str, colours: str, centre: float | None = None, limit: float = 0.0
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
