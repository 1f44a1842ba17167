"""How well a prediction fits held-out captures: χ²/n and PSNR, and the pixels that hold the excess, by wavelength,
plane, roughness of the pattern, radius, spatial frequency and brightness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.prepared_captures import FitQuality
from holoview.bench.diagnose.likelihood import Comparison, GainFit
from holoview.light.numerics.speckle_match import match_speckle
from holoview.util.units import format_rounded

Image = NDArray[np.float32]
Floats = NDArray[np.float64]

SAMPLES = 4
"""[captures] Held-out captures that are shown. Evidence: presentation only."""

PEAK_QUANTILE = 0.999
"""[1] Quantile of a capture's light that PSNR takes as its peak. Evidence: a definition; single hot pixels don't
count."""

FREQUENCY_BANDS = 4
"""[1] Bands of spatial frequency up to the camera's Nyquist frequency. Evidence: presentation only."""

_SPECKLE_AROUND_PX = 40  # [px] Of the shifts whose correlations tell what chance gives. Evidence: presentation only.

RADII = (0.25, 0.5, 0.75)
"""[1] Limits between classes of radius, over the distance of the corners. Evidence: presentation only."""

BRIGHTNESS = (0.5, 1.0, 2.0)
"""[1] Limits between classes of expected light, over its mean. Evidence: presentation only."""


@dataclass(frozen=True)
class HeldOutGroup:
    """Quality on held-out captures of one wavelength and plane, by the nominal and the extended model."""

    wavelength_m: float
    distance_m: float
    before: FitQuality
    after: FitQuality


@dataclass(frozen=True, eq=False)
class SampleCapture:
    """A held-out capture to show; images are (y, x), pairs by the nominal and the extended model.

    light: counts above black. predicted: expected counts. residual: in σ.
    """

    capture: int
    wavelength_m: float
    distance_m: float
    light: Image
    predicted: tuple[Image, Image]
    residual: tuple[Image, Image]


def fit_quality(comparison: Comparison, fitted: GainFit, mask: NDArray[np.bool_] | None = None) -> FitQuality:
    """χ²/n and mean PSNR of the captures of a mask (capture,), or of all."""
    chosen = np.ones(len(comparison.indices), dtype=bool) if mask is None else mask
    chi2 = fitted.squares[chosen].sum() / max(comparison.pixels_per_capture[chosen].sum(), 1.0)
    return FitQuality(float(chi2), float(_psnr(comparison, fitted)[chosen].mean()))


def _psnr(comparison: Comparison, fitted: GainFit) -> NDArray[np.float64]:
    """PSNR (dB) of each capture against a quantile of its light."""
    errors = comparison.residual_counts(fitted)
    mean_square = np.square(errors, dtype=np.float64).sum((1, 2)) / np.maximum(comparison.pixels_per_capture, 1.0)
    usable = comparison.weight > 0
    peak = np.array([np.quantile(light[u], PEAK_QUANTILE) for light, u in zip(comparison.light, usable, strict=True)])
    return 10 * np.log10(np.maximum(peak, 1e-9) ** 2 / np.maximum(mean_square, 1e-12))


def explained_variance(comparison: Comparison, fitted: GainFit) -> float:
    """Share of the images' variance that a prediction explains."""
    usable = comparison.weight > 0
    spread = [float(light[u].var() * u.sum()) for light, u in zip(comparison.light, usable, strict=True)]
    errors = comparison.residual_counts(fitted)
    return 1.0 - float(np.square(errors, dtype=np.float64).sum() / max(sum(spread), 1e-9))


def held_out_groups(
    captures: Captures, comparison: Comparison, before: GainFit, after: GainFit
) -> tuple[HeldOutGroup, ...]:
    """Quality on held-out captures by wavelength and plane."""
    indices = comparison.indices
    wavelengths, planes = captures.wavelength_m[indices], captures.distance_m[indices]
    groups = []
    for wavelength, plane in sorted(set(zip(wavelengths, planes, strict=True))):
        same = (wavelengths == wavelength) & (planes == plane)
        first, second = (fit_quality(comparison, fitted, same) for fitted in (before, after))
        groups.append(HeldOutGroup(float(wavelength), float(plane), first, second))
    return tuple(groups)


def sample_captures(
    captures: Captures, comparison: Comparison, before: GainFit, after: GainFit
) -> tuple[SampleCapture, ...]:
    """A few held-out captures to show, one of each wavelength if there are several."""
    wavelengths = captures.wavelength_m[comparison.indices]
    first_of_each = [int(np.flatnonzero(wavelengths == w)[0]) for w in np.unique(wavelengths)]
    chosen = first_of_each if len(first_of_each) > 1 else list(range(len(wavelengths)))
    return tuple(
        SampleCapture(
            capture=int(comparison.indices[k]),
            wavelength_m=float(wavelengths[k]),
            distance_m=float(captures.distance_m[comparison.indices[k]]),
            light=comparison.light[k],
            predicted=(before.expected[k], after.expected[k]),
            residual=(before.residual[k], after.residual[k]),
        )
        for k in chosen[:SAMPLES]
    )


@dataclass(frozen=True)
class SpeckleChange:
    """Correlation of predicted with measured speckle on held-out pixels, by the nominal and the extended model.

    significance: of the extended model's, in standard deviations of the correlations at other places.
    """

    before: float
    after: float
    significance: float


def speckle_change(comparison: Comparison, before: GainFit, after: GainFit) -> SpeckleChange:
    """Mean over a few held-out captures of the correlation of local contrasts (`numerics.speckle_match`); NaN where
    pictures are too small."""
    around = min(_SPECKLE_AROUND_PX, min(comparison.light.shape[1:]) // 3)
    matches = [
        [match_speckle(light, fit.expected[k], weight > 0, reach_px=0, around_px=around) for fit in (before, after)]
        for k, (light, weight) in enumerate(zip(comparison.light[:SAMPLES], comparison.weight[:SAMPLES], strict=True))
        if around > 0 and (weight > 0).any()
    ]
    if not matches:
        return SpeckleChange(math.nan, math.nan, math.nan)
    nominal, extended = ([pair[which] for pair in matches] for which in (0, 1))
    mean = [float(np.mean([one.correlation for one in each])) for each in (nominal, extended)]
    return SpeckleChange(mean[0], mean[1], float(np.mean([one.significance for one in extended])))


# The excess broken down: χ²/n of pixels by wavelength, plane, pattern, radius, spatial frequency and brightness.


@dataclass(frozen=True)
class ExcessBin:
    """A class of pixels: its name in words, χ²/n, and its share of the squared residuals beyond the noise."""

    name: str
    chi2_per_pixel: float
    share: float


@dataclass(frozen=True)
class ExcessBreakdown:
    """The classes of each property."""

    wavelength: tuple[ExcessBin, ...]
    plane: tuple[ExcessBin, ...]
    smoothness: tuple[ExcessBin, ...]
    radius: tuple[ExcessBin, ...]
    frequency: tuple[ExcessBin, ...]
    brightness: tuple[ExcessBin, ...]


def break_down_excess(
    captures: Captures, comparison: Comparison, fitted: GainFit, roughness: Floats
) -> ExcessBreakdown:
    """The excess of a fitted prediction. roughness: of the patterns of every capture, held out or not."""
    indices = comparison.indices
    squares, pixels = fitted.squares, comparison.pixels_per_capture
    wavelengths, planes = captures.wavelength_m[indices], captures.distance_m[indices]
    return ExcessBreakdown(
        wavelength=_by_value(wavelengths, "nm", squares, pixels),
        plane=_by_value(planes, "mm", squares, pixels),
        smoothness=_by_smoothness(roughness[indices], squares, pixels),
        radius=_by_radius(comparison, fitted),
        frequency=_by_frequency(comparison, fitted),
        brightness=_by_brightness(comparison, fitted),
    )


def _by_value(values: Floats, unit: str, squares: Floats, pixels: Floats) -> tuple[ExcessBin, ...]:
    groups = [(format_rounded(float(v), unit), values == v) for v in np.unique(values)]
    return _bins([(name, squares[same].sum(), pixels[same].sum()) for name, same in groups])


def _by_smoothness(roughness: Floats, squares: Floats, pixels: Floats) -> tuple[ExcessBin, ...]:
    """Quarters of the captures by the roughness of their patterns."""
    order = np.argsort(roughness, kind="stable")
    names = ("smoothest patterns", "smoother", "rougher", "roughest patterns")
    parts = zip(names, np.array_split(order, len(names)), strict=True)
    return _bins([(name, squares[part].sum(), pixels[part].sum()) for name, part in parts if len(part)])


def _by_radius(comparison: Comparison, fitted: GainFit) -> tuple[ExcessBin, ...]:
    rows, columns = comparison.weight.shape[1:]
    y, x = (np.arange(n) - (n - 1) / 2 for n in (rows, columns))
    radius = np.hypot(y[:, None] / (rows / 2), x[None, :] / (columns / 2)) / np.sqrt(2)
    return _by_class(radius, np.array(RADII), comparison, fitted, "{:.0%} of the way to the corners")


def _by_brightness(comparison: Comparison, fitted: GainFit) -> tuple[ExcessBin, ...]:
    mean = np.maximum(fitted.expected.mean(axis=(1, 2), keepdims=True), 1e-12)
    return _by_class(fitted.expected / mean, np.array(BRIGHTNESS), comparison, fitted, "{:.3g} × the mean light")


def _by_class(
    measure: NDArray[np.floating], edges: Floats, comparison: Comparison, fitted: GainFit, text: str
) -> tuple[ExcessBin, ...]:
    """Pixels by a measure (y, x) or (capture, y, x). edges: limits between classes. text: format of a limit."""
    number = np.broadcast_to(np.digitize(measure, edges), comparison.weight.shape)
    usable = comparison.weight > 0
    squares = np.bincount(number.ravel(), np.square(fitted.residual).ravel(), len(edges) + 1)
    pixels = np.bincount(number.ravel(), usable.ravel(), len(edges) + 1)
    names = [
        f"up to {text.format(edges[0])}",
        *(
            f"{low:.3g} to {text.format(high)}" if "%" not in text else f"{low:.0%} to {text.format(high)}"
            for low, high in pairwise(edges)
        ),
        f"beyond {text.format(edges[-1])}",
    ]
    return _bins(list(zip(names, squares, pixels, strict=True)))


def _by_frequency(comparison: Comparison, fitted: GainFit) -> tuple[ExcessBin, ...]:
    """The power spectrum of the whitened residuals in bands up to the camera's Nyquist frequency; noise is flat."""
    rows, columns = comparison.weight.shape[1:]
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :]
    band = np.minimum((np.hypot(fy, fx) / 0.5 * FREQUENCY_BANDS).astype(int), FREQUENCY_BANDS - 1)
    twice = np.where((fx == 0) | (fx == 0.5), 1.0, 2.0) * np.ones_like(fy)
    power = np.zeros(band.shape)
    for residual in fitted.residual:
        power += np.abs(np.fft.rfft2(residual)) ** 2
    squares = np.bincount(band.ravel(), (power * twice).ravel(), FREQUENCY_BANDS) / (rows * columns)
    share = np.bincount(band.ravel(), twice.ravel(), FREQUENCY_BANDS) / (rows * columns)
    names = [f"{k / FREQUENCY_BANDS:.2g} to {(k + 1) / FREQUENCY_BANDS:.2g} of Nyquist" for k in range(FREQUENCY_BANDS)]
    return _bins([(n, s, p * comparison.pixel_count) for n, s, p in zip(names, squares, share, strict=True)])


def _bins(groups: list[tuple[str, float, float]]) -> tuple[ExcessBin, ...]:
    beyond = [max(squares - pixels, 0.0) for _, squares, pixels in groups]
    total = max(sum(beyond), 1e-30)
    return tuple(
        ExcessBin(name, float(squares / max(pixels, 1.0)), float(extra / total))
        for (name, squares, pixels), extra in zip(groups, beyond, strict=True)
    )
