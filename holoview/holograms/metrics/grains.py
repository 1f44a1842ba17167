"""How sure a speckle contrast is: the number of independent grains of a region, from its autocorrelation.

A change of one value x of a pattern of mean μ, deviation σ and contrast C = σ/μ changes C by

    ψ(x) = ((x − μ)² − σ²)/(2σμ) − σ(x − μ)/μ²,

the influence function, so that Var(Ĉ) = ⟨ψ²⟩·Σρ_ψ/A over a region of A samples, ρ_ψ being the correlation of ψ over all
displacements. For a sum of N equal speckle patterns x has a gamma law, ψ is proportional to its second orthogonal
polynomial (a Laguerre polynomial), ⟨ψ²⟩ = C²(1 + C²)/2, and ρ_ψ = ρ², ρ being the autocorrelation of the intensity
(the bivariate gamma law of Kibble, Sankhyā 5, 137 (1941)). With n = A/Σρ² independent grains

    standard error of C = √(⟨ψ²⟩/n) = C·√((1 + C²)/2n).

⟨ψ²⟩ is measured, so that the law needn't be the gamma law. The grains of the mean, A/Σρ (Goodman, *Speckle Phenomena in
Optics*, 2007, ch. 5), are fewer: 4/9 as many behind a square pupil.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from holoview.holograms.metrics.speckle import Floats, SpecklePattern, speckle_pattern
from holoview.light.numerics.sampling import Region, region_slices

FEW_GRAINS = 30
"""Grains below which a contrast and its standard error are rough, and both come out too low."""

BLOCKS = 8
"""Blocks each way, by whose scatter standard errors are found where no law tells them."""

_GRAIN_EDGE = 0.2  # correlation at the edge of a grain
_WINDOW_GRAINS, _LEAST_WINDOW = 4, 8  # half side of the displacements that count, in grains; in samples


@dataclass(frozen=True)
class Grains:
    """The grains of a region.

    count: independent ones, A/Σρ². width_px: full width at half maximum of the autocorrelation along (y, x), in
    samples; NaN where the region is smaller than a grain.
    """

    count: float
    width_px: tuple[float, float]


@dataclass(frozen=True)
class ContrastEstimate:
    """A speckle contrast, its standard error, and the grains from which that follows.

    noise_share: the camera's noise, which was taken off the square of the contrast.
    """

    contrast: float
    standard_error: float
    grains: Grains
    noise_share: float = 0.0

    @property
    def has_few_grains(self) -> bool:
        """Whether the region holds too few grains for more than a rough number."""
        return self.grains.count < FEW_GRAINS


@dataclass(frozen=True)
class PixelNoise:
    """The noise of a camera's pixels, of variance r² + s/g for s counts of light.

    electrons_per_count: g; None where the shot noise isn't known. read_noise_counts: r, with rounding to whole counts.
    gain_error: relative standard deviation of g.
    """

    electrons_per_count: float | None
    read_noise_counts: float
    gain_error: float = 0.0

    def variance(self, light: Floats) -> Floats:
        """Variance of counts whose light is known but for this noise."""
        shot = np.maximum(light, 0.0) / (math.inf if self.electrons_per_count is None else self.electrons_per_count)
        return np.asarray(shot + self.read_noise_counts**2)


@dataclass(frozen=True, eq=False)
class SumNoise:
    """The noise of a sum of pictures of one camera, each weighted. variance: (y, x). gain_error: as of `PixelNoise`."""

    variance: Floats
    gain_error: float = 0.0

    @staticmethod
    def of(weights: ArrayLike, light: ArrayLike, noise: PixelNoise) -> SumNoise:
        """Of Σ w·s for weights (picture,) and pictures (picture, y, x): Σ w²·(r² + s/g)."""
        squares = np.square(np.asarray(weights, dtype=np.float64))
        return SumNoise(np.tensordot(squares, noise.variance(np.asarray(light)), axes=1), noise.gain_error)

    def within(self, region: Region) -> SumNoise:
        """That of a region of the pictures."""
        return SumNoise(self.variance[region_slices(region)], self.gain_error)


def estimate_contrast(
    intensity: ArrayLike, region: Region | None = None, target: ArrayLike | None = None
) -> ContrastEstimate:
    """Speckle contrast with its standard error. Arguments and errors as of `speckle.speckle_contrast`."""
    return contrast_estimate(speckle_pattern(intensity, region, target))


def contrast_estimate(pattern: SpecklePattern, noise: PixelNoise | SumNoise | None = None) -> ContrastEstimate:
    """Speckle contrast of a pattern with its standard error. Raises UserError for one without light.

    noise: of the pixels of the pattern's image, whose variance is taken off: C² = C_m² − ⟨r² + s/g⟩/μ², with the
    standard error of C_m times C_m/C and that by the error of g. 0 where nothing is left.
    """
    found, grains = pattern.contrast, grains_of(pattern)
    if found.std == 0.0:
        return ContrastEstimate(0.0, 0.0, grains)
    difference = pattern.counted - found.mean
    influence = (difference**2 - found.std**2) / (2 * found.std * found.mean) - found.std * difference / found.mean**2
    error = math.sqrt(float(np.square(influence).mean()) / grains.count)
    if noise is None:
        return ContrastEstimate(found.contrast, error, grains)
    share = _noise_share(pattern, noise)
    contrast = math.sqrt(max(found.contrast**2 - share, 0.0))
    scale = max(contrast, error)  # where little is left, C is no more certain than its square allows
    by_gain = noise.gain_error * share / (2 * scale)
    return ContrastEstimate(contrast, math.hypot(error * found.contrast / scale, by_gain), grains, share)


def noise_variance(pattern: SpecklePattern, noise: PixelNoise | SumNoise) -> Floats:
    """Variance (y, x) of the noise of a pattern's values."""
    of_image = noise.variance if isinstance(noise, SumNoise) else noise.variance(pattern.values * pattern.unit)
    return np.asarray(of_image / np.square(pattern.unit))


def _noise_share(pattern: SpecklePattern, noise: PixelNoise | SumNoise) -> float:
    """Mean variance of the noise of a pattern's values over the square of their mean."""
    return float(noise_variance(pattern, noise)[pattern.usable].mean()) / pattern.contrast.mean**2


def grains_of(pattern: SpecklePattern) -> Grains:
    """The grains of a pattern, from the autocorrelation ρ of what counts of it; an even one is one grain.

    Beyond the grain, the ρ of a region of n grains scatters by 1/√n, whose square is taken off Σρ².
    """
    correlation, overlap = autocorrelation(pattern)
    if correlation.max() == 0.0:
        return Grains(1.0, (math.nan, math.nan))
    area = float(pattern.usable.sum())
    centre_y, centre_x = (n // 2 for n in correlation.shape)
    along = correlation[centre_y:, centre_x], correlation[centre_y, centre_x:]
    half_y, half_x = (_half_window(values) for values in along)
    near = np.s_[centre_y - half_y : centre_y + half_y + 1, centre_x - half_x : centre_x + half_x + 1]
    counted = overlap[near] >= 1
    squares = float(np.square(correlation[near][counted]).sum())
    noise = float((1 / overlap[near][counted]).sum())  # Var ρ of a displacement is Σρ² over the pixels that overlap
    count = max(area * (1 + noise) / squares, 1.0)
    return Grains(min(count, area), (_width(along[0]), _width(along[1])))


def block_sums(values: Floats, blocks: int = BLOCKS) -> Floats:
    """Sums of values (y, x) over 8 × 8 blocks, or over as many as there are samples each way."""
    rows, columns = (np.arange(min(blocks, n)) * n // min(blocks, n) for n in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1))


def error_by_blocks(influence: Floats, blocks: int = BLOCKS) -> float:
    """Standard error of a sum of contributions (y, x) to a number, their mean being 0: √Σb², b the sums over blocks.

    Blocks that hold some grains are independent, whatever the grains' form and the law of the contributions; the error
    of 64 blocks is known to 1/√128 = 9 % of itself.
    """
    return float(np.linalg.norm(block_sums(influence, blocks)))


def autocorrelation(pattern: SpecklePattern) -> tuple[Floats, Floats]:
    """The autocorrelation of a pattern at displacements (y, x), 1 at 0 in the middle, n // 2; 0 of an even pattern.

    Returns it and the number of pairs of samples at each displacement.
    """
    shape = tuple(2 * n for n in pattern.usable.shape)
    values = np.where(pattern.usable, pattern.values - pattern.contrast.mean, 0.0)
    products, pairs = (
        np.fft.fftshift(np.fft.irfft2(np.abs(np.fft.rfft2(part, shape)) ** 2, shape))
        for part in (values, pattern.usable.astype(np.float64))
    )
    overlap: Floats = np.rint(pairs)
    covariance = products / np.maximum(overlap, 1)
    variance = covariance[shape[0] // 2, shape[1] // 2]
    correlation: Floats = covariance / variance if pattern.contrast.std > 0 else np.zeros(shape)
    return correlation, overlap


def _half_window(along: Floats) -> int:
    """Samples to either side of 0 that the displacements within some grains reach: a quarter of the side at most."""
    below = np.flatnonzero(along < _GRAIN_EDGE)
    grain = int(below[0]) if below.size else len(along)
    return max(1, min(max(_WINDOW_GRAINS * grain, _LEAST_WINDOW), len(along) // 4))


def _width(along: Floats) -> float:
    """Full width at half maximum of a correlation (displacement,) from 0 on, interpolated; NaN if it stays above."""
    below = np.flatnonzero(along < 0.5)
    if not below.size:
        return math.nan
    i = int(below[0])
    return 2 * (i - 1 + float((along[i - 1] - 0.5) / (along[i - 1] - along[i])))
