"""Peak signal-to-noise ratio at fixed brightness.

    PSNR = 10·log10(peak² / MSE)    dB, the mean square error over every pixel and channel

Fixed brightness: image and target are compared as they are, with Y = 1 the display's white, and no free scale factor is
fitted. Scaling both images by s moves the PSNR by −20·log10 s dB (a target at half the brightness "gains" 6 dB), and a
factor fitted per image would reward a dim hologram, so numbers from different target brightnesses don't compare.

A focal stack is scored plane by plane and the decibels averaged, so that a plane of large errors doesn't hide how the
others do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.colour import gamut_map
from holoview.util.errors import UserError


@dataclass(frozen=True)
class Psnr:
    """PSNR (dB) of an image or a focal stack: the mean over planes, and each plane's own."""

    mean_db: float
    planes_db: tuple[float, ...]


def psnr(image: ArrayLike, target: ArrayLike, peak: float = 1.0) -> float:
    """PSNR (dB) of two arrays of the same shape, the error averaged over everything; identical arrays give inf.

    Raises UserError when the shapes differ.
    """
    found, wanted = _checked_pair(image, target)
    error = float(np.mean((found - wanted) ** 2))
    return float(20.0 * np.log10(peak) - 10.0 * np.log10(error)) if error != 0.0 else float("inf")


def psnr_linear_srgb(image: ArrayLike, target: ArrayLike) -> Psnr:
    """PSNR of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3), both clipped to 0…1 as a screen would.

    Raises UserError when the shapes differ or aren't those of images.
    """
    found, wanted = _as_stacks(image, target)
    return _psnr_per_plane(gamut_map(found), gamut_map(wanted))


def psnr_xyz(image: ArrayLike, target: ArrayLike) -> Psnr:
    """PSNR of XYZ images (y, x, 3) or stacks (plane, y, x, 3) with peak 1, not clipped: colours no screen shows count.

    Raises UserError when the shapes differ or aren't those of images.
    """
    return _psnr_per_plane(*_as_stacks(image, target))


def psnr_luminance(image: ArrayLike, target: ArrayLike) -> Psnr:
    """PSNR of the luminance Y of XYZ images (y, x, 3) or stacks (plane, y, x, 3) with peak 1, not clipped.

    Raises UserError when the shapes differ or aren't those of images.
    """
    found, wanted = _as_stacks(image, target)
    return _psnr_per_plane(found[..., 1], wanted[..., 1])


def _checked_pair(image: ArrayLike, target: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    found, wanted = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if found.shape != wanted.shape or found.size == 0:
        raise UserError("image", f"shape {found.shape}", expected=f"the target's shape, {wanted.shape}, not empty")
    return found, wanted


def _as_stacks(image: ArrayLike, target: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both as (plane, y, x, 3)."""
    found, wanted = _checked_pair(image, target)
    if found.ndim not in (3, 4) or found.shape[-1] != 3:
        raise UserError("image", f"shape {found.shape}", expected="(y, x, 3) or (plane, y, x, 3)")
    return found.reshape(-1, *found.shape[-3:]), wanted.reshape(-1, *wanted.shape[-3:])


def _psnr_per_plane(stack: NDArray[np.float64], target: NDArray[np.float64]) -> Psnr:
    planes = tuple(psnr(found, wanted) for found, wanted in zip(stack, target, strict=True))
    return Psnr(mean_db=sum(planes) / len(planes), planes_db=planes)
