"""The contrast of a luminance beside its target, and whether the picture shows the target at all.

Only of a picture I = g·T·s that shows its target T can the structure of T be divided out. With I and T of the region
over their means, x = T − 1 and y = I − 1, the share of the target's structure that the picture has is the slope

    b = Σ x·y / Σ x²

of the picture on the target: 1 where the speckle s is independent of T, 0 where the picture is, and m/(m + c) for a
target of mean m in even stray light c. Its standard error is that of a ratio of sums over blocks: Σ_k (n_k − b·d_k)²
over (Σ d_k)² is its square, n and d being the sums of x·y and x² in each of 8 × 8 blocks. A contrast is withheld where

    b is below a half by more than two standard errors, or
    I/(g·T) has a larger contrast than I by more than 5 %: division adds structure, as by a target that is out of focus
    or elsewhere, where of I = g·T·s it would leave C of C² + C_T²·(1 + C²).

A target with hardly any structure decides nothing, and changes nothing: division by a T that isn't shown raises C by
about C_T²/2C, which exceeds the standard error of C, C/√(2n) of n grains, only where b is known to C/(C_T·√n) =
(2n)^(−1/4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.grains import ContrastEstimate, PixelNoise, SumNoise, contrast_estimate
from holoview.holograms.metrics.speckle import SpeckleContrast, SpecklePattern, speckle_pattern, target_luminance
from holoview.light.numerics.sampling import Region, region_slices

LEAST_SHARE = 0.5
"""Share of a target's structure below which, by two standard errors, a picture doesn't show it."""

_BLOCKS, _SIGMAS = 8, 2.0
_MOST_ADDED = 1.05  # of the contrast by division


@dataclass(frozen=True)
class Likeness:
    """How much of a target's structure a picture has. standard_error: of the share; infinite of an even target."""

    share: float
    standard_error: float


@dataclass(frozen=True, eq=False)
class LuminanceContrast:
    """The speckle contrast of a region's luminance.

    estimate: of `pattern`, without the structure of a target where `has_target`. raw: with the structure of the
    picture. withheld: why the contrast isn't to be stated, "" where it is; `estimate` is then the raw one.
    likeness: to the target; None without one.
    """

    estimate: ContrastEstimate
    pattern: SpecklePattern
    raw: SpeckleContrast
    has_target: bool
    withheld: str = ""
    likeness: Likeness | None = None


def luminance_contrast(
    luminance: NDArray[np.floating],
    region: Region,
    target: NDArray[np.floating] | None = None,
    noise: PixelNoise | SumNoise | None = None,
) -> LuminanceContrast:
    """The contrast of a region of a luminance (y, x), as viewer, page, `contrast` and `report` state it.

    target: (y, x, 3) in linear sRGB, whose structure is divided out unless it is black in the region. noise: of a
    camera's pixels in the luminance, which is taken off. Raises UserError as `speckle_contrast` does.
    """
    noise = noise.within(region) if isinstance(noise, SumNoise) else noise
    plain = speckle_pattern(luminance, region)
    raw = plain.contrast
    known = None if target is None else target_luminance(target, region)
    if known is None:
        return LuminanceContrast(contrast_estimate(plain, noise), plain, raw, False)
    pattern = speckle_pattern(luminance, region, known)
    window = region_slices(region)
    alike = likeness(luminance[window], known[window])
    if reason := _why_withheld(alike, pattern.contrast.contrast, raw.contrast):
        return LuminanceContrast(contrast_estimate(plain, noise), plain, raw, False, reason, alike)
    return LuminanceContrast(contrast_estimate(pattern, noise), pattern, raw, True, "", alike)


def _why_withheld(alike: Likeness, divided: float, raw: float) -> str:
    """Why a contrast isn't to be stated; "" where it is."""
    if alike.share + _SIGMAS * alike.standard_error < LEAST_SHARE:
        return (
            f"the picture doesn't show the target here: it has {100 * alike.share:.0f} ± "
            f"{100 * alike.standard_error:.0f} % of its structure"
        )
    if divided > _MOST_ADDED * raw:
        return (
            f"the target isn't what is shown here: division by it raises the contrast from {raw:.3f} to {divided:.3f}, "
            "and would lower that of a picture which shows it"
        )
    return ""


def likeness(luminance: NDArray[np.floating], target: NDArray[np.floating]) -> Likeness:
    """How much of the structure of a target's luminance (y, x) that of a picture (y, x) has; both of one region."""
    x, y = (np.asarray(of, dtype=np.float64) for of in (target, luminance))
    if not (x.mean() > 0 and y.mean() > 0):
        return Likeness(0.0, math.inf)
    x, y = x / x.mean() - 1, y / y.mean() - 1
    products, squares = _block_sums(x * y), _block_sums(x * x)
    total = float(squares.sum())
    if total <= 1e-12 * x.size:
        return Likeness(0.0, math.inf)
    share = float(products.sum()) / total
    return Likeness(share, float(np.linalg.norm(products - share * squares)) / total)


def _block_sums(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over 8 × 8 blocks, or over as many as there are samples each way."""
    rows, columns = (np.arange(min(_BLOCKS, n)) * n // min(_BLOCKS, n) for n in values.shape)
    return np.asarray(np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1))
