"""Speckle contrast: the standard deviation of an intensity over its mean, C = σ/μ, in a region that should be smooth.

Fully developed speckle has C = 1; the sum of N independent patterns of equal mean has C = 1/√N (Goodman, *Speckle
Phenomena in Optics*, 2007, ch. 3), so that 1/C² is the number of independent patterns that wavelengths, frames or
sources contribute.

A picture has structure of its own, which σ/μ would count as speckle. Speckle is multiplicative: I = g·T·s with the
target T, a gain g and a pattern s of mean 1. Where T is known, the ratio I/(g·T) = s has the contrast of the speckle
for any picture, unlike the difference I − g·T, whose deviation is proportional to the picture. σ/μ doesn't depend on
g, which is fitted (Σ I/Σ T) only to report a mean near 1.

Where T is dark, the ratio is one of stray light and noise to almost nothing: pixels whose target is below
`TARGET_FLOOR` of its mean in the region are excluded. Raising T to a floor instead would bias C, since the ratios of
the dark pixels would be far below 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.light.colour import SRGB_TO_XYZ, observer_weights
from holoview.light.model.bench_parts import Relay
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.sampling import Region, region_slices
from holoview.util.errors import UserError

Floats = NDArray[np.float64]

_DIRECTIONS = 64  # along each side of the first order
_FAINTEST = 1e-100  # squares of it, and of 1 over it, are numbers
TARGET_FLOOR = 0.05
"""Least target value, as a fraction of its mean in the region, of a pixel that counts."""


@dataclass(frozen=True)
class SpeckleContrast:
    """Contrast σ/μ, the mean μ and standard deviation σ, and the number of pixels that count.

    With a target, μ and σ are those of the ratio I/(g·T), without unit.
    """

    contrast: float
    mean: float
    std: float
    n_pixels: int


@dataclass(frozen=True, eq=False)
class SpecklePattern:
    """A region of an image without the structure of what it shows: the speckle alone.

    values: (y, x) of the intensity, or of its ratio to the target. usable: (y, x), where they count. unit: intensity
    for which a value is 1; (y, x), or one for all.
    """

    values: Floats
    usable: NDArray[np.bool_]
    unit: Floats | float = 1.0

    @property
    def counted(self) -> Floats:
        """The values that count, (n,)."""
        return self.values[self.usable]

    @cached_property
    def contrast(self) -> SpeckleContrast:
        """Contrast σ/μ of the values that count.

        Raises UserError when fewer than two pixels with light remain.
        """
        values = self.counted
        mean = float(values.mean()) if values.size else 0.0
        if values.size < 2 or not mean > 0.0:
            raise UserError(
                "region",
                "a single usable pixel" if values.size == 1 else f"{values.size} usable pixels of mean {mean:g}",
                expected="two or more pixels with light on them",
                remedy="choose a larger or brighter region",
            )
        std = float(values.std())
        return SpeckleContrast(contrast=std / mean, mean=mean, std=std, n_pixels=values.size)


def speckle_pattern(
    intensity: ArrayLike, region: Region | None = None, target: ArrayLike | None = None
) -> SpecklePattern:
    """The speckle of an intensity image (y, x) in a region, relative to a target (y, x) if given.

    Raises UserError for an image that isn't (y, x), a region that is empty or outside, and a target of another shape.
    """
    image = np.asarray(intensity, dtype=np.float64)
    if image.ndim != 2 or image.size == 0:
        raise UserError("image", f"shape {image.shape}", expected="one channel, (y, x)", remedy="take its luminance")
    window = _checked_slices(region, image.shape[1], image.shape[0])
    values = image[window]
    greatest = float(np.abs(values).max())
    if greatest > 0 and not _FAINTEST < greatest < 1 / _FAINTEST:
        expected = f"between {_FAINTEST:g} and {1 / _FAINTEST:g}"
        raise UserError("image", f"numbers up to {greatest:.3g} in the region", expected=expected, remedy="scale it")
    if target is None:
        return SpecklePattern(values, np.ones(values.shape, dtype=bool))
    target_image = np.asarray(target, dtype=np.float64)
    if target_image.shape != image.shape:
        raise UserError("target", f"shape {target_image.shape}", expected=f"the image's shape, {image.shape}")
    return _ratio_to_target(values, target_image[window])


def speckle_contrast(
    intensity: ArrayLike, region: Region | None = None, target: ArrayLike | None = None
) -> SpeckleContrast:
    """Speckle contrast of an intensity image (y, x), in a region if given, relative to a target (y, x) if given.

    Pixels inside one speckle grain are correlated: the estimate is noisier than n_pixels suggests, and too low in a
    region of few grains; `grains.estimate_contrast` says how sure it is. Raises UserError as `speckle_pattern` does,
    and when fewer than two pixels with light remain.
    """
    return speckle_pattern(intensity, region, target).contrast


def target_luminance(target: NDArray[np.floating], region: Region | None = None) -> Floats | None:
    """Luminance (y, x) of a target (y, x, 3) in linear sRGB; None if it is black in the region."""
    luminance: Floats = np.asarray(target, dtype=np.float64) @ SRGB_TO_XYZ[1]
    part = luminance if region is None else luminance[region_slices(region)]
    return luminance if np.any(part > 0) else None


def independent_patterns(contrast: float) -> float:
    """Number N = 1/C² of independent speckle patterns of equal mean whose sum has the contrast C; inf for C = 0.

    Raises UserError for a negative contrast.
    """
    if not contrast >= 0.0:
        raise UserError("contrast", f"{contrast:g}", expected="0 or more")
    return 1.0 / contrast**2 if contrast > 0.0 else float("inf")


def _checked_slices(region: Region | None, width: int, height: int) -> tuple[slice, slice]:
    """The region as slices of (y, x). Raises UserError unless it lies inside the image."""
    if region is None:
        return slice(None), slice(None)
    x, y, w, h = region
    if w < 1 or h < 1 or x < 0 or y < 0 or x + w > width or y + h > height:
        raise UserError(
            "region",
            f"x = {x}, y = {y}, width = {w}, height = {h}",
            expected=f"at least one pixel, inside the image of {width} × {height} pixels (width × height)",
        )
    return region_slices(region)


def _ratio_to_target(values: Floats, target: Floats) -> SpecklePattern:
    """The ratio I/(g·T) (y, x), which counts where the target isn't too dark; nowhere when there are no such pixels."""
    bright = (target > 0.0) & (target >= TARGET_FLOOR * target.mean())
    gain = values[bright].sum() / target[bright].sum() if bright.any() else 0.0
    if not gain > 0.0:
        return SpecklePattern(np.zeros(values.shape), np.zeros(values.shape, dtype=bool))
    unit = np.where(bright, gain * target, 1.0)
    return SpecklePattern(np.where(bright, values / unit, 0.0), bright, unit)


# --- histogram --------------------------------------------------------------------------------------------------------

# Fully developed, polarised speckle of one laser is exponentially distributed: p(s) = exp(−s) for s = I/Ī. The sum of N
# independent patterns of equal mean has a gamma distribution of shape N; that of patterns with unequal means m has
# nearly the one of shape N = (Σm)²/Σm² (Goodman, *Speckle Phenomena in Optics*, 2007, sections 3.2 and 3.3).


@dataclass(frozen=True, eq=False)
class SpeckleHistogram:
    """Probability density of I/Ī in bins (n,).

    edges: of the bins (n + 1,). density: measured (n,). pattern_count: number of independent patterns expected.
    """

    edges: Floats
    density: Floats
    pattern_count: float

    @cached_property
    def centres(self) -> Floats:
        """Centres of the bins (n,)."""
        return (self.edges[1:] + self.edges[:-1]) / 2

    @cached_property
    def fully_developed_density(self) -> Floats:
        """The density of fully developed speckle of one laser at the centres (n,)."""
        return speckle_density(self.centres)

    @cached_property
    def expected_density(self) -> Floats:
        """The density of the sum of `pattern_count` independent patterns at the centres (n,)."""
        return speckle_density(self.centres, self.pattern_count)


def speckle_density(relative_intensity: ArrayLike, pattern_count: float = 1.0) -> Floats:
    """Probability density of s = I/Ī for the sum of N independent speckle patterns of equal mean; N may be fractional.

    The density is N^N·s^(N−1)·exp(−N·s)/Γ(N) for s ≥ 0, and 0 below.
    """
    count, s = pattern_count, np.asarray(relative_intensity, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        powers = np.zeros_like(s) if count == 1.0 else (count - 1.0) * np.log(s)
    return np.where(s >= 0, np.exp(count * math.log(count) - math.lgamma(count) - count * s + powers), 0.0)


def speckle_histogram(
    luminance: NDArray[np.floating], region: Region, pattern_count: float = 1.0, bins: int = 60, max_ratio: float = 4.0
) -> SpeckleHistogram:
    """The histogram of a region of an image (y, x) over the region's mean, from 0 to `max_ratio`.

    Raises UserError for a region without light.
    """
    values = np.asarray(luminance[region_slices(region)], dtype=np.float64).ravel()
    mean = float(values.mean()) if values.size else 0.0
    if not mean > 0:
        raise UserError("region", "no light in it", remedy="choose a brighter region")
    counts, edges = np.histogram(values / mean, bins=bins, range=(0.0, max_ratio))
    return SpeckleHistogram(edges, counts / (values.size * (edges[1] - edges[0])), pattern_count)


# --- independent patterns of lasers, frames and sources ---------------------------------------------------------------

# Patterns of different lasers, frames and sources count as independent and fully developed here, which those of one
# hologram need not be: the contrast √(Σm²)/Σm for mean luminances m is the least that they can bring (Goodman, *Speckle
# Phenomena in Optics*, 2007, ch. 3). Effects may split the light of one laser, frame and source into lines, directions
# and moments, whose patterns are alike. With shares w of the light and correlations ρ of the intensities, m² becomes
# m²·Σ w_i·w_j·ρ_ij, and ρ is that of random patterns, even over the stroke, behind which a field's correlation is
#
#     sinc(S·Δ(f/λ)) for each modulator of stroke S, at moments of factor f,
#     the mean of exp(2πi·z·(Δs·θ/λ + Δ(1/λ)·|θ|²/2)) over the directions θ that pass, for each way z,
#
# for light that falls in at s (Goodman, ch. 5). Against the contrast of random patterns this is right to 10 %.


def laser_luminances(system: System) -> Floats:
    """Mean luminance (frame, wavelength) that each laser adds to an evenly lit image: amplitude · Y(λ) / frames.

    With the effects on powers and lines; the light of all lines of a laser counts as the laser's.
    """
    return _luminances(make_plan(system)).sum(axis=(1, 3))


def independent_pattern_count(system: System, plane_m: float | None = None) -> float:
    """Effective number of independent patterns (Σm)²/Σm², m the mean luminance of each laser, frame and source.

    Lines of one laser, directions of an extended source and moments of an exposure, which effects add, count as far as
    their patterns differ at a plane, the middle one when None.
    """
    means = laser_luminances(system)
    if not np.any(means > 0):
        return 1.0
    squares = np.square(means) * pattern_likeness(system, plane_m) / len(system.source.directions_rad)
    return float(means.sum() ** 2 / squares.sum())


def pattern_likeness(system: System, plane_m: float | None = None) -> Floats:
    """Squared contrast (wavelength,) of the light of each laser in one frame from one source, 1 for a single pattern.

    Below 1 where effects split it into lines, directions and moments whose patterns differ, at a plane as of
    `independent_pattern_count`.
    """
    if not system.effects:
        return np.ones(len(system.wavelengths_m))
    plan = make_plan(system, None if plane_m is None else [plane_m])
    built, z = plan.system, abs(plan.planes[len(plan.planes) // 2].true_m)
    ways = [(z, built.relay2)] + ([(built.gap_m, built.relay1)] if built.gap_m is not None else [])
    moments, points = np.array(plan.moments), list(plan.directions[0].indices)
    directions, power = np.sin(built.source.directions_rad[points]), _luminances(plan).sum(axis=0)
    likeness = np.ones(len(plan.lasers))
    for laser in np.flatnonzero(power.sum(axis=(0, 2)) > 0):
        λ = built.wavelengths_m[list(plan.lasers[laser].indices)]
        mean_m = float(λ.mean())
        of_lines, of_directions = _by_strokes(built, 1 / λ), np.ones((len(directions),) * 2)
        for z_m, relay in ways:
            sine_y, sine_x, weights = _directions_that_pass(built, relay, mean_m)
            path_m = z_m * (sine_y**2 + sine_x**2) / 2
            of_lines = of_lines * _correlation(np.exp(2j * np.pi * path_m / λ[:, None]), weights)
            shift = z_m / mean_m * (directions @ np.stack([sine_y, sine_x]))
            of_directions = of_directions * _correlation(np.exp(2j * np.pi * shift), weights)
        parts = (
            (power[:, laser].sum(axis=0), of_lines),
            (np.ones(len(directions)), of_directions),
            (power[:, laser].sum(axis=1), _by_strokes(built, moments / mean_m)),
        )
        for shares, correlation in parts:
            w = shares / shares.sum()
            likeness[laser] *= float(w @ np.square(correlation) @ w)
    return likeness


def _luminances(plan: Plan) -> Floats:
    """Mean luminance (frame, moment, laser, line) of a plan's light, of all sources together."""
    visible = np.maximum(observer_weights(plan.system.observer, plan.system.wavelengths_m)[:, 1], 0.0)
    power = plan.weights * len(plan.slopes) * visible
    frames, lines = (np.array([samples.indices for samples in of]) for of in (plan.frames, plan.lasers))
    return power[frames[:, :, None, None], lines]


def _by_strokes(system: System, waves_per_m: Floats) -> Floats:
    """Correlation (n, n) of fields behind random patterns whose phases are 2π·path·waves_per_m, (n,)."""
    difference = waves_per_m[:, None] - waves_per_m[None, :]
    return np.prod([np.sinc(modulator.stroke_m * difference) for modulator in system.modulators], axis=0)


def _directions_that_pass(system: System, relay: Relay, wavelength_m: float) -> tuple[Floats, Floats, Floats]:
    """Direction sines y and x, and their shares of the light (n,), of the first order behind a relay's stops."""
    pitch_m = system.modulators[0].pitch_m
    edge = wavelength_m / (2 * pitch_m)
    sines = edge * (2 * np.arange(_DIRECTIONS) + 1 - _DIRECTIONS) / _DIRECTIONS
    y, x = (values.ravel() for values in np.meshgrid(sines, sines, indexing="ij"))
    passes = np.ones(y.shape, dtype=bool)
    from_centre = y - relay.centre_na[0], x - relay.centre_na[1]
    if relay.iris_na is not None:
        passes &= np.hypot(*from_centre) <= relay.iris_na
    if relay.square is not None:
        half = relay.square.half_side_sine(wavelength_m, pitch_m)
        passes &= np.maximum(*np.abs(from_centre)) <= half
    weights = np.square(np.sinc(y * pitch_m / wavelength_m) * np.sinc(x * pitch_m / wavelength_m)) * passes
    return y, x, weights / max(weights.sum(), np.finfo(float).tiny)


def _correlation(phasors: NDArray[np.complexfloating], weights: Floats) -> Floats:
    """|Σ_n w_n·p_in·p*_jn| (i, j) of phasors (i, n)."""
    return np.abs((phasors * weights) @ phasors.conj().T)


def independent_contrast(system: System, plane_m: float | None = None) -> float:
    """Luminance contrast of independent patterns, 1/√N with N of `independent_pattern_count`."""
    return float(independent_pattern_count(system, plane_m) ** -0.5)


def mean_wavelength(system: System) -> float:
    """Mean wavelength in metres, each weighted by its luminance; by nothing if none can be seen."""
    weights = laser_luminances(system).sum(axis=0)
    return float(np.average(system.wavelengths_m, weights=weights if np.any(weights > 0) else None))


# --- on the retina ----------------------------------------------------------------------------------------------------

CONE_ARCMIN = 0.5
"""Diameter of a foveal cone (Curcio et al., J. Comp. Neurol. 292, 497 (1990)): 2.5 µm at 17 mm."""


def seen_by_cones(image: NDArray[np.floating], degrees_per_sample: float) -> NDArray[np.float64]:
    """The mean of an image (y, x) over a disc as wide as a foveal cone, around every sample; it counts as periodic."""
    from scipy.special import j1  # slow start: a viewer begins without it

    rows, columns = image.shape
    y, x = np.fft.fftfreq(rows, degrees_per_sample), np.fft.rfftfreq(columns, degrees_per_sample)
    v = np.pi * CONE_ARCMIN / 60 * np.hypot(y[:, None], x[None, :])
    transfer = np.divide(2 * j1(v), v, out=np.ones_like(v), where=v > 0)
    return np.asarray(np.fft.irfft2(np.fft.rfft2(image) * transfer, image.shape))


def channels_seen_by_cones(image: NDArray[np.floating], degrees_per_sample: float) -> Floats:
    """Each channel of an image (y, x, channel) as `seen_by_cones`."""
    return np.stack([seen_by_cones(of, degrees_per_sample) for of in np.moveaxis(image, -1, 0)], axis=-1)
