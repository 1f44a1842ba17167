"""Uniformity of the light in the eyebox, the area in the pupil plane from which the image can be seen.

PSNR alone is misleading: a smooth phase sends the light through a small spot in the middle of the eyebox, which avoids
speckle and gains several decibels, but the image disappears when the eye moves, and it hardly blurs out of focus. A
hologram is better only if its PSNR is higher at equal uniformity.

The eyebox of a diffuse hologram is itself speckled, so that the intensity at a point says nothing. The measures are of
means over blocks; a mean of n independent samples of fully developed speckle still has a relative deviation of 1/√n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.util.errors import UserError

CENTRE_DIVISOR = 8
"""The centre, whose relative intensity is reported, is 1/CENTRE_DIVISOR of the eyebox wide and high."""


@dataclass(frozen=True)
class EyeboxUniformity:
    """Measures of the block means, and of the centre.

    coefficient_of_variation: standard deviation of the block means over their mean; 0 for uniform light.
    uniformity: the darkest block mean over their mean; 1 for uniform light, 0 when a block is dark.
    centre_share: mean intensity of the central 1/8 × 1/8 over that of the whole; 1 for uniform light, at most 64.
    """

    coefficient_of_variation: float
    uniformity: float
    centre_share: float


def eyebox_uniformity(eyebox: ArrayLike, blocks: int = 8, envelope: ArrayLike | None = None) -> EyeboxUniformity:
    """Uniformity of the intensity (y, x) over the eyebox, zero frequency at index N//2 as with `fftshift`.

    envelope: (y, x), positive; divided out first. It is the sinc² of the modulator's pixel, which no hologram can
    change. Crop both to the band of the modulator, |f| ≤ 1/(2·pitch), beyond which the envelope falls to zero.
    blocks: number of blocks along each axis; their sizes differ by a sample where it doesn't divide the shape.
    Raises UserError for fewer samples than blocks, an envelope that doesn't fit or isn't positive, and no light.
    """
    light = np.asarray(eyebox, dtype=np.float64)
    if light.ndim != 2 or blocks < 1 or min(light.shape) < blocks:
        raise UserError("eyebox", f"shape {light.shape}", expected=f"(y, x) of at least {blocks} samples, a block each")
    if envelope is not None:
        light = light / _checked_envelope(envelope, light.shape)
    if not light.mean() > 0.0:
        raise UserError("eyebox", f"mean intensity {light.mean():g}", expected="some light")
    means = _block_means(light, blocks)
    return EyeboxUniformity(
        coefficient_of_variation=float(means.std() / means.mean()),
        uniformity=float(means.min() / means.mean()),
        centre_share=float(light[_central_slice(light.shape[0]), _central_slice(light.shape[1])].mean() / light.mean()),
    )


def _checked_envelope(envelope: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    values = np.asarray(envelope, dtype=np.float64)
    if values.shape != shape:
        raise UserError("envelope", f"shape {values.shape}", expected=f"the eyebox's shape, {shape}")
    if not values.min() > 0.0:
        raise UserError(
            "envelope",
            f"least value {values.min():g}",
            expected="positive everywhere",
            remedy="crop to |f| ≤ 1/(2·pitch)",
        )
    return values


def _block_means(light: NDArray[np.float64], blocks: int) -> NDArray[np.float64]:
    """Means (blocks, blocks) over blocks whose sides differ by one sample at most."""
    rows, columns = (np.arange(blocks) * n // blocks for n in light.shape)
    sums = np.add.reduceat(np.add.reduceat(light, rows, axis=0), columns, axis=1)
    heights, widths = np.diff(rows, append=light.shape[0]), np.diff(columns, append=light.shape[1])
    means: NDArray[np.float64] = sums / np.outer(heights, widths)
    return means


def _central_slice(n: int) -> slice:
    """The central 1/CENTRE_DIVISOR of n samples, at least one, around zero frequency at n//2."""
    width = max(1, round(n / CENTRE_DIVISOR))
    start = n // 2 - width // 2
    return slice(start, start + width)
