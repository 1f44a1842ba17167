"""All that a reviewer asks of the speckle of a region: of the luminance, of each laser, of groups, and their colours.

In the manner of IEC 62906-5-2:2016 (contrast) and IEC 62906-5-4:2018 (colour speckle), which are standards for laser
projection: a near-eye display has no screen, so that they are followed as far as that allows.

The contrast of the luminance is that of `likeness.luminance_contrast`, which the viewer shows: of I/(g·T), the
structure of a target T being divided out, at the resolution that the picture shows, where the picture shows it; where
it doesn't, only raw numbers are stated.
The structure of the light of one laser is the mixture of the target's red, green and blue, none of them negative, that
fits it best.

With the mean luminance m of each laser, its contrast C and the correlations ρ between the lasers' patterns

    (a) one by one, taken as independent   C² = Σ (m·C)²/(Σm)²
    (b) together                           C² = ΣΣ m_i·m_j·C_i·C_j·ρ_ij/(Σm)², which is measured as it stands
    N_eff from powers                      (Σm)²/Σm²
    N_eff from the correlations            (Σm)²/ΣΣ m_i·m_j·ρ_ij

The standard errors of both N_eff follow from the scatter between 8 × 8 blocks of the region. With the shares w of the
luminance, Σw = 1, Q = ΣΣ w_i·w_j·ρ_ij, q_i = Σ_j w_j·ρ_ij, and the deviations d_i of each laser's pattern from its
mean 1, z_i = d_i/C_i, a sample contributes to the relative change of N_eff

    2·Σ w_i·(1 − q_i/Q)·d_i − ((Σ w_i·z_i)² − Σ w_i·q_i·z_i²)/Q

over the number of samples: the first term by the means m, the second by the correlations, which those that are known
(ρ the unit matrix) don't have. The d_i of the first term are weighted by the target's structure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from holoview.holograms.metrics.colour_speckle import ColourSpeckle, colour_speckle, independent_colours
from holoview.holograms.metrics.grains import (
    ContrastEstimate,
    PixelNoise,
    SumNoise,
    contrast_estimate,
    error_by_blocks,
    noise_variance,
)
from holoview.holograms.metrics.likeness import (
    NO_OTHERS,
    BetterTarget,
    Likeness,
    LuminanceContrast,
    OtherPlanes,
    StructureLeft,
    displaced,
    luminance_contrast,
    shown_target,
)
from holoview.holograms.metrics.speckle import Floats, SpecklePattern, speckle_pattern
from holoview.light.numerics.sampling import Region, region_slices
from holoview.util.errors import UserError

GROUPS = {"blue": (0.0, 500e-9), "green": (500e-9, 590e-9), "red": (590e-9, math.inf)}
"""Ranges of wavelength (m) of the groups of lasers; the lower end is included."""

STILL_THRESHOLD = 0.03
"""Contrast below which speckle of a still picture isn't seen (Roelandt et al., Opt. Express 22, 23965 (2014))."""

MOVING_THRESHOLDS = {"red": 0.069, "green": 0.060, "blue": 0.048}
"""The same of moving pictures (Verschaffelt et al., Sci. Rep. 5, 14105 (2015))."""

STRUCTURE_COUNTS = "structure of a picture counts as speckle here: choose a region that should be even, or --target"
"""What is said of the contrast of a picture whose target isn't known."""

STILL_SOURCE = "Roelandt et al., Opt. Express 22, 23965 (2014), 40 observers"
MOVING_SOURCE = "Verschaffelt et al., Sci. Rep. 5, 14105 (2015), 186 observers"

_MOST_TOO_DARK = 0.01  # share of pixels without a colour that isn't worth a sentence


@dataclass(frozen=True, eq=False)
class LaserImages:
    """The light of each laser in an image, or of each channel of a camera.

    names: of the lasers or channels. groups: to which of `GROUPS` each belongs. colours: (laser, 3) XYZ of unit
    intensity; None where a camera doesn't tell. intensity: (laser, y, x). wavelengths_m: (laser,); None of channels.
    noise: of a camera's pixels, in each image.
    """

    names: tuple[str, ...]
    groups: tuple[str, ...]
    colours: Floats | None
    intensity: NDArray[np.floating]
    wavelengths_m: Floats | None = None
    noise: PixelNoise | None = None

    @property
    def luminances(self) -> Floats:
        """(laser,): luminance of unit intensity; 1 where a camera doesn't tell."""
        return np.ones(len(self.names)) if self.colours is None else np.maximum(self.colours[:, 1], 0.0)


def images_of_lasers(wavelengths_m: Floats, colours: Floats | None, intensity: NDArray[np.floating]) -> LaserImages:
    """The light of lasers of these wavelengths. Arguments as of `LaserImages`."""
    names = tuple(f"{λ * 1e9:.4g} nm" for λ in wavelengths_m)
    groups = tuple(
        next(name for name, (low, high) in GROUPS.items() if low <= λ < high) for λ in wavelengths_m.tolist()
    )
    return LaserImages(names, groups, colours, intensity, wavelengths_m)


@dataclass(frozen=True)
class LaserContrast:
    """The contrast of one laser or channel, and its share of the luminance of the region."""

    name: str
    wavelength_m: float | None
    luminance_share: float
    estimate: ContrastEstimate


@dataclass(frozen=True, eq=False)
class SpeckleMeasurement:
    """What `measure_speckle` finds in a region.

    region: (x, y, width, height). luminance: of all lasers together. mean, pixels: mean luminance, and the pixels that
    count. pattern: the speckle of the luminance. raw_contrast: with the structure of
    the picture. has_target: whether that was divided out of the others. withheld: why the contrast isn't to be stated,
    "" where it is; `luminance` is then raw, and the lasers aren't measured. likeness, blur_px, left, better,
    displacement_px: beside a target, as of `LuminanceContrast`.
    lasers: of those with light. groups: by the names of `GROUPS`. correlation: (laser, laser) of the patterns.
    colour, independent_colour: colour speckle as measured, and of independent lasers of the same contrasts; None in the
    dark and of an image without colours. notes: what limits the numbers, as sentences. pattern_errors: standard errors
    of N_eff from powers and from the correlations.
    """

    region: Region
    luminance: ContrastEstimate
    mean: float
    pixels: int
    raw_contrast: float
    has_target: bool
    pattern: SpecklePattern = field(repr=False)
    lasers: tuple[LaserContrast, ...] = ()
    groups: dict[str, ContrastEstimate] = field(default_factory=dict)
    correlation: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    colour: ColourSpeckle | None = None
    independent_colour: ColourSpeckle | None = None
    notes: tuple[str, ...] = ()
    withheld: str = ""
    likeness: Likeness | None = None
    blur_px: float = 0.0
    left: StructureLeft | None = None
    better: BetterTarget | None = None
    displacement_px: tuple[int, int] = (0, 0)
    pattern_errors: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def _shares(self) -> Floats:
        return np.array([laser.luminance_share for laser in self.lasers])

    @property
    def patterns_of_powers(self) -> float:
        """N_eff from powers: independent patterns that lasers of these luminances could be at most."""
        return float(self._shares.sum() ** 2 / np.square(self._shares).sum())

    @property
    def patterns_of_correlation(self) -> float:
        """N_eff from the correlations between the lasers' patterns."""
        return float(self._shares.sum() ** 2 / (self._shares @ self.correlation @ self._shares))

    @property
    def one_by_one(self) -> float:
        """Contrast of the luminance by way (a): from single contrasts, the lasers taken as independent."""
        contrasts = np.array([laser.estimate.contrast for laser in self.lasers])
        return float(np.linalg.norm(self._shares * contrasts) / self._shares.sum())

    @property
    def one_by_one_error(self) -> float:
        """Standard error of `one_by_one` by those of the lasers' contrasts."""
        terms = [
            laser.luminance_share**2 * laser.estimate.contrast * laser.estimate.standard_error for laser in self.lasers
        ]
        return float(np.linalg.norm(terms) / (self._shares.sum() ** 2 * max(self.one_by_one, 1e-30)))

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        alike, is_known = self.likeness, self.likeness is not None and math.isfinite(self.likeness.standard_error)
        found: dict[str, Any] = {
            "contrast": None if self.withheld else self.luminance.contrast,
            "standard_error": None if self.withheld else self.luminance.standard_error,
            "withheld": self.withheld or None,
            "likeness": asdict(alike) if alike is not None and is_known else None,
            "target_blur_px": None if alike is None else self.blur_px,
            "structure_left": None if self.left is None else asdict(self.left),
            "better_target": None if self.better is None else asdict(self.better),
            "target_displacement_px": list(self.displacement_px),
            **_grains_json(self.luminance),
            "raw_contrast": self.raw_contrast,
            "structure_removed": self.has_target,
            "visibility": [statement.as_json() for statement in visibility(self)],
        }
        if self.lasers:
            found |= {
                "lasers": [
                    {"name": laser.name, "wavelength_nm": _nm(laser.wavelength_m)}
                    | {"luminance_share": laser.luminance_share, **_estimate_json(laser.estimate)}
                    for laser in self.lasers
                ],
                "groups": {name: _estimate_json(estimate) for name, estimate in self.groups.items()},
                "correlation": self.correlation.tolist(),
                "n_eff_powers": self.patterns_of_powers,
                "n_eff_powers_standard_error": self.pattern_errors[0],
                "n_eff_correlation": self.patterns_of_correlation,
                "n_eff_correlation_standard_error": self.pattern_errors[1],
                "one_by_one_contrast": self.one_by_one,
                "one_by_one_standard_error": self.one_by_one_error,
            }
        for name, colour in (("colour_speckle", self.colour), ("colour_speckle_one_by_one", self.independent_colour)):
            if colour is not None:
                found[name] = colour.as_json()
        return found


def _nm(wavelength_m: float | None) -> float | None:
    return None if wavelength_m is None else round(wavelength_m * 1e9, 6)


def _estimate_json(estimate: ContrastEstimate) -> dict[str, Any]:
    return {"contrast": estimate.contrast, "standard_error": estimate.standard_error, **_grains_json(estimate)}


def _grains_json(estimate: ContrastEstimate) -> dict[str, Any]:
    widths = [None if math.isnan(width) else width for width in estimate.grains.width_px]
    return {"independent_grains": estimate.grains.count, "grain_px": widths}


# --- visibility -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Visibility:
    """A contrast beside a threshold of seeing it.

    what: of which contrast, and of what picture. verdict: "visible", "not visible", or "undecided" within two standard
    errors. source: of the threshold.
    """

    what: str
    contrast: float
    standard_error: float
    threshold: float
    source: str

    @property
    def verdict(self) -> str:
        """Whether the contrast is above the threshold, beyond two standard errors."""
        if abs(self.contrast - self.threshold) <= 2 * self.standard_error:
            return "undecided"
        return "visible" if self.contrast > self.threshold else "not visible"

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "what": self.what,
            "contrast": self.contrast,
            "threshold": self.threshold,
            "verdict": self.verdict,
            "source": self.source,
        }


def visibility(found: SpeckleMeasurement) -> list[Visibility]:
    """The luminance beside the threshold of a still picture, and each group beside that of a moving one.

    None where the contrast is withheld.
    """
    if found.withheld:
        return []
    rows = [("luminance, still picture", found.luminance, STILL_THRESHOLD, STILL_SOURCE)]
    rows += [
        (f"{name}, moving picture", found.groups[name], MOVING_THRESHOLDS[name], MOVING_SOURCE) for name in found.groups
    ]
    return [Visibility(what, own.contrast, own.standard_error, limit, source) for what, own, limit, source in rows]


# --- measuring --------------------------------------------------------------------------------------------------------


def measure_speckle(
    luminance: NDArray[np.floating],
    region: Region,
    target: NDArray[np.floating] | None = None,
    lasers: LaserImages | None = None,
    noise: PixelNoise | SumNoise | None = None,
    others: OtherPlanes = NO_OTHERS,
    *,
    is_aligned: bool = False,
) -> SpeckleMeasurement:
    """Measures a region of an image.

    luminance: (y, x). target: (y, x, 3) in linear sRGB, whose structure is divided out unless it is black there.
    lasers: of the same image; without them, the luminance alone is measured. noise: of a camera's pixels in the
    luminance; it is taken off. others, is_aligned: as of `luminance_contrast`.
    Raises UserError for a region that is outside, dark or a single pixel: a contrast isn't defined there.
    """
    measured = luminance_contrast(luminance, region, target, noise, others, is_aligned=is_aligned)
    estimate, notes = measured.estimate, list[str]()
    if target is not None and not measured.has_target and not measured.withheld:
        notes.append("the target is black in the region: its structure isn't divided out")
    if estimate.noise_share > 0 and estimate.contrast == 0:
        notes.append("the camera's noise explains all of the variance: no speckle is left")
    notes += _notes_beside_target(measured)
    if estimate.has_few_grains:
        notes.append(
            f"the region holds {estimate.grains.count:.0f} independent grains only: its contrast and the standard "
            "error are rough, and come out too low; choose a larger region"
        )
    plain = SpeckleMeasurement(
        region,
        estimate,
        measured.raw.mean,
        measured.pattern.contrast.n_pixels,
        measured.raw.contrast,
        measured.has_target,
        measured.pattern,
        notes=tuple(notes),
        withheld=measured.withheld,
        likeness=measured.likeness,
        blur_px=measured.blur_px,
        left=measured.left,
        better=measured.better,
        displacement_px=measured.displacement_px,
    )
    if lasers is None or measured.withheld:
        return plain
    shown = None
    if target is not None and measured.has_target:
        shown = shown_target(displaced(target, measured.displacement_px), region, measured.blur_px)
    return _with_lasers(plain, lasers, shown)


def _notes_beside_target(measured: LuminanceContrast) -> Iterator[str]:
    """What is doubtful of a contrast beside a target, and where the target was moved to."""
    if any(measured.displacement_px):
        down, right = measured.displacement_px
        yield f"the target was moved to where it fits, {right} samples to the right and {down} down"
    if not measured.has_target:
        return
    if measured.doubt:
        yield measured.doubt
    alike = measured.likeness
    if alike is not None and math.isfinite(alike.standard_error) and alike.at_least < 0:
        yield (
            f"whether the target is shown can't be told here: the picture has {100 * alike.share:.0f} ± "
            f"{100 * alike.standard_error:.0f} % of its structure; structure of another kind would count as speckle"
        )
    for of, what in () if measured.left is None else measured.left.doubtful:
        yield (
            f"{100 * of.share:.0f} ± {100 * of.standard_error:.0f} % of the variance beside the target {what}, which "
            "speckle doesn't: the contrast comes out too high"
        )


def _with_lasers(
    plain: SpeckleMeasurement,
    lasers: LaserImages,
    shown: Floats | None,
) -> SpeckleMeasurement:
    """Adds what is known of each laser. shown: of a target (y, x, 3), in the region."""
    window = region_slices(plain.region)
    parts = np.asarray(lasers.intensity[:, *window], dtype=np.float64)
    powers = parts.mean(axis=(1, 2))
    luminances = powers * lasers.luminances
    lit = [int(i) for i in np.flatnonzero(luminances > 0)]
    if not lit:
        return plain
    patterns = [laser_pattern(parts[i], shown) for i in lit]
    estimates = [contrast_estimate(pattern, lasers.noise) for pattern in patterns]
    shares = luminances[lit] / luminances[lit].sum()
    usable = reduce(np.logical_and, (pattern.usable for pattern in patterns))
    if usable.sum() < 2:
        raise UserError("region", "lasers that share no lit pixels", expected="a region that all of them light")
    relative = np.stack([pattern.values[usable] / pattern.values[usable].mean() for pattern in patterns])
    contrasts = np.array([estimate.contrast for estimate in estimates])
    correlation = _correlation(relative, contrasts)
    dark = len(powers) - len(lit)
    notes: tuple[str, ...] = (f"{dark} of {len(powers)} lasers have no light that is seen here",) if dark else ()
    colour, independent_colour = None, None
    if lasers.colours is not None and np.linalg.matrix_rank(lasers.colours[lit]) > 1:  # else all have one colour
        means = powers[lit, None] * lasers.colours[lit]
        of_noise = None
        if lasers.noise is not None:
            relative_noise = [_relative_noise(pattern, usable, lasers.noise) for pattern in patterns]
            of_noise = np.stack(relative_noise)[..., None] * means[:, None, :]
        gain_error = 0.0 if lasers.noise is None else lasers.noise.gain_error
        colour = colour_speckle(relative.T @ means, plain.luminance.grains.count, of_noise, gain_error)
        independent_colour = colour_speckle(independent_colours(means, contrasts))
        if colour is None or colour.is_noise:
            share = "" if colour is None else f": of the variance of u'v' it makes {100 * colour.noise_share:.0f} %"
            notes += (f"the camera's noise hides the colour speckle{share}",) if of_noise is not None else ()
            colour = None
        elif colour.too_dark > _MOST_TOO_DARK:
            notes += (
                f"{colour.too_dark:.0%} of the pixels don't exceed five times their noise: the colour speckle is that "
                "of the others",
            )
    wavelengths = [None] * len(powers) if lasers.wavelengths_m is None else lasers.wavelengths_m.tolist()
    return replace(
        plain,
        lasers=tuple(
            LaserContrast(lasers.names[i], wavelengths[i], float(share), estimate)
            for i, share, estimate in zip(lit, shares, estimates, strict=True)
        ),
        groups=_groups([lasers.groups[i] for i in lit], shares, patterns, lasers.noise),
        correlation=correlation,
        pattern_errors=_pattern_errors(patterns, usable, shares, contrasts, correlation),
        colour=colour,
        independent_colour=independent_colour,
        notes=(*plain.notes, *notes),
    )


def _relative_noise(pattern: SpecklePattern, usable: NDArray[np.bool_], noise: PixelNoise) -> Floats:
    """Standard deviation (n,) of the noise of the usable values of a pattern over their mean."""
    return np.sqrt(noise_variance(pattern, noise)[usable]) / float(pattern.values[usable].mean())


def laser_pattern(intensity: Floats, basis: Floats | None) -> SpecklePattern:
    """The speckle of one laser, or of some (y, x), over the mixture of a target's channels (y, x, 3) that fits best."""
    if basis is None:
        return speckle_pattern(intensity)
    q, r = np.linalg.qr(basis.reshape(-1, 3))
    mixture, _ = nnls(r, q.T @ intensity.ravel())
    structure = basis @ mixture
    return speckle_pattern(intensity, target=structure if structure.max() > 0 else None)


def _groups(
    groups: Sequence[str], shares: Floats, patterns: Sequence[SpecklePattern], noise: PixelNoise | None
) -> dict[str, ContrastEstimate]:
    """The contrast of the luminance of the lasers of each group that has any, without a camera's noise.

    groups: of each laser.
    """
    found = {}
    for name in GROUPS:
        own = [i for i, group in enumerate(groups) if group == name]
        if len(own) == 1:
            found[name] = contrast_estimate(patterns[own[0]], noise)
        elif own:
            usable = reduce(np.logical_and, (patterns[i].usable for i in own))
            weights = [shares[i] / patterns[i].contrast.mean for i in own]
            values = sum(weight * patterns[i].values for weight, i in zip(weights, own, strict=True))
            of_sum = None
            if noise is not None:
                parts = [w**2 * noise_variance(patterns[i], noise) for w, i in zip(weights, own, strict=True)]
                of_sum = SumNoise(np.sum(parts, axis=0), noise.gain_error)
            found[name] = contrast_estimate(SpecklePattern(np.asarray(values), usable), of_sum)
    return found


def _correlation(relative: Floats, contrasts: Floats) -> Floats:
    """Correlations (laser, laser) of patterns (laser, n) of mean 1, their contrasts free of a camera's noise.

    An even pattern correlates with itself alone.
    """
    difference = relative - 1.0
    covariance = difference @ difference.T / relative.shape[1]
    scale = np.outer(contrasts, contrasts)
    found: Floats = np.divide(covariance, scale, out=np.zeros_like(covariance), where=scale > 0)
    found = np.clip(found, -1.0, 1.0)
    np.fill_diagonal(found, 1.0)
    return found


def _pattern_errors(
    patterns: Sequence[SpecklePattern],
    usable: NDArray[np.bool_],
    shares: Floats,
    contrasts: Floats,
    correlation: Floats,
) -> tuple[float, float]:
    """Standard errors of N_eff from powers and from the correlations, as the docstring of the module derives them.

    usable: (y, x), where all patterns are. shares: of the luminance. contrasts: free of a camera's noise.
    """
    alike = correlation @ shares
    whole, squares = float(shares @ alike), float(shares @ shares)
    by_powers, by_means, sums, squared = (np.zeros(usable.shape) for _ in range(4))
    for pattern, share, contrast, own in zip(patterns, shares, contrasts, alike, strict=True):
        unit = np.where(pattern.usable, pattern.unit, 0.0)
        light = pattern.values * unit
        change = 2 * share * (light / light.sum() - unit / unit.sum())
        by_powers += (1 - share / squares) * change
        by_means += (1 - own / whole) * change
        if contrast > 0:
            scaled = np.where(usable, pattern.values / pattern.values[usable].mean() - 1, 0.0) / contrast
            sums += share * scaled
            squared += share * own * scaled**2
    of_correlation = (sums**2 - squared) / whole
    of_correlation = np.where(usable, of_correlation - of_correlation[usable].mean(), 0.0) / usable.sum()
    return error_by_blocks(by_powers) / squares, error_by_blocks(by_means - of_correlation) / whole
