"""Figures and pictures of a prediction beside held-out captures: χ²/n, PSNR, shares, by wavelength and plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.prepared_captures import Images
from holoview.diagnose.comparison import Comparison, GainFit
from holoview.diagnose.diagnosis import FitQuality, HeldOutGroup, SampleCapture

_SAMPLES = 4


def fit_quality(comparison: Comparison, fitted: GainFit, mask: NDArray[np.bool_] | None = None) -> FitQuality:
    """χ²/n and mean PSNR of captures (all, or those of a mask)."""
    chosen = np.ones(len(comparison.indices), dtype=bool) if mask is None else mask
    chi2 = fitted.squares[chosen].sum() / max(comparison.pixels_per_capture[chosen].sum(), 1.0)
    return FitQuality(float(chi2), float(_psnr(comparison, fitted.residual)[chosen].mean()))


def _psnr(comparison: Comparison, residual: Images) -> NDArray[np.float64]:
    """PSNR of each capture against its brightest 0.1 %."""
    usable = comparison.weight > 0
    errors = np.where(usable, residual / np.where(usable, comparison.weight, 1.0), 0.0)
    mean_square = np.square(errors, dtype=np.float64).sum((1, 2)) / np.maximum(comparison.pixels_per_capture, 1.0)
    peak = np.array([np.quantile(light[seen], 0.999) for light, seen in zip(comparison.light, usable, strict=True)])
    return 10 * np.log10(np.maximum(peak, 1e-9) ** 2 / np.maximum(mean_square, 1e-12))


def explained_variance(comparison: Comparison, fitted: GainFit) -> float:
    """Share of the pictures' variance that a prediction explains."""
    usable = comparison.weight > 0
    errors = np.where(usable, fitted.residual / np.where(usable, comparison.weight, 1.0), 0.0)
    spread = [float(light[seen].var() * seen.sum()) for light, seen in zip(comparison.light, usable, strict=True)]
    return 1.0 - float(np.square(errors, dtype=np.float64).sum() / max(sum(spread), 1e-9))


def held_out_groups(
    captures: Captures, comparison: Comparison, before: GainFit, after: GainFit
) -> tuple[HeldOutGroup, ...]:
    """Held-out captures by wavelength and plane."""
    indices = comparison.indices
    wavelengths, planes = captures.wavelength_m[indices], captures.distance_m[indices]
    found = []
    for wavelength, plane in sorted(set(zip(wavelengths, planes, strict=True))):
        same = (wavelengths == wavelength) & (planes == plane)
        first, second = (fit_quality(comparison, fitted, same) for fitted in (before, after))
        found.append(HeldOutGroup(float(wavelength), float(plane), first, second))
    return tuple(found)


def sample_captures(
    captures: Captures, comparison: Comparison, before: GainFit, after: GainFit
) -> tuple[SampleCapture, ...]:
    """Held-out captures of different wavelengths, as far as there are."""
    wavelengths = captures.wavelength_m[comparison.indices]
    first_of_each = [int(np.flatnonzero(wavelengths == w)[0]) for w in np.unique(wavelengths)]
    chosen = first_of_each if len(first_of_each) > 1 else list(range(len(wavelengths)))
    shown = []
    for k in chosen[:_SAMPLES]:
        index = int(comparison.indices[k])
        shown.append(
            SampleCapture(
                capture=index,
                wavelength_m=float(captures.wavelength_m[index]),
                distance_m=float(captures.distance_m[index]),
                light=comparison.light[k],
                predicted=(before.expected[k], after.expected[k]),
                residual=(before.residual[k], after.residual[k]),
            )
        )
    return tuple(shown)
