"""Captures prepared for a comparison with a model: images without black level, usable pixels, variances, fit quality.

If each candidate model were weighted with the variance of its own prediction, candidates that predict more light would
win. All candidates of a comparison therefore share the same weights: from the images themselves (`neighbour_variance`)
while no good model is known, later from the prediction of the best model (`Camera.noise_variance`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, median_filter, minimum_filter, uniform_filter

from holoview.bench.captures.dataset import Camera, Captures
from holoview.light.numerics.sampling import taper

Images = NDArray[np.float32]
Masks = NDArray[np.bool_]

BORDER_PX = 10
"""Pixels at each edge of an image that are masked: light that left the modulator's area isn't modelled well there."""
_DARK_SIGMAS = 5.0  # standard deviations of a dark pixel by which the recorded black level is above 0
_MAX_STUCK_VARIANCE = 0.02  # over the captures, relative to the median of the neighbours, of a dead or hot pixel
_MIN_CAPTURES_FOR_STUCK = 4
_PRNU_SIGNIFICANCE = 5.0  # standard deviations of the covariance of two unrelated maps
_MIN_PRNU_PIXELS = 100
_MIN_RELATIVE_LIGHT = 0.1  # of the median Σ expected² of a pixel; darker pixels don't determine a gain
_PEAK = 15.0  # times the mean power of noise: a power that one in a million frequencies reaches by chance
_FEET = 5  # frequencies in a row, over which the window spreads a peak
_TAPERED = 0.25  # of the picture on each side, over which the window of a spectrum falls to zero
_WINDOW = 3  # pixels, side of the mean that is subtracted as the smooth part of a gain map


@dataclass(frozen=True)
class PreparedCaptures:
    """Captures with their images prepared for a comparison.

    light: (capture, y, x), counts above the nominal black level.
    usable: (capture, y, x), False for pixels that a comparison must leave out.
    """

    captures: Captures
    light: Images
    usable: Masks

    @property
    def camera(self) -> Camera:
        """The camera's data sheet values."""
        return self.captures.camera


@dataclass(frozen=True)
class FitQuality:
    """Quality of a prediction of one or several captures.

    chi2_per_pixel: Σ (residual / σ)² over the number of pixels; 1 where only noise is left. psnr_db: mean PSNR against
    the brightest pixels of each capture.
    """

    chi2_per_pixel: float
    psnr_db: float


def prepare_captures(captures: Captures) -> PreparedCaptures:
    """Subtracts the nominal black level; masks the borders, saturated and stuck pixels, and those that are left out.

    A saturated pixel only gives a lower bound of the light. Its neighbours stay usable: charge of scientific CMOS
    sensors doesn't spill over to them. A pixel that reads 0 only gives an upper bound. Where noise alone can't take it
    there, because the true black level is far below the recorded one, it is masked with its neighbours, of which noise
    decides which ones read 0.
    """
    camera = captures.camera
    light = captures.images.astype(np.float32) - np.float32(camera.black_level)
    usable = captures.images < camera.saturation
    if captures.usable is not None:
        usable &= captures.usable
    if camera.black_level > _DARK_SIGMAS * camera.dark_noise:
        usable &= minimum_filter(captures.images, size=(1, 3, 3)) > 0
    usable &= _border_mask(captures.shape) & ~stuck_pixel_mask(captures.images)
    return PreparedCaptures(captures, light, usable)


def stuck_pixel_mask(images: NDArray[np.uint16]) -> Masks:
    """True for dead, hot and stuck pixels (y, x): they hardly vary over the captures although their neighbours do.

    All False with fewer than four captures, where the variance says too little.
    """
    if len(images) < _MIN_CAPTURES_FOR_STUCK:
        return np.zeros(images.shape[1:], dtype=bool)
    mean = images.mean(axis=0, dtype=np.float64)
    variance = sum(np.square(image - mean) for image in images) / len(images)  # a picture at a time: few of them fit
    return variance < _MAX_STUCK_VARIANCE * median_filter(variance, size=5, mode="nearest")


def _border_mask(shape: tuple[int, int]) -> Masks:
    """True inside the borders, (y, x). A border takes at most a quarter of a small image."""
    inner = np.zeros(shape, dtype=bool)
    y, x = (min(BORDER_PX, n // 4) for n in shape)
    inner[y : shape[0] - y, x : shape[1] - x] = True
    return inner


def neighbour_variance(data: PreparedCaptures, indices: NDArray[np.intp]) -> Images:
    """Variance (counts²) without a model, (capture, y, x): the signal is taken as the mean of the eight neighbours.

    The pixel itself is left out. If its own noise determined its weight, readings that are too low would get more
    weight than readings that are too high, which biases the fit like a wrong black level.
    """
    light = data.light[indices]
    neighbours = (uniform_filter(light, size=(0, 3, 3), mode="nearest") * np.float32(9.0) - light) / np.float32(8.0)
    return data.camera.noise_variance(neighbours)


def add_model_error(variance: Images, light: Images, relative_model_error: float) -> Images:
    """Adds the variance of a model that is still wrong by a fraction of each image's mean light, (capture, y, x).

    σ² + (relative_model_error · ⟨light⟩)². Early fits use it, so that their weights don't pretend that the model is
    exact to the noise.
    """
    mean = light.mean(axis=(1, 2), keepdims=True, dtype=np.float64)
    return variance + np.square(relative_model_error * mean).astype(np.float32)


def estimate_prnu(residuals: list[Images], expected: list[Images], usable: list[NDArray[np.bool_]]) -> float:
    """Photo-response non-uniformity: relative standard deviation of the pixels' sensitivity; 0 where insignificant.

    residuals, expected, usable: for each of two disjoint sets of captures, (capture, y, x), in counts.

    In each set the residuals of every pixel are regressed on its expected signal, and the smooth part of the slopes is
    removed. The covariance of the two maps is the variance of the fixed pattern: errors of the model differ from
    capture to capture and don't correlate. The result is 0 unless the covariance exceeds 5 σ of unrelated maps.
    Frequencies that stand out are left out: sensitivities that differ from pixel to pixel have no preferred frequency,
    but interference fringes, which are no noise, do. σ² of the mean covariance of n independent frequencies with the
    power spectra P₁ and P₂ is ⟨P₁P₂⟩/n.
    """
    maps = [_high_pass_gain(*parts) for parts in zip(residuals, expected, usable, strict=True)]
    known = np.isfinite(maps[0]) & np.isfinite(maps[1])
    if known.sum() < _MIN_PRNU_PIXELS:
        return 0.0
    window = known * np.outer(*(taper(n, _TAPERED) for n in known.shape))
    first, second = (_spectrum(m, window) for m in maps)
    ordinary = _without_peaks((first * second.conj()).real)
    # Unknown pixels scatter a wave over all frequencies; without its peak it is gone from the known pixels.
    first, second = (np.fft.fft2(known * np.fft.ifft2(s * ordinary))[ordinary] for s in (first, second))
    covariance = float((first * second.conj()).real.mean())
    count = np.square(np.square(window).sum()) / np.square(np.square(window)).sum()  # of independent pixels
    threshold = _PRNU_SIGNIFICANCE * float(np.sqrt(np.square(np.abs(first * second)).mean() / count))
    if covariance <= threshold:
        return 0.0
    passed = 1 - 1 / _WINDOW**2  # of the variance of independent pixels, by subtracting the mean of a window
    return float(np.sqrt(covariance / passed))


def _spectrum(values: NDArray[np.float64], window: NDArray[np.float64]) -> NDArray[np.complex128]:
    """The spectrum of a map seen through a window; its mean square is the map's variance."""
    known = window > 0
    centred = np.where(known, values - values[known].mean(), 0.0)
    return np.asarray(np.fft.fft2(window * centred) / np.sqrt(np.square(window).sum()))


def _without_peaks(power: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which values of a spectrum of noise don't stand out: peaks beyond `_PEAK` means of the others, and their feet."""
    ordinary = np.ones(power.shape, dtype=bool)
    while (peaks := ordinary & (np.abs(power) > _PEAK * np.abs(power[ordinary]).mean())).any():
        ordinary &= ~peaks
    return np.asarray(~maximum_filter(~ordinary, _FEET, mode="wrap"))


def _high_pass_gain(residual: Images, expected: Images, usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Relative gain (y, x) of each pixel minus the mean of its neighbourhood; NaN where it got too little light."""
    e = np.where(usable, expected, 0.0).astype(np.float64)
    power = np.square(e).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = (np.where(usable, residual, 0.0) * e).sum(axis=0) / power
    lit = power > _MIN_RELATIVE_LIGHT * np.median(power[power > 0]) if (power > 0).any() else power > 0
    gain = np.where(lit, gain, 0.0)
    lit_fraction = uniform_filter(lit.astype(np.float64), _WINDOW)
    high_pass = gain - uniform_filter(gain, _WINDOW) / np.maximum(lit_fraction, 1e-9)
    return np.where(lit, high_pass, np.nan)
