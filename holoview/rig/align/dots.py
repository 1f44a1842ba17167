"""Finds dots in pictures: the brightest one, or many whose places are roughly known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Image = NDArray[np.float64]
_SIGMA_OF_WIDTH = 0.4  # of the Gaussian that is most like the core of a diffraction-limited dot
_ROUNDS = 4
_MAD = 1.4826  # standard deviation over median absolute deviation, of normal noise


@dataclass(frozen=True)
class FoundDots:
    """position_px: (dot, 2), NaN where there is none. contrast: height over the noise of the background."""

    position_px: NDArray[np.float64]
    contrast: NDArray[np.float64]


def brightest_dot(change: Image, width_px: float) -> tuple[NDArray[np.float64], float]:
    """Place (y, x) of the brightest dot in a picture less one without it, and its height over the noise."""
    smooth = gaussian_filter(change, max(_SIGMA_OF_WIDTH * width_px, 0.5))
    peak = np.array(np.unravel_index(int(smooth.argmax()), smooth.shape), dtype=np.float64)
    above = smooth - np.median(smooth)
    noise = _MAD * float(np.median(np.abs(above)))
    return peak, float(above.max() / max(noise, 1e-30))


def find_dots(picture: Image, expected_px: NDArray[np.float64], width_px: float, reach_px: float) -> FoundDots:
    """Dots near expected places (dot, 2), each by its centroid, weighted by a Gaussian of the dot's size.

    width_px: of a dot. reach_px: how far a dot may be from where it is expected. One that reaches the edge of the
    picture or of its reach isn't found.
    """
    sigma = max(_SIGMA_OF_WIDTH * width_px, 0.7)
    smooth = gaussian_filter(picture, sigma)
    median = float(np.median(picture))
    noise = _MAD * float(np.median(np.abs(smooth - median))) + 1e-30
    found = [_find_dot(picture, smooth, place, sigma, reach_px) for place in expected_px]
    heights = [smooth[tuple(np.rint(p).astype(int))] - median if np.isfinite(p).all() else 0.0 for p in found]
    return FoundDots(np.array(found).reshape(-1, 2), np.array(heights) / noise)


def _find_dot(
    picture: Image, smooth: Image, place: NDArray[np.float64], sigma: float, reach_px: float
) -> NDArray[np.float64]:
    """The place (y, x) of one dot, NaN if there is none."""
    nothing, shape = np.full(2, np.nan), np.array(picture.shape)
    margin = 3 * sigma
    low = np.maximum(np.ceil(place - reach_px), 0).astype(int)
    high = np.minimum(np.floor(place + reach_px), shape - 1).astype(int)
    if (high - low < 2).any():
        return nothing
    window = smooth[low[0] : high[0] + 1, low[1] : high[1] + 1]
    place = np.array(np.unravel_index(int(window.argmax()), window.shape), dtype=np.float64) + low
    if (place <= low).any() or (place >= high).any():
        return nothing
    for _ in range(_ROUNDS):
        if (place < margin).any() or (place > shape - 1 - margin).any():
            return nothing
        place = _centroid(picture, place, sigma, margin)
    return place


def _centroid(picture: Image, place: NDArray[np.float64], sigma: float, margin: float) -> NDArray[np.float64]:
    """One step of the weighted centroid.

    Of a Gaussian dot of the weight's own size the step goes half of the way, so that it is doubled.
    """
    low, high = (np.rint(place + side * margin).astype(int) for side in (-1, 1))
    part = picture[low[0] : high[0] + 1, low[1] : high[1] + 1]
    y, x = (np.arange(a, b + 1) - p for a, b, p in zip(low, high, place, strict=True))
    edge = np.concatenate([part[0], part[-1], part[:, 0], part[:, -1]])
    weight = np.exp(-(y[:, None] ** 2 + x[None, :] ** 2) / (2 * sigma**2)) * np.maximum(part - np.median(edge), 0.0)
    total = float(weight.sum())
    if total <= 0:
        return np.full(2, np.nan)
    step = np.array([(weight.sum(axis=1) * y).sum(), (weight.sum(axis=0) * x).sum()]) / total
    return np.asarray(place + 2 * np.clip(step, -sigma, sigma))
