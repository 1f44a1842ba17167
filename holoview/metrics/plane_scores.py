"""What scores of whole images have in common: images as stacks of planes, and a score of each plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.util.errors import UserError

Stack = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneScores:
    """A score of an image or a focal stack: mean over planes, and of each plane."""

    mean: float
    planes: tuple[float, ...]


def as_stacks(image: ArrayLike, target: ArrayLike) -> tuple[Stack, Stack]:
    """An image and its target, (y, x, 3) or (plane, y, x, 3), as (plane, y, x, 3).

    Raises UserError when the shapes differ or aren't those of images.
    """
    values, expected = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if values.shape != expected.shape or values.ndim not in (3, 4) or values.shape[-1] != 3 or values.size == 0:
        shape = f"(y, x, 3) or (plane, y, x, 3) as the target, {expected.shape}, not empty"
        raise UserError("image", f"shape {values.shape}", expected=shape)
    return values.reshape(-1, *values.shape[-3:]), expected.reshape(-1, *expected.shape[-3:])
