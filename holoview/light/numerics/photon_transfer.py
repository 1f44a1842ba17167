"""Photon transfer: how many photo-electrons make a count, and the read noise, from pictures themselves.

The variance of a pixel's noise rises with its light s, σ² = r² + s/g, with g electrons a count and a read noise of r
counts (Janesick, Photon Transfer, SPIE 2007). Noise is what differs between two pictures of the same light. In a single
picture it is what is left at the highest spatial frequencies, which speckle that spans some pixels hardly reaches: a
fourth difference along rows and columns passes it. What speckle leaves there grows with the square of the light, so
that a third term, c·s², holds it; where that term isn't much smaller than the noise, nothing is told.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, minimum_filter, uniform_filter

Floats = NDArray[np.float64]
Masks = NDArray[np.bool_]

_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / math.sqrt(70)  # of white noise it keeps the variance
_FINER = np.array([1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0]) / math.sqrt(924)  # the sixth, likewise
_MOST_COLOUR = 1.2  # of the variances after both differences, which are equal for white noise
_MOST_NOISE = 0.2  # of the pictures' variance: else speckle is finer than the pixels, and white too
_LEVELS = 24  # groups of pixels of equal light
_LEAST_PX = 200  # pixels in a group
_MOST_LEAK = 0.5  # of speckle, over the shot noise, of the brighter half of the groups
_MOST_ERROR = 0.3  # standard deviation of g, over g


@dataclass(frozen=True)
class PhotonTransfer:
    """Electrons a count with its relative standard deviation, and the read noise in counts r.m.s."""

    electrons_per_count: float
    relative_error: float
    read_noise_counts: float


def transfer_of_pictures(lights: Sequence[Floats], usable: Sequence[Masks]) -> PhotonTransfer | None:
    """From the highest frequencies of pictures (y, x) in counts above black; None where they don't tell.

    usable: of each picture, pixels that aren't saturated or left out.
    """
    samples, coarse, fine = [], 0.0, 0.0
    for light, counts in zip(lights, usable, strict=True):
        noise = convolve1d(convolve1d(light, _DIFFERENCE, axis=0), _DIFFERENCE, axis=1)
        inside = minimum_filter(counts, size=7, mode="constant", cval=0)
        own = convolve1d(convolve1d(light, _DIFFERENCE**2, axis=0), _DIFFERENCE**2, axis=1)  # light of that variance
        finer = convolve1d(convolve1d(light, _FINER, axis=0), _FINER, axis=1)
        coarse, fine = coarse + float(np.square(noise[inside]).sum()), fine + float(np.square(finer[inside]).sum())
        samples.append((uniform_filter(light, 5)[inside], own[inside], np.square(noise[inside])))
    variance = sum(float(light[counts].var() * counts.sum()) for light, counts in zip(lights, usable, strict=True))
    if coarse > _MOST_COLOUR * fine or coarse > _MOST_NOISE * variance:
        return None
    around, light_of, squared = (np.concatenate(values) for values in zip(*samples, strict=True))
    return _fit(around, light_of, squared, 3)


def transfer_of_repeats(first: Floats, second: Floats, usable: Masks) -> PhotonTransfer | None:
    """From two pictures (y, x) of the same light in counts above black, but for its power; None where they differ in
    more than noise."""
    factor = float(first[usable].sum() / max(second[usable].sum(), 1e-30))
    if not 0.5 < factor < 2:
        return None
    light = (first + factor * second) / 2
    difference = np.square(first - factor * second) / (1 + factor)  # of variance s/g + r² (1 + f²)/(1 + f)
    read_share = (1 + factor**2) / (1 + factor)
    return _fit(uniform_filter(light, 5)[usable], light[usable], difference[usable], 2, read_share)


def _fit(around: Floats, light: Floats, squared: Floats, terms: int, read_share: float = 1.0) -> PhotonTransfer | None:
    """σ² = r² + s/g + c·s², or its first terms, weighted, from squares of noise at pixels of light s.

    around: light around each pixel, by which they are grouped: not by their own noise. read_share: factor of r².
    """
    if len(light) < _LEVELS * _LEAST_PX:
        return None
    low, high = np.quantile(around, (0.02, 0.999))
    group = np.searchsorted(np.geomspace(max(float(low), 0.5), max(float(high), 1.0), _LEVELS), around)
    counts = np.bincount(group, minlength=_LEVELS + 1)
    kept = counts >= _LEAST_PX
    if kept.sum() < 5:
        return None
    mean = (np.bincount(group, light, minlength=_LEVELS + 1) / np.maximum(counts, 1))[kept]
    variance = (np.bincount(group, squared, minlength=_LEVELS + 1) / np.maximum(counts, 1))[kept]
    columns = np.stack([np.ones_like(mean), mean, mean**2])
    fitted = np.maximum(variance, 1 / 12)
    for _ in range(4):  # squares of noise scatter by √2 of their mean
        weight = np.sqrt(counts[kept] / 2) / fitted
        free = list(range(terms))
        while True:
            design = (columns[free] * weight).T
            solution, *_ = np.linalg.lstsq(design, variance * weight, rcond=None)
            negative = [k for k, value in zip(free, solution, strict=True) if value < 0]
            if not negative:
                break
            free.remove(negative[-1])
            if not free:
                return None
        fitted = np.maximum(solution @ columns[free], 1e-3)
    found = dict(zip(free, solution.tolist(), strict=True))
    slope, leak = found.get(1, 0.0), found.get(2, 0.0)
    if slope <= 0:
        return None
    residual = max(1.0, float(np.mean(np.square((variance - fitted) * weight))))
    error = math.sqrt(residual * np.linalg.inv(design.T @ design)[free.index(1), free.index(1)]) / slope
    bright = mean >= np.median(mean)
    if error > _MOST_ERROR or float((leak * mean[bright] / slope).mean()) > _MOST_LEAK:
        return None
    return PhotonTransfer(1 / slope, error, math.sqrt(max(found.get(0, 0.0) / read_share - 1 / 12, 0.0)))
