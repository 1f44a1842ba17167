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

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.numerics.image_region import Region, region_slices
from holoview.util.errors import UserError

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


def speckle_contrast(
    intensity: ArrayLike, region: Region | None = None, target: ArrayLike | None = None
) -> SpeckleContrast:
    """Speckle contrast of an intensity image (y, x), in a region if given, relative to a target (y, x) if given.

    Pixels inside one speckle grain are correlated: the estimate is noisier than n_pixels suggests, and too low in a
    region of few grains. Raises UserError for an image that isn't (y, x), a region that is empty or outside, a target
    of another shape, and when fewer than two pixels with light remain.
    """
    image = np.asarray(intensity, dtype=np.float64)
    if image.ndim != 2 or image.size == 0:
        raise UserError("image", f"shape {image.shape}", expected="one channel, (y, x)", remedy="take its luminance")
    window = _checked_slices(region, image.shape[1], image.shape[0])
    values = image[window].ravel()
    if target is not None:
        target_image = np.asarray(target, dtype=np.float64)
        if target_image.shape != image.shape:
            raise UserError("target", f"shape {target_image.shape}", expected=f"the image's shape, {image.shape}")
        values = _ratio_to_target(values, target_image[window].ravel())
    mean = float(values.mean()) if values.size > 1 else 0.0
    if not mean > 0.0:
        raise UserError(
            "region",
            f"{values.size} usable pixels of mean {mean:g}",
            expected="two or more pixels with light on them",
            remedy="choose a larger or brighter region",
        )
    std = float(values.std())
    return SpeckleContrast(contrast=std / mean, mean=mean, std=std, n_pixels=values.size)


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


def _ratio_to_target(values: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """The ratio I/(g·T) of the pixels whose target isn't too dark; empty when there are none."""
    bright = (target > 0.0) & (target >= TARGET_FLOOR * target.mean())
    values, target = values[bright], target[bright]
    gain = values.sum() / target.sum() if values.size else 0.0
    return values / (gain * target) if gain > 0.0 else np.zeros(0)
