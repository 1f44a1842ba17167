"""Multi-scale structural similarity (MS-SSIM) of what a screen shows, and of what it should.

Speckle, blur and lost detail lower it; an error of brightness that is even over a neighbourhood hardly does. So read it
beside the PSNR or the colour difference. It is computed of encoded sRGB clipped to 0…1, since its constants are made
for a display signal, channel by channel, as `holoview.numerics.structural_similarity` states with its source. Nothing
is fitted: brightness counts as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from holoview.colour import gamut_map, srgb_encode
from holoview.numerics.structural_similarity import WINDOW, multi_scale_similarity, scale_count
from holoview.util.errors import UserError


@dataclass(frozen=True)
class MsSsim:
    """MS-SSIM of an image or a focal stack, 1 for equal ones: mean over planes, and of each plane.

    scales: number of scales, 5 from 176 rows and columns on. Values of different numbers can't be compared.
    """

    mean: float
    planes: tuple[float, ...]
    scales: int


def ms_ssim(image: ArrayLike, target: ArrayLike) -> MsSsim:
    """MS-SSIM of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3): the mean over channels.

    Raises UserError when the shapes differ, aren't those of images, or have fewer than 11 rows or columns.
    """
    values, expected = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if values.shape != expected.shape or values.ndim not in (3, 4) or values.shape[-1] != 3:
        shape = f"(y, x, 3) or (plane, y, x, 3) as the target, {expected.shape}"
        raise UserError("image", f"shape {values.shape}", expected=shape)
    scales = scale_count((values.shape[-3], values.shape[-2]))
    if scales == 0:
        found = f"{values.shape[-2]} x {values.shape[-3]} samples"
        raise UserError("image", found, expected=f"at least {WINDOW} rows and columns for MS-SSIM")
    pairs = zip(_signals(values), _signals(expected), strict=True)
    planes = tuple(float(multi_scale_similarity(seen, wanted).mean()) for seen, wanted in pairs)
    return MsSsim(float(np.mean(planes)), planes, scales)


def _signals(light: NDArray[np.float64]) -> torch.Tensor:
    """The display signals (plane, channel, y, x), 0…1."""
    signal = srgb_encode(gamut_map(light.reshape(-1, *light.shape[-3:])))
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(signal, -1, 1)))
