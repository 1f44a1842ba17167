"""Speckle contrast of the pictures of a capture file, without the noise that its camera's data sheet states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from holoview.bench.captures.dataset import Captures
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
    values = np.array([estimate.contrast for estimate in estimates])
    scatter = values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else estimates[0].standard_error
    return float(values.mean()), float(scatter)


# --- lasers together --------------------------------------------------------------------------------------------------


def capture_sets(captures: Captures) -> list[list[int]]:
    """Captures that show equal patterns at equal distances, one of each of two lasers or more, by rising wavelength."""
    by_picture: dict[tuple[float, bytes], dict[float, int]] = {}
    for index in range(len(captures)):
        key = float(captures.distance_m[index]), captures.levels[index].tobytes()
        by_picture.setdefault(key, {}).setdefault(float(captures.wavelength_m[index]), index)
    return [[index for _, index in sorted(of.items())] for of in by_picture.values() if len(of) > 1]


def measure_set(
    captures: Captures, chosen: Sequence[int], region: Region, noise: PixelNoise | None
) -> SpeckleMeasurement:
    """All lasers of a set together: their captures added as the observer "eye" weighs them, for equal exposures.

    The camera is taken to respond alike to all lasers. Raises UserError for a region without light.
    """
    wavelengths_m, exposures_s = captures.wavelength_m[chosen], captures.exposure_s[chosen]
    counts = captures.images[list(chosen)].astype(np.float64) - captures.camera.black_level
    colours = observer_weights("eye", wavelengths_m) * (exposures_s.max() / exposures_s)[:, None]
    lasers = replace(images_of_lasers(wavelengths_m, colours, counts), noise=noise)
    luminance = np.tensordot(lasers.luminances, counts, axes=1)
    of_sum = noise and SumNoise.of(lasers.luminances, counts, noise)
    return measure_speckle(luminance, region, None, lasers, of_sum)


@dataclass(frozen=True)
class TogetherContrast:
    """Means over sets of captures.

    count: of the sets. contrast: of the luminance, and its standard error, by the scatter between sets, or for a single
    one by its grains. groups: contrasts of lasers by the names of their groups.
    """

    count: int
    contrast: float
    standard_error: float
    one_by_one: float
    groups: dict[str, float]
    patterns_of_powers: float
    patterns_of_correlation: float

    @staticmethod
    def of(found: Sequence[SpeckleMeasurement]) -> TogetherContrast:
        """The means over sets, at least one."""
        contrast, error = _mean_and_error([one.luminance for one in found])
        names = [name for name in found[0].groups if all(name in one.groups for one in found)]
        groups = {name: float(np.mean([one.groups[name].contrast for one in found])) for name in names}
        means = [
            float(np.mean([getattr(one, name) for one in found]))
            for name in ("one_by_one", "patterns_of_powers", "patterns_of_correlation")
        ]
        return TogetherContrast(len(found), contrast, error, means[0], groups, means[1], means[2])

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "sets": self.count,
            "contrast": self.contrast,
            "standard_error": self.standard_error,
            "one_by_one_contrast": self.one_by_one,
            "groups": self.groups,
            "n_eff_powers": self.patterns_of_powers,
            "n_eff_correlation": self.patterns_of_correlation,
        }

    def in_words(self) -> str:
        """For people."""
        groups = ", ".join(f"{name} {contrast:.4f}" for name, contrast in self.groups.items())
        return (
            f"all lasers together: speckle contrast {self.contrast:.4f} +- {self.standard_error:.2g}, mean of "
            f"{self.count} {'sets' if self.count > 1 else 'set'} of captures with equal patterns; from the lasers one "
            f"by one, taken as independent: {self.one_by_one:.4f}\n"
            f"independent patterns: {self.patterns_of_powers:.2f} from powers, {self.patterns_of_correlation:.2f} from "
            f"correlations; groups: {groups}"
        )
