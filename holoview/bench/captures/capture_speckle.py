"""Speckle contrast of the pictures of a capture file, without the noise that its camera's data sheet states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from holoview.bench.captures.dataset import Captures
from holoview.holograms.metrics.grains import ContrastEstimate, PixelNoise, contrast_estimate
from holoview.holograms.metrics.speckle import SpecklePattern
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
        values = np.array([estimate.contrast for estimate in own])
        error = own[0].standard_error if len(own) == 1 else float(values.std(ddof=1) / math.sqrt(len(own)))
        means.append(MeanContrast(wavelength_m, float(values.mean()), error, len(own)))
    return means
