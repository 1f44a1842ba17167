"""Scores predictions before and after calibration: χ² per pixel and PSNR by group and wavelength.

The signals s that a model predicts are scaled by one gain per wavelength, fitted to the training captures of that
wavelength (to its own captures for a wavelength that was held out whole); the gain of the calibrated model also
follows the laser's power law. With light y and weights w, each capture of n used pixels and gain g has

    χ²/n = Σ w·(y − g·s)² / n        PSNR = 10·log₁₀(peak²·n / Σ (y − g·s)²),   peak = 99.9th percentile of y

Both models are scored with the same weights, from the camera's noise at the signal of the calibrated model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.calibrate.data_split import DataSplit, Indices
from holoview.calibrate.laser_response import LaserResponse, fit_laser_response
from holoview.calibrate.training_data import TrainingData, WeightedImage
from holoview.captures.dataset import Captures
from holoview.captures.prepared_captures import FitQuality
from holoview.util.progress import ProgressCallback

Tensor = torch.Tensor
Floats = NDArray[np.float64]
PredictSignals = Callable[[list[int]], Tensor]
"""A model: predicts the signals (capture, y, x) of captures of some indices."""

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
