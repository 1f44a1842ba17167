"""Weights: how far a pixel may lie from its prediction by chance, or because the model isn't there yet.

Weights that follow the prediction of each candidate reward candidates that predict much light. So they are frozen: all
candidates of a comparison are judged with the same ones, from the pictures themselves (`blind_variance`) while no good
model is known, then from the prediction of the best (`model_variance`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from holoview.captures.dataset import Camera
from holoview.captures.prepared_captures import Images, PreparedCaptures


def model_variance(camera: Camera, expected: Images) -> Images:
    """Variance (counts²) of an expected signal in counts above black: shot noise, read noise, quantisation."""
    return camera.noise_variance(expected).astype(np.float32)


def neighbour_variance(data: PreparedCaptures, indices: NDArray[np.intp]) -> Images:
    """Variance (counts²) without a model, (capture, y, x): the mean of a pixel's eight neighbours stands for its
    signal.

    The pixel itself is left out. If its own noise set its weight, low readings would weigh more than high ones, which
    looks like a black level that is too low.
    """
    light = data.light[indices]
    around = (uniform_filter(light, size=(0, 3, 3), mode="nearest") * np.float32(9.0) - light) / np.float32(8.0)
    return data.camera.noise_variance(around).astype(np.float32)


def add_model_error(variance: Images, light: Images, relative_model_error: float) -> Images:
    """Variance of a model that is still off by `share` of each picture's mean light: coarse fits before fine ones."""
    mean = light.mean(axis=(1, 2), keepdims=True, dtype=np.float64)
    return variance + np.square(relative_model_error * mean).astype(np.float32)


def estimate_prnu(residuals: list[Images], expected: list[Images], usable: list[NDArray[np.bool_]]) -> float:
    """Share (1 σ) by which pixels differ in sensitivity, from two disjoint sets of captures; 0 where they don't.

    residuals, expected, usable: for each set (capture, y, x) counts. For each set the gain of every pixel against the
    model is regressed and its smooth part removed; only what both sets agree on is the camera's own pattern. A wrong
    model errs differently in each capture and drops out.
    """
    maps = [_high_pass_gain(*parts) for parts in zip(residuals, expected, usable, strict=True)]
    known = np.isfinite(maps[0]) & np.isfinite(maps[1])
    if known.sum() < 100:
        return 0.0
    first, second = (m[known] - m[known].mean() for m in maps)
    covariance = float(np.mean(first * second))
    doubt = 5.0 * float(np.std(first) * np.std(second)) / np.sqrt(known.sum())
    return float(np.sqrt(covariance / (1 - 1 / 9))) if covariance > doubt else 0.0


def _high_pass_gain(residual: Images, expected: Images, usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Relative gain of each pixel beyond its surroundings; NaN where too little light fell."""
    e = np.where(usable, expected, 0.0).astype(np.float64)
    power = np.square(e).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = (np.where(usable, residual, 0.0) * e).sum(axis=0) / power
    lit = power > 0.1 * np.median(power[power > 0]) if (power > 0).any() else power > 0
    gain = np.where(lit, gain, 0.0)
    share = uniform_filter(lit.astype(np.float64), 3)
    fine = gain - uniform_filter(gain, 3) / np.maximum(share, 1e-9)
    return np.where(lit, fine, np.nan)
