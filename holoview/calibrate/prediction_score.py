"""How well captures are predicted, before and after: χ²/n and PSNR, group by group and wavelength by wavelength.

One scale a wavelength, from the training captures of that wavelength; a wavelength that was held out whole has its own.
Both models are judged with the same weights: the camera's noise at what the calibrated one expects. PSNR is against the
brightest 0.1 % of each picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.calibrate.data_split import DataSplit
from holoview.calibrate.laser_response import LaserResponse, fit_laser_response
from holoview.calibrate.training_data import TrainingData, WeightedImage
from holoview.captures.dataset import Captures

Tensor = torch.Tensor
Floats = NDArray[np.float64]
PredictSignals = Callable[[list[int]], Tensor]
ProgressCallback = Callable[[int, int, str], None]


@dataclass(frozen=True)
class RegressionSums:
    """Sums over the trusted pixels of every capture, of light y and signal s: what any scale's error follows from.

    weighted: Σwyy Σwys Σwss, plain: Σyy Σys Σss, (capture, 3) each; pixels and peak (capture,).
    """

    weighted: Floats
    plain: Floats
    pixels: Floats
    peak: Floats

    @staticmethod
    def from_rows(rows: Floats) -> RegressionSums:
        """Of rows (capture, 8): weighted sums, plain sums, pixels, peak."""
        return RegressionSums(rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7])

    @property
    def best_gains(self) -> Floats:
        """The best scale of each capture."""
        return self.weighted[:, 1] / np.maximum(self.weighted[:, 2], 1e-300)

    def chi2(self, scale: Floats) -> Floats:
        """χ²/n of each capture at a scale of each."""
        return _squared_error(self.weighted, scale) / self.pixels

    def psnr_db(self, scale: Floats) -> Floats:
        """PSNR of each capture at a scale of each."""
        return 10 * np.log10(self.peak**2 * self.pixels / np.maximum(_squared_error(self.plain, scale), 1e-300))


@dataclass(frozen=True)
class FitQuality:
    """Means over captures."""

    chi2: float
    psnr_db: float


@dataclass(frozen=True)
class ScoreRow:
    """One line of a score: a group (train, captures, planes, wavelengths), a wavelength (None: all), before, after."""

    group: str
    wavelength_m: float | None
    captures: int
    before: FitQuality
    after: FitQuality

    @property
    def psnr_gain_db(self) -> float:
        """What was gained."""
        return self.after.psnr_db - self.before.psnr_db


@dataclass(frozen=True)
class PredictionScore:
    """All lines, and what the lasers emit."""

    rows: tuple[ScoreRow, ...]
    response: LaserResponse

    def overall(self, group: str) -> ScoreRow:
        """The line of a whole group."""
        return next(row for row in self.rows if row.group == group and row.wavelength_m is None)


def score_predictions(
    material: TrainingData,
    split: DataSplit,
    predict_nominal: PredictSignals,
    predict_calibrated: PredictSignals,
    progress: ProgressCallback,
) -> PredictionScore:
    """Scores two models, each a function from indices to signals (capture, y, x). report: (done, total, note)."""
    captures = material.captures
    first, second = _regression_sums(material, predict_nominal, predict_calibrated, progress)
    response = fit_laser_response(captures, split.train, second.best_gains[split.train])
    scales = _gain_per_capture(captures, split, first, None), _gain_per_capture(captures, split, second, response)
    rows: list[ScoreRow] = []
    for name, indices in split.groups().items():
        parts: list[tuple[float | None, NDArray[np.intp]]] = [(None, indices)]
        λs = captures.wavelength_m[indices]
        parts += [(float(λ), indices[λs == λ]) for λ in np.unique(λs)]
        for λ, chosen in parts:
            qualities = [_quality(m, s, chosen) for m, s in zip((first, second), scales, strict=True)]
            rows.append(ScoreRow(name, λ, len(chosen), *qualities))
    return PredictionScore(tuple(rows), response)


def _regression_sums(
    material: TrainingData, before: PredictSignals, after: PredictSignals, report: ProgressCallback
) -> tuple[RegressionSums, RegressionSums]:
    """Of both models, with the same weights."""
    count = len(material.captures)
    rows: tuple[list[list[float]], ...] = ([], [])
    for k in range(count):
        signals, seen = [model([k])[0] for model in (before, after)], material.weighted_image(k)
        seen = seen.reweighted(material.captures.camera, seen.best_gain(signals[1]) * signals[1])
        for mine, signal in zip(rows, signals, strict=True):
            mine.append(_sums(seen, signal))
        report(k + 1, count, "scoring")
    first, second = (np.array(mine) for mine in rows)
    return RegressionSums.from_rows(first), RegressionSums.from_rows(second)


def _sums(seen: WeightedImage, signal: Tensor) -> list[float]:
    """Weighted Σyy Σys Σss, plain ones, pixels, peak."""
    trusted = seen.weight > 0
    s, y, w = (values[trusted].double() for values in (signal, seen.light, seen.weight))
    pairs = ((y, y), (y, s), (s, s))
    weighted, plain = [float((w * a * b).sum()) for a, b in pairs], [float((a * b).sum()) for a, b in pairs]
    return [*weighted, *plain, float(trusted.sum()), float(np.quantile(y.numpy(), 0.999))]


def _gain_per_capture(
    captures: Captures, split: DataSplit, moments: RegressionSums, response: LaserResponse | None
) -> Floats:
    """The scale of each capture: one a wavelength, times what the laser's response says about its power."""
    bend = np.ones(len(captures))
    if response is not None and response.is_nonlinear:
        exponents = dict(zip(response.wavelength_m, response.excess_exponent, strict=True))
        known = {λ: e for (λ, e), σ in zip(exponents.items(), response.exponent_sigma, strict=True) if math.isfinite(σ)}
        common = response.common_exponent[0]
        bend = np.array([p ** known.get(λ, common) for λ, p in zip(captures.wavelength_m, captures.power, strict=True)])
    train = np.isin(np.arange(len(captures)), split.train)
    scales = np.empty(len(captures))
    for λ in captures.wavelengths_m:
        mine = captures.wavelength_m == λ
        by = mine & train if (mine & train).any() else mine
        _, ys, ss = moments.weighted[by].T
        scales[mine] = (bend[by] * ys).sum() / max(float((bend[by] ** 2 * ss).sum()), 1e-300)
    return scales * bend


def _quality(moments: RegressionSums, scale: Floats, chosen: NDArray[np.intp]) -> FitQuality:
    chi2, psnr = moments.chi2(scale)[chosen], moments.psnr_db(scale)[chosen]
    return FitQuality(float(chi2.mean()), float(psnr.mean()))


def _squared_error(sums: Floats, scale: Floats) -> Floats:
    yy, ys, ss = sums.T
    return yy - 2 * scale * ys + scale**2 * ss
