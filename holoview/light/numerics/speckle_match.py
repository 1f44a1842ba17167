"""Whether the speckle of a predicted picture stands in a measured picture: correlation of local contrasts over shifts.

The local contrast of a picture I with local mean m is I/(I + m), between 0 and 1: neither brightness, nor stray light
that varies slowly, nor a few saturated pixels change it much, while each bright and dark grain counts. Where a model
misses the light's phases, the predicted grains stand elsewhere, and no correlation is left, however alike the envelopes
are. A least-squares comparison prefers whatever smooths the prediction then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import gaussian_filter

Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]

LOCAL_MEAN_PX = 12.0
"""Standard deviation of the Gaussian window of the local mean, pixels: several grains wide."""
_NEAR_GRAINS = 6.0  # half widths of a grain around the peak that don't count as its surroundings


@dataclass(frozen=True)
class SpeckleMatch:
    """How well predicted speckle stands in a picture.

    correlation: the greatest correlation coefficient of local contrasts over the shifts that were tried, −1 … 1.
    significance: how many standard deviations of the correlations at other shifts it lies above their mean.
    shift: (y, x) by which the prediction has to move, pixels.
    """

    correlation: float
    significance: float
    shift: tuple[int, int]


def local_mean(light: NDArray[np.floating], usable: Masks, mean_px: float = LOCAL_MEAN_PX) -> Floats:
    """The mean (y, x) of the usable pixels around each pixel. mean_px: standard deviation of the window."""
    share = np.maximum(gaussian_filter(usable.astype(np.float64), mean_px), 1e-6)
    return np.asarray(gaussian_filter(np.where(usable, light, 0.0).astype(np.float64), mean_px) / share)


def local_contrast(picture: NDArray[np.floating], usable: Masks, mean_px: float = LOCAL_MEAN_PX) -> Floats:
    """I/(I + local mean) of a picture (y, x), in which pixels that aren't usable count as their surroundings.

    mean_px: standard deviation of the local mean's window.
    """
    light = np.where(usable, np.maximum(picture, 0.0), 0.0).astype(np.float64)
    mean = local_mean(light, usable, mean_px)
    floor = 1e-6 * max(float(mean.max()), 1e-30)
    return np.where(usable, light / (light + mean + floor), 0.5)


def match_speckle(
    measured: NDArray[np.floating],
    predicted: NDArray[np.floating],
    usable: Masks,
    *,
    reach_px: int,
    around_px: int,
    mean_px: float = LOCAL_MEAN_PX,
) -> SpeckleMatch:
    """The match of two pictures (y, x) of equal shape.

    usable: pixels of the measured picture that count. reach_px: shifts among which the peak is sought; around_px: those
    that tell what chance gives, larger than the reach; less than the picture's shorter side of them is used.
    """
    around_px = min(around_px, min(measured.shape) - 1)
    contrast = local_contrast(measured, usable, mean_px)
    count = max(int(usable.sum()), 1)
    a = np.where(usable, contrast - contrast[usable].mean(), 0.0)
    everywhere = np.ones_like(usable)
    b = local_contrast(predicted, everywhere, mean_px)
    b = b - b[usable].mean()
    size = [next_fast_len(n + around_px, real=True) for n in a.shape]
    spectra = [rfft2(part, size) for part in (a, usable.astype(np.float64), b, b * b)]
    products = [
        irfft2(first * np.conj(second), size)
        for first, second in ((spectra[0], spectra[2]), (spectra[1], spectra[2]), (spectra[1], spectra[3]))
    ]
    numerator, sums, squares = (_central(product, around_px) for product in products)
    variance = np.maximum(squares - sums**2 / count, 0.2 * float(squares.max()))
    correlations = numerator / np.sqrt(max(float((a * a).sum()), 1e-30) * np.maximum(variance, 1e-30))
    y, x = np.mgrid[-around_px : around_px + 1, -around_px : around_px + 1]
    within = np.maximum(np.abs(y), np.abs(x)) <= reach_px
    peak = np.unravel_index(int(np.where(within, correlations, -np.inf).argmax()), correlations.shape)
    half_width = grain_px(contrast, usable)
    others = correlations[np.hypot(y - y[peak], x - x[peak]) > _NEAR_GRAINS * half_width]
    spread = float(others.std()) if others.size > 8 else np.inf
    significance = (float(correlations[peak]) - float(others.mean() if others.size else 0.0)) / max(spread, 1e-12)
    return SpeckleMatch(float(correlations[peak]), significance, (int(y[peak]), int(x[peak])))


def _central(correlation: Floats, reach: int) -> Floats:
    """The lags −reach … reach of a circular correlation, lag 0 in the middle; 0 where the picture is smaller."""
    rolled = np.roll(correlation, (reach, reach), (0, 1))
    return rolled[: 2 * reach + 1, : 2 * reach + 1]


def grain_px(contrast: Floats, usable: Masks) -> float:
    """Lag at which the autocorrelation of a picture's local contrast falls to a half, mean of rows and columns, pixels.

    contrast: (y, x), of `local_contrast`.
    """
    a = np.where(usable, contrast - contrast[usable].mean(), 0.0) if usable.any() else np.zeros_like(contrast)
    widths = []
    for axis in (0, 1):
        moved = np.moveaxis(a, axis, 0)
        whole = float((moved * moved).sum())
        last = 1.0
        for lag in range(1, max(2, len(moved) // 2)):
            value = float((moved[lag:] * moved[:-lag]).sum()) / max(whole, 1e-30)
            if value < 0.5:
                widths.append(lag - (0.5 - value) / max(last - value, 1e-12))
                break
            last = value
        else:
            widths.append(float(len(moved) // 2))
    return float(np.mean(widths))
