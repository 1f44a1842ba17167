"""How well a prediction fits held-out captures: χ²/n, PSNR, share of the variance, by wavelength and plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.prepared_captures import FitQuality
from holoview.diagnose.config import ReportConfig
from holoview.diagnose.diagnosis import HeldOutGroup, SampleCapture
from holoview.diagnose.likelihood import Comparison, GainFit


def fit_quality(
    comparison: Comparison, fitted: GainFit, config: ReportConfig, mask: NDArray[np.bool_] | None = None
) -> FitQuality:
    """χ²/n and mean PSNR of the captures of a mask (capture,), or of all."""
    chosen = np.ones(len(comparison.indices), dtype=bool) if mask is None else mask
    chi2 = fitted.squares[chosen].sum() / max(comparison.pixels_per_capture[chosen].sum(), 1.0)
    return FitQuality(float(chi2), float(_psnr(comparison, fitted, config.peak_quantile)[chosen].mean()))


def _psnr(comparison: Comparison, fitted: GainFit, peak_quantile: float) -> NDArray[np.float64]:
    """PSNR (dB) of each capture against a quantile of its light."""
    errors = comparison.residual_counts(fitted)
    mean_square = np.square(errors, dtype=np.float64).sum((1, 2)) / np.maximum(comparison.pixels_per_capture, 1.0)
    usable = comparison.weight > 0
    peak = np.array([np.quantile(light[u], peak_quantile) for light, u in zip(comparison.light, usable, strict=True)])
    return 10 * np.log10(np.maximum(peak, 1e-9) ** 2 / np.maximum(mean_square, 1e-12))


def explained_variance(comparison: Comparison, fitted: GainFit) -> float:
    """Share of the images' variance that a prediction explains."""
    usable = comparison.weight > 0
    spread = [float(light[u].var() * u.sum()) for light, u in zip(comparison.light, usable, strict=True)]
    errors = comparison.residual_counts(fitted)
    return 1.0 - float(np.square(errors, dtype=np.float64).sum() / max(sum(spread), 1e-9))


def held_out_groups(
    captures: Captures, comparison: Comparison, before: GainFit, after: GainFit, config: ReportConfig
) -> tuple[HeldOutGroup, ...]:
    """Quality on held-out captures by wavelength and plane."""
    indices = comparison.indices
    wavelengths, planes = captures.wavelength_m[indices], captures.distance_m[indices]
    groups = []
    for wavelength, plane in sorted(set(zip(wavelengths, planes, strict=True))):
        same = (wavelengths == wavelength) & (planes == plane)
        first, second = (fit_quality(comparison, fitted, config, same) for fitted in (before, after))
        groups.append(HeldOutGroup(float(wavelength), float(plane), first, second))
    return tuple(groups)


def sample_captures(
    captures: Captures, comparison: Comparison, before: GainFit, after: GainFit, count: int
) -> tuple[SampleCapture, ...]:
    """At most `count` held-out captures to show, one of each wavelength if there are several."""
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
        for k in chosen[:count]
    )
