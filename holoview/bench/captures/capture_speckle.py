"""Speckle contrast of the pictures of a capture file, without the noise that its camera's data sheet states."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.holograms.metrics.colour_speckle import mean_colour
from holoview.holograms.metrics.grains import ContrastEstimate, PixelNoise, SumNoise, contrast_estimate
from holoview.holograms.metrics.speckle import SpecklePattern
from holoview.holograms.metrics.speckle_measurement import SpeckleMeasurement, images_of_lasers, measure_speckle
from holoview.light.colour import observer_weights
from holoview.light.numerics.sampling import Region, region_slices
from holoview.util.errors import UserError


@dataclass(frozen=True)
class CaptureContrast:
    """The contrast of one capture. saturated: share of its pixels in the region."""

    index: int
    wavelength_m: float
    distance_m: float
    estimate: ContrastEstimate
    saturated: float

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "capture": self.index,
            "wavelength_nm": round(self.wavelength_m * 1e9, 6),
            "distance_mm": round(self.distance_m * 1e3, 6),
            "contrast": self.estimate.contrast,
            "standard_error": self.estimate.standard_error,
            "independent_grains": self.estimate.grains.count,
            "saturated": self.saturated,
        }


@dataclass(frozen=True)
class MeanContrast:
    """The mean contrast of captures of one laser, and its standard error.

    The error is that of the scatter between captures, or for a single one that of its grains.
    """

    wavelength_m: float
    contrast: float
    standard_error: float
    count: int

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "wavelength_nm": round(self.wavelength_m * 1e9, 6),
            "contrast": self.contrast,
            "standard_error": self.standard_error,
            "captures": self.count,
        }


def capture_noise(captures: Captures) -> tuple[PixelNoise | None, tuple[str, ...]]:
    """The noise of the pixels by the camera's data sheet, and a sentence where that doesn't tell."""
    camera = captures.camera
    if math.isnan(camera.electrons_per_count):
        return None, ("the file doesn't tell the electrons a count: the camera's noise isn't taken off",)
    notes: tuple[str, ...] = ()
    read_electrons = camera.read_noise
    if math.isnan(read_electrons):
        read_electrons, notes = 0.0, ("the file doesn't tell the read noise, which isn't taken off",)
    read = math.hypot(read_electrons / camera.electrons_per_count, 12**-0.5)
    return PixelNoise(camera.electrons_per_count, read), notes


def contrast_of_captures(captures: Captures, region: Region, noise: PixelNoise | None) -> list[CaptureContrast]:
    """The contrast of each capture in a region (x, y, width, height), of pixels that the file's mask lets count.

    Raises UserError for a region that is dark or of a single pixel in a capture, and for a black level that isn't told.
    """
    black = captures.camera.black_level
    if math.isnan(black):
        raise UserError("camera attribute black_level", "is unknown", expected="counts of a pixel without light")
    window, found = region_slices(region), []
    for index in range(len(captures)):
        counts = captures.images[index][window].astype(np.float64)
        usable = np.ones(counts.shape, bool) if captures.usable is None else np.asarray(captures.usable[index][window])
        pattern = SpecklePattern(counts - black, usable)
        try:
            estimate = contrast_estimate(pattern, noise)
        except UserError as error:
            raise error.inside(f"capture {index}: ") from error
        saturated = float((counts[usable] >= captures.camera.saturation).mean())
        place = float(captures.wavelength_m[index]), float(captures.distance_m[index])
        found.append(CaptureContrast(index, *place, estimate, saturated))
    return found


def mean_by_laser(found: list[CaptureContrast]) -> list[MeanContrast]:
    """The means over the captures of each wavelength, in rising order."""
    means = []
    for wavelength_m in sorted({of.wavelength_m for of in found}):
        own = [of.estimate for of in found if of.wavelength_m == wavelength_m]
        means.append(MeanContrast(wavelength_m, *_mean_and_error(own), len(own)))
    return means


def _mean_and_error(estimates: Sequence[ContrastEstimate]) -> tuple[float, float]:
    """The mean contrast, and its standard error by the scatter, or of a single estimate by its grains."""
    values = [estimate.contrast for estimate in estimates]
    return float(np.mean(values)), _error_of_mean(values) if len(values) > 1 else estimates[0].standard_error


def _error_of_mean(values: Sequence[float]) -> float:
    """The standard error of the mean of two values or more, by their scatter."""
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


# --- lasers together --------------------------------------------------------------------------------------------------


def capture_sets(captures: Captures) -> list[list[int]]:
    """Captures that show equal patterns at equal distances, one of each of two lasers or more, by rising wavelength."""
    by_picture: dict[tuple[float, bytes], dict[float, int]] = {}
    for index in range(len(captures)):
        key = float(captures.distance_m[index]), captures.levels[index].tobytes()
        by_picture.setdefault(key, {}).setdefault(float(captures.wavelength_m[index]), index)
    return [[index for _, index in sorted(of.items())] for of in by_picture.values() if len(of) > 1]


def measure_set(
    captures: Captures, chosen: Sequence[int], region: Region, noise: PixelNoise | None, observer: str = "eye"
) -> SpeckleMeasurement:
    """All lasers of a set together: their captures added as an observer weighs them, for equal exposures.

    The camera is taken to respond alike to all lasers. Raises UserError for a region without light, and for lasers that
    the observer's table doesn't reach.
    """
    wavelengths_m, exposures_s = captures.wavelength_m[chosen], captures.exposure_s[chosen]
    counts = captures.images[list(chosen)].astype(np.float64) - captures.camera.black_level
    colours = observer_weights(observer, wavelengths_m) * (exposures_s.max() / exposures_s)[:, None]
    lasers = replace(images_of_lasers(wavelengths_m, colours, counts), noise=noise)
    luminance = np.tensordot(lasers.luminances, counts, axes=1)
    of_sum = noise and SumNoise.of(lasers.luminances, counts, noise)
    return measure_speckle(luminance, region, None, lasers, of_sum)


@dataclass(frozen=True, eq=False)
class TogetherContrast:
    """What sets of captures of the same lasers have together.

    count: of the sets. found: each number is the mean over them, with the standard error of the scatter between sets,
    or for a single set that of its grains; grains and pixels add up. pattern, and the scatter of colours: of the first.
    left_out: how many sets have other lasers.
    """

    count: int
    found: SpeckleMeasurement
    left_out: int = 0

    @staticmethod
    def of(sets: Iterable[SpeckleMeasurement]) -> TogetherContrast:
        """The means over sets, at least one; those of other lasers than most of them are left out."""
        by_lasers: dict[tuple[str, ...], list[SpeckleMeasurement]] = {}
        for one in sets:
            alike = by_lasers.setdefault(tuple(laser.name for laser in one.lasers), [])
            alike.append(_without_samples(one, alike[0]) if alike else one)
        most = max(by_lasers.values(), key=lambda alike: (len(alike), len(alike[0].lasers)))
        return TogetherContrast(len(most), _mean_measurement(most), sum(map(len, by_lasers.values())) - len(most))

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {"sets": self.count, "sets_of_other_lasers": self.left_out, **self.found.as_json()}

    def in_words(self) -> str:
        """For people, in a line."""
        contrast = self.found.luminance
        return (
            f"all lasers together: speckle contrast {contrast.contrast:.4f} +- {contrast.standard_error:.2g}, mean of "
            f"{self.count} {'sets' if self.count > 1 else 'set'} of captures with equal patterns, of "
            f"{contrast.grains.count:.0f} independent grains"
        )


def _without_samples(one: SpeckleMeasurement, first: SpeckleMeasurement) -> SpeckleMeasurement:
    """A measurement whose pixels are no longer held: those of the first are shown."""
    colour, independent = (of and of.without_samples() for of in (one.colour, one.independent_colour))
    return replace(one, pattern=first.pattern, colour=colour, independent_colour=independent)


def _mean_measurement(sets: Sequence[SpeckleMeasurement]) -> SpeckleMeasurement:
    """The mean over sets of the same lasers; the notes are those of the set that has most of them."""
    first = sets[0]
    if len(sets) == 1:
        return first
    lasers = [
        replace(
            laser,
            luminance_share=float(np.mean([of.lasers[i].luminance_share for of in sets])),
            estimate=_mean_estimate([of.lasers[i].estimate for of in sets]),
        )
        for i, laser in enumerate(first.lasers)
    ]
    return replace(
        first,
        luminance=_mean_estimate([of.luminance for of in sets]),
        mean=float(np.mean([of.mean for of in sets])),
        pixels=sum(of.pixels for of in sets),
        raw_contrast=float(np.mean([of.raw_contrast for of in sets])),
        lasers=tuple(lasers),
        groups={name: _mean_estimate([of.groups[name] for of in sets]) for name in first.groups},
        correlation=np.mean([of.correlation for of in sets], axis=0),
        colour=mean_colour([of.colour for of in sets]),
        independent_colour=mean_colour([of.independent_colour for of in sets]),
        notes=max(sets, key=lambda of: len(of.notes)).notes,
        pattern_errors=(
            _error_of_mean([of.patterns_of_powers for of in sets]),
            _error_of_mean([of.patterns_of_correlation for of in sets]),
        ),
    )


def _mean_estimate(estimates: Sequence[ContrastEstimate]) -> ContrastEstimate:
    grains = estimates[0].grains
    count = sum(of.grains.count for of in estimates)
    share = float(np.mean([of.noise_share for of in estimates]))
    return ContrastEstimate(*_mean_and_error(estimates), replace(grains, count=count), share)
