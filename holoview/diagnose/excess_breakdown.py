"""The excess broken down: χ²/n of pixels by wavelength, plane, pattern, radius, spatial frequency and brightness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.diagnose.config import BreakdownConfig
from holoview.diagnose.likelihood import Comparison, GainFit
from holoview.util.units import format_rounded

Floats = NDArray[np.float64]


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
    captures: Captures, comparison: Comparison, fitted: GainFit, roughness: Floats, config: BreakdownConfig
) -> ExcessBreakdown:
    """The excess of a fitted prediction. roughness: of the patterns of every capture of the session."""
    indices = comparison.indices
    squares, pixels = fitted.squares, comparison.pixels_per_capture
    wavelengths, planes = captures.wavelength_m[indices], captures.distance_m[indices]
    return ExcessBreakdown(
        wavelength=_by_value(wavelengths, "nm", squares, pixels),
        plane=_by_value(planes, "mm", squares, pixels),
        smoothness=_by_smoothness(roughness[indices], squares, pixels),
        radius=_by_radius(comparison, fitted, config.radii),
        frequency=_by_frequency(comparison, fitted, config.frequency_bands),
        brightness=_by_brightness(comparison, fitted, config.brightness),
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


def _by_radius(comparison: Comparison, fitted: GainFit, radii: Sequence[float]) -> tuple[ExcessBin, ...]:
    rows, columns = comparison.weight.shape[1:]
    y, x = (np.arange(n) - (n - 1) / 2 for n in (rows, columns))
    radius = np.hypot(y[:, None] / (rows / 2), x[None, :] / (columns / 2)) / np.sqrt(2)
    return _by_class(radius, np.array(radii), comparison, fitted, "{:.0%} of the way to the corners")


def _by_brightness(comparison: Comparison, fitted: GainFit, limits: Sequence[float]) -> tuple[ExcessBin, ...]:
    mean = np.maximum(fitted.expected.mean(axis=(1, 2), keepdims=True), 1e-12)
    return _by_class(fitted.expected / mean, np.array(limits), comparison, fitted, "{:.3g} × the mean light")


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


def _by_frequency(comparison: Comparison, fitted: GainFit, bands: int) -> tuple[ExcessBin, ...]:
    """The power spectrum of the whitened residuals in bands up to the camera's Nyquist frequency; noise is flat."""
    rows, columns = comparison.weight.shape[1:]
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :]
    band = np.minimum((np.hypot(fy, fx) / 0.5 * bands).astype(int), bands - 1)
    twice = np.where((fx == 0) | (fx == 0.5), 1.0, 2.0) * np.ones_like(fy)
    power = np.zeros(band.shape)
    for residual in fitted.residual:
        power += np.abs(np.fft.rfft2(residual)) ** 2
    squares = np.bincount(band.ravel(), (power * twice).ravel(), bands) / (rows * columns)
    share = np.bincount(band.ravel(), twice.ravel(), bands) / (rows * columns)
    names = [f"{k / bands:.2g} to {(k + 1) / bands:.2g} of Nyquist" for k in range(bands)]
    return _bins([(n, s, p * comparison.pixel_count) for n, s, p in zip(names, squares, share, strict=True)])


def _bins(groups: list[tuple[str, float, float]]) -> tuple[ExcessBin, ...]:
    beyond = [max(squares - pixels, 0.0) for _, squares, pixels in groups]
    total = max(sum(beyond), 1e-30)
    return tuple(
        ExcessBin(name, float(squares / max(pixels, 1.0)), float(extra / total))
        for (name, squares, pixels), extra in zip(groups, beyond, strict=True)
    )
