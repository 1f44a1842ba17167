"""Contrast ratio and sharpness: black beside white, sequential and checkerboard contrast, MTF of edges and line pairs.

The words are those of IEC TR 63145-1-1. Sequential contrast is the luminance of a white picture over that of a black
one; checkerboard contrast that of the white fields over that of the black ones in one picture, so that light that
strays from white to black counts. The modulation transfer function (MTF) is the contrast of a wave in the image over
that in what it should be, by spatial frequency; that of a slanted edge (ISO 12233) is the spectrum of the edge's
derivative, sampled more finely than the image because each row crosses the edge elsewhere.

Standard errors. A mean luminance is known by the scatter between 8 × 8 blocks (`grains.error_by_blocks`), and a ratio
of two by both, which hold other grains. The frequency at which the MTF of an edge is a half is known by a jackknife
over groups of neighbouring rows (`_half_error_of_rows`), that of a picture's MTF by the speckle that is left of it
(`_half_error`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.grains import error_by_blocks
from holoview.light.numerics.sampling import Region, region_slices
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

_DARK, _BRIGHT, _LEAST_SAMPLES = 0.01, 0.5, 64
_BINS = 4  # of an edge's profile a sample
_LEAST_SIDE = 16
_PASSES = 3  # of finding the edge
_LEAST_STEP, _LEAST_ERRORS = 0.5, 8.0
"""Difference of two tones over their standard deviation and, of independent samples, over its own standard error."""
_LEAST_STRUCTURE = 1e-5  # r.m.s. of a target over its mean: single precision has less
_MOST_UNSURE = 0.05  # standard error of an MTF that is stated
_STRAIGHT = 2.0  # samples r.m.s. that its centroids may be from a line
_GROUPS, _LEAST_ROWS = 16, 4  # of rows, by whose absence an MTF is tried; rows of a group
_BESIDE = 0.7, 1.3  # of the frequency at which it is a half
_FLATTEST, _STEEPEST = np.tan(np.deg2rad(1.0)), np.tan(np.deg2rad(40.0))


@dataclass(frozen=True)
class BlackBesideWhite:
    """Mean luminances where a target is bright and where it is dark in one image.

    samples: of the dark part. relative_error: standard error of the ratio over it; infinite where black has no light.
    """

    white: float
    black: float
    samples: int
    relative_error: float

    @property
    def ratio(self) -> float:
        """Luminance of white over that of black; inf where black has none."""
        return self.white / self.black if self.black > 0 else float("inf")

    @property
    def standard_error(self) -> float | None:
        """Standard error of the ratio; None where black has no light."""
        return self.ratio * self.relative_error if self.black > 0 else None

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        ratio = self.ratio if np.isfinite(self.ratio) else None
        found = {"white": self.white, "black": self.black, "ratio": ratio, "standard_error": self.standard_error}
        return found | {"dark_samples": self.samples}


def black_beside_white(luminance: NDArray[np.floating], target: NDArray[np.floating]) -> BlackBesideWhite | None:
    """Of an image (y, x) and the luminance (y, x) of its target: dark is below 1 %, bright above 50 % of its maximum.

    None where the target has fewer than 64 samples of either. For the standard error, the structure that the target has
    where it is bright is taken off.
    """
    most = float(target.max())
    dark, bright = target <= _DARK * most, target >= _BRIGHT * most
    if not most > 0 or min(dark.sum(), bright.sum()) < _LEAST_SAMPLES:
        return None
    values = np.asarray(luminance, dtype=np.float64)
    white, black = float(values[bright].mean()), float(values[dark].mean())
    even = values - white * (target / target[bright].mean() - 1) if white > 0 else values
    error = math.hypot(_relative_error(even, bright), _relative_error(values, dark))
    return BlackBesideWhite(white, black, int(dark.sum()), error)


def _relative_error(values: Floats, counted: NDArray[np.bool_]) -> float:
    """Standard error of the mean of the counted values (y, x), over it; infinite of one that isn't above 0."""
    mean = float(values[counted].mean())
    if not mean > 0:
        return math.inf
    return error_by_blocks(np.where(counted, values / mean - 1, 0.0)) / int(counted.sum())


def checkerboard(shape: tuple[int, int], fields: int = 4) -> Floats:
    """A checkerboard (y, x) of `fields` × `fields` fields of 0 and 1; the field at the upper left is white."""
    y, x = (np.arange(n) * fields // n for n in shape)
    return ((y[:, None] + x[None, :] + 1) % 2).astype(np.float64)


@dataclass(frozen=True)
class ContrastRatio:
    """A ratio of two mean luminances, and its standard error."""

    value: float
    standard_error: float


def sequential_contrast(white: NDArray[np.floating], black: NDArray[np.floating]) -> ContrastRatio:
    """Mean luminance of a white picture (y, x) over that of a black one. Errors as of `contrast_ratio`."""
    return _ratio_of(white, black, np.ones(white.shape, dtype=bool), np.ones(black.shape, dtype=bool))


def checkerboard_contrast(luminance: NDArray[np.floating], fields: int = 4) -> ContrastRatio:
    """Mean luminance of the white fields over that of the black ones, in the middle halves of the fields.

    luminance: (y, x) of an image of `checkerboard`. Raises UserError for one that is dark, or without black light.
    """
    middle = np.ones(luminance.shape, dtype=bool)
    for axis, n in enumerate(luminance.shape):
        place = (np.arange(n) + 0.5) * fields / n % 1
        middle &= np.expand_dims((place > 0.25) & (place < 0.75), 1 - axis)
    white = checkerboard((luminance.shape[0], luminance.shape[1]), fields) > 0.5
    return _ratio_of(luminance, luminance, white & middle, ~white & middle)


def _ratio_of(
    white: NDArray[np.floating],
    black: NDArray[np.floating],
    is_white: NDArray[np.bool_],
    is_black: NDArray[np.bool_],
) -> ContrastRatio:
    value = contrast_ratio(white[is_white], black[is_black])
    parts = ((np.asarray(of, dtype=np.float64), where) for of, where in ((white, is_white), (black, is_black)))
    return ContrastRatio(value, value * math.hypot(*(_relative_error(of, where) for of, where in parts)))


def contrast_ratio(white: NDArray[np.floating], black: NDArray[np.floating]) -> float:
    """Mean luminance of white over that of black. Raises UserError where either has no light: it isn't defined."""
    means = float(np.mean(white, dtype=np.float64)), float(np.mean(black, dtype=np.float64))
    if not min(means) > 0:
        raise UserError("contrast ratio", f"luminances {means[0]:g} and {means[1]:g}", expected="both above 0")
    return means[0] / means[1]


@dataclass(frozen=True, eq=False)
class Mtf:
    """A modulation transfer function.

    cycles: (n,) spatial frequencies, cycles a sample. values: (n,), 1 at frequency 0. angle_deg: of the edge from the
    rows or columns; NaN without one. half_error: standard error of `half`; NaN where it isn't known.
    """

    cycles: Floats
    values: Floats
    angle_deg: float
    half_error: float = math.nan

    def at(self, cycles: float) -> float:
        """The MTF at a frequency in cycles a sample, interpolated."""
        return float(np.interp(cycles, self.cycles, self.values))

    @property
    def half(self) -> float:
        """Lowest frequency at which it falls to a half; NaN where it doesn't."""
        below = np.flatnonzero(self.values < 0.5)
        if not below.size or below[0] == 0:
            return float("nan")
        i = int(below[0])
        step = (self.values[i - 1] - 0.5) / (self.values[i - 1] - self.values[i])
        return float(self.cycles[i - 1] + step * (self.cycles[i] - self.cycles[i - 1]))

    def as_json(self, degrees_per_sample: float | None) -> dict[str, Any]:
        """For programs; by the degree of visual angle where there is an eye."""
        half = self.half if np.isfinite(self.half) else None
        return {
            "angle_deg": self.angle_deg if np.isfinite(self.angle_deg) else None,
            "half_cycles_a_sample": half,
            "half_cycles_a_degree": None if half is None or degrees_per_sample is None else half / degrees_per_sample,
            "half_standard_error": self.half_error if half is not None and math.isfinite(self.half_error) else None,
            "cycles_a_sample": self.cycles.tolist(),
            "mtf": self.values.tolist(),
        }


def slanted_edge_mtf(image: NDArray[np.floating], region: Region) -> Mtf:
    """The MTF across a slanted edge that divides a region (x, y, width, height) of an image (y, x).

    The edge is found row by row as the centroid of the derivative around a line that is fitted three times; the profile
    across it is averaged in bins of a quarter of a sample, whose width and derivative are corrected. Raises UserError
    for a region that is too small, and for one without an edge at 1 to 40 degrees from its rows or columns.
    """
    values = np.asarray(image[region_slices(region)], dtype=np.float64)
    if min(values.shape) < _LEAST_SIDE:
        raise UserError(
            "--edge", f"{region[2]} × {region[3]} samples", expected=f"{_LEAST_SIDE} × {_LEAST_SIDE} or more"
        )
    slopes = [abs(float(np.diff(values, axis=axis).mean(axis=axis).mean())) for axis in (0, 1)]
    values = values if slopes[1] >= slopes[0] else values.T
    rows, columns = np.indices(values.shape)
    slope, start = _edge_line(values)
    distance = (columns - start - slope * rows) / np.hypot(1.0, slope)
    tones = values[distance < 0], values[distance > 0]
    step, noise = abs(tones[0].mean() - tones[1].mean()), math.hypot(tones[0].std(), tones[1].std()) / math.sqrt(2)
    if step < max(_LEAST_STEP, _LEAST_ERRORS * math.sqrt(sum(1 / len(tone) for tone in tones))) * noise:
        found = f"tones that differ by {step / noise:.2g} of their own standard deviation"
        raise UserError("--edge", found, expected="a straight edge between two even tones")
    mtf = _mtf_of_profile(values, distance, float(np.degrees(np.arctan(abs(slope)))))
    return replace(mtf, half_error=_half_error_of_rows(mtf, values, distance))


def _half_error_of_rows(mtf: Mtf, values: Floats, distance: Floats) -> float:
    """Standard error of the frequency at which the MTF of an edge is a half, from an image (y, x) and its distances.

    Each of up to 16 groups of neighbouring rows is left out in turn. The scatter of the MTF at that frequency, times
    the root of the number of groups less 1 (jackknife), is divided by its slope from 0.7 to 1.3 of the frequency, since
    the slope between two neighbouring frequencies is mostly noise. NaN where the MTF isn't a half, or doesn't fall.
    """
    half, count = mtf.half, min(_GROUPS, len(values) // _LEAST_ROWS)
    fall = mtf.at(_BESIDE[0] * half) - mtf.at(_BESIDE[1] * half)
    if not fall > 0:
        return math.nan
    group = np.arange(len(values)) * count // len(values)
    tried = [_mtf_of_profile(values[group != k], distance[group != k], 0.0).at(half) for k in range(count)]
    return float(np.std(tried)) * math.sqrt(count - 1) * (_BESIDE[1] - _BESIDE[0]) * half / fall


def _edge_line(values: Floats) -> tuple[float, float]:
    """Slope and start of the edge x = start + slope·y in an image (y, x). Raises UserError without one."""
    derivative = np.diff(values, axis=1)
    if abs(derivative.sum()) < 0.2 * np.abs(derivative.mean(axis=0)).sum() or not derivative.any():
        raise UserError("--edge", "no edge between two tones", expected="a region that a slanted edge divides")
    derivative = derivative * np.sign(derivative.sum())
    x, y = np.arange(derivative.shape[1]) + 0.5, np.arange(len(values))
    slope, start, width = 0.0, float(x @ derivative.sum(axis=0) / derivative.sum()), float(values.shape[1])
    for _ in range(_PASSES):
        away = x[None, :] - (start + slope * y[:, None])
        weights = derivative * np.where(np.abs(away) < width / 2, np.cos(np.pi * away / width) ** 2, 0.0)
        sums = weights.sum(axis=1)
        clear = sums > 0.1 * np.median(np.maximum(sums, 0.0))
        if clear.sum() < len(values) / 2:
            raise UserError("--edge", "no edge in most rows", expected="a region that a slanted edge divides")
        centroids = (weights @ x)[clear] / sums[clear]
        slope, start = (float(of) for of in np.polyfit(y[clear], centroids, 1))
        residual = float(np.std(centroids - start - slope * y[clear]))
        width = max(width / 2, 12.0)
    if residual > _STRAIGHT:
        found = f"an edge that strays by {residual:.2g} samples from a line"
        raise UserError("--edge", found, expected="a straight edge between two even tones")
    if not _FLATTEST <= abs(slope) <= _STEEPEST:
        found = f"an edge at {np.degrees(np.arctan(abs(slope))):.2g} degrees"
        raise UserError("--edge", found, expected="1 to 40 degrees from the rows or columns")
    return slope, start


def _mtf_of_profile(values: Floats, distance: Floats, angle_deg: float) -> Mtf:
    """The spectrum of the derivative of the profile of an image (y, x) at distances (y, x) from its edge."""
    half = int(min(-distance.min(), distance.max(), values.shape[1] / 2)) * _BINS
    bins = np.floor(distance * _BINS).astype(int) + half
    inside = (bins >= 0) & (bins < 2 * half)
    counts = np.bincount(bins[inside], minlength=2 * half)
    sums = np.bincount(bins[inside], values[inside], minlength=2 * half)
    known = counts > 0
    profile = np.interp(np.arange(2 * half), np.flatnonzero(known), sums[known] / counts[known])
    spread = np.diff(profile) * np.hanning(2 * half + 1)[1:-1]
    spectrum = np.abs(np.fft.rfft(spread))
    cycles: Floats = np.asarray(np.fft.rfftfreq(len(spread), 1 / _BINS), dtype=np.float64)
    kept = cycles <= 1.0
    corrections = np.sinc(cycles[kept] / _BINS) ** 2  # for the width of a bin, and the difference of two
    transfer: Floats = np.asarray(spectrum[kept] / spectrum[0] / corrections, dtype=np.float64)
    return Mtf(cycles[kept], transfer, angle_deg)


def target_mtf(image: NDArray[np.floating], target: NDArray[np.floating], region: Region) -> Mtf:
    """The MTF of a region of an image (y, x) whose target (y, x) is known, a picture of any content.

    With the spectra X of the target and Y of the image, both over their means and under a Hann window, it is
    Σ Re(Y·X*)/Σ|X|² over rings of frequency: speckle, which doesn't follow the target, cancels. It ends where the
    target has too little of a frequency to know it within 0.05 (one standard error). Raises UserError for a region of
    less than 16 × 16 samples, one without light or structure, and a picture that doesn't follow the target.
    """
    x, y = (np.asarray(of[region_slices(region)], dtype=np.float64) for of in (target, image))
    if min(x.shape) < _LEAST_SIDE or not (x.mean() > 0 and y.mean() > 0):
        found = (
            f"{region[2]} × {region[3]} samples of mean {x.mean():.2g} in the target and {y.mean():.2g} in the image"
        )
        raise UserError("MTF", found, expected=f"{_LEAST_SIDE} × {_LEAST_SIDE} or more, with light")
    if not x.std() > _LEAST_STRUCTURE * x.mean():
        raise UserError("MTF", "no structure in the target here", expected="a region with detail")
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in x.shape))
    wanted, seen = (np.fft.rfft2(window * (of / np.average(of, weights=window) - 1)) for of in (x, y))
    cycles = np.hypot(np.fft.fftfreq(x.shape[0])[:, None], np.fft.rfftfreq(x.shape[1]))
    width = 3 / min(x.shape)  # of a ring; a line under the window is 2/n wide
    ring = np.rint(cycles / width).astype(int).ravel()
    power, product = (np.square(np.abs(wanted)).ravel(), (seen * wanted.conj()).real.ravel())
    powers = np.bincount(ring, power)
    values = np.bincount(ring, product) / np.maximum(powers, 1e-300)
    errors = np.sqrt(np.bincount(ring, np.square(product - values[ring] * power))) / np.maximum(powers, 1e-300)
    known = (powers > 1e-12 * powers.max()) & (errors <= _MOST_UNSURE)
    inside = np.arange(len(values)) * width <= 0.5
    count = int(np.argmin(np.append((known & inside)[1:], False)))  # rings from the first to the last in a row
    if not count:
        raise UserError(
            "MTF", "the picture doesn't follow the target here", expected="a region of the target's picture"
        )
    mtf = Mtf(np.arange(count + 1) * width, np.append(1.0, values[1 : count + 1]), float("nan"))
    below = np.flatnonzero(mtf.values < 0.5)
    if not below.size:
        return mtf
    last = int(below[0])
    upper, lower = mtf.values[last - 1 : last + 1]
    weights = np.zeros(len(powers))  # of rings in `half`, by its derivatives
    weights[last - 1 : last + 1] = np.array([0.5 - lower, upper - 0.5]) * width / (upper - lower) ** 2
    weights[0] = 0.0  # where the MTF is 1 by definition
    filtered = wanted * (weights / np.maximum(powers, 1e-300))[ring].reshape(cycles.shape)
    rest = seen - np.interp(cycles, mtf.cycles, mtf.values) * wanted
    return replace(mtf, half_error=_half_error(filtered, rest, window * x / x.mean()))


def _half_error(filtered: NDArray[np.complex128], rest: NDArray[np.complex128], light: NDArray[np.floating]) -> float:
    """Standard error of Σ Re(R·H*) over the half plane of frequencies, R being speckle in proportion to the light.

    filtered: H (y, x), spectrum of real numbers h. rest: R (y, x). light: l (y, x), under the window. With speckle l·n
    of independent n of variance s, E|R|² = s·Σl², and of N samples the sum has the variance s·Σ(l·h)²·(N/2)². s
    follows from |R|² where H isn't 0, so that the spectrum of speckle need only be even there.
    """
    used = filtered != 0
    variance = float(np.square(np.abs(rest[used])).mean()) / float(np.square(light).sum())
    doubled = filtered.copy()
    doubled[:, 0] *= 2  # which has no mirrored column
    values = np.fft.irfft2(doubled, light.shape)
    return math.sqrt(variance) * float(np.linalg.norm(light * values)) * light.size / 2


def line_pair_transfer(
    image: NDArray[np.floating], target: NDArray[np.floating], cycles: float, axis: int = 1
) -> float:
    """The MTF of line pairs of a frequency (cycles a sample) along an axis: contrast of the image over the target's.

    Both are (y, x), cut to whole periods along the axis.
    """
    n = round(int(image.shape[axis] * cycles) / cycles)
    wave = np.exp(-2j * np.pi * cycles * np.arange(n))

    def contrast(of: NDArray[np.floating]) -> float:
        line = np.asarray(of, dtype=np.float64).mean(axis=1 - axis)[:n]
        return float(abs(wave @ line) / max(float(line.sum()), 1e-300))

    known = contrast(target)
    if not known > 0:
        raise UserError("line pairs", "none of this frequency in the target", expected="a target that holds them")
    return contrast(image) / known


def circular_pupil_mtf(relative: NDArray[np.floating]) -> Floats:
    """The MTF of incoherent light through a circular pupil, at frequencies over the cut-off D/λ (Goodman, *Introduction
    to Fourier Optics*, 2005, section 6.3)."""
    ν = np.clip(np.asarray(relative, dtype=np.float64), 0.0, 1.0)
    return np.asarray(2 / np.pi * (np.arccos(ν) - ν * np.sqrt(1 - ν**2)))


def square_pupil_mtf(relative: NDArray[np.floating]) -> Floats:
    """The MTF of incoherent light through a square pupil along its sides, at frequencies over the cut-off."""
    return np.clip(1.0 - np.asarray(relative, dtype=np.float64), 0.0, 1.0)
