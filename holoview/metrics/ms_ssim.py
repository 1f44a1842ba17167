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
from numpy.typing import ArrayLike

from holoview.colour import gamut_map, srgb_encode
from holoview.metrics.plane_scores import PlaneScores, Stack, as_stacks
from holoview.numerics.structural_similarity import WINDOW, multi_scale_similarity, scale_count
from holoview.util.errors import UserError


@dataclass(frozen=True)
class MsSsim(PlaneScores):
    """MS-SSIM of an image or a focal stack, 1 for equal ones.

    scales: number of scales, 5 from 176 rows and columns on. Values of different numbers can't be compared.
    """

    scales: int


def ms_ssim(image: ArrayLike, target: ArrayLike) -> MsSsim:
    """MS-SSIM of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3): the mean over channels.

    Raises UserError when the shapes differ, aren't those of images, or have fewer than 11 rows or columns.
    """
    values, expected = as_stacks(image, target)
    scales = scale_count((values.shape[-3], values.shape[-2]))
    if scales == 0:
        found = f"{values.shape[-2]} x {values.shape[-3]} samples"
        raise UserError("image", found, expected=f"at least {WINDOW} rows and columns for MS-SSIM")
    pairs = zip(_signals(values), _signals(expected), strict=True)
    planes = tuple(float(multi_scale_similarity(seen, wanted).mean()) for seen, wanted in pairs)
    return MsSsim(float(np.mean(planes)), planes, scales)


def _signals(light: Stack) -> torch.Tensor:
    """The display signals (plane, channel, y, x), 0…1, of light (plane, y, x, 3)."""
    signal = srgb_encode(gamut_map(light))
    return torch.from_numpy(np.ascontiguousarray(np.moveaxis(signal, -1, 1)))
