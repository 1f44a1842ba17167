"""Fidelity of an image to its target at fixed brightness: PSNR and the mean colour difference CIEDE2000.

    PSNR = 10·log10(peak² / MSE)    dB, the mean square error over every pixel and channel

Fixed brightness: image and target are compared as they are, with Y = 1 the display's white, and no scale factor is
fitted, since a factor for each image would reward a dim hologram. Scaling both images by s changes the PSNR by
−20·log10 s dB (a target of half the brightness "gains" 6 dB), so that values for targets of different brightness can't
be compared.

The PSNR of a focal stack is the mean of its planes' decibels, so that one plane with large errors doesn't dominate.

CIEDE2000 (CIE 142-2001; Sharma, Wu & Dalal 2005) goes through CIELAB. It was made for reflecting samples, so that this
is assumed: the viewer is fully adapted to the display's white (D65, Y = 1), to which CIELAB is relative; the eye's
XYZ_F (from cone fundamentals) is used as if it were CIE 1931 XYZ; the parametric factors k_L, k_C, k_H are 1; and
pixels are compared one by one, so that speckle counts even where the eye can't resolve it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from holoview.holograms.files.light_file import PlaneLight
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, gamut_map, import_colour_science, xyz_to_linear_srgb
from holoview.util.errors import UserError


@dataclass(frozen=True)
class Psnr:
    """PSNR (dB) of an image or a focal stack: mean over planes, and of each plane."""

    mean_db: float
    planes_db: tuple[float, ...]


def psnr(image: ArrayLike, target: ArrayLike, peak: float = 1.0) -> float:
    """PSNR (dB) of two arrays of equal shape over all their elements; inf for equal arrays.

    Raises UserError when the shapes differ.
    """
    values, expected = _checked_pair(image, target)
    mean_square = float(np.mean((values - expected) ** 2))
    return float(20.0 * np.log10(peak) - 10.0 * np.log10(mean_square)) if mean_square != 0.0 else float("inf")


def psnr_linear_srgb(image: ArrayLike, target: ArrayLike) -> Psnr:
    """PSNR of linear sRGB images (y, x, 3) or stacks (plane, y, x, 3), both clipped to 0…1 as a screen would.

    Raises UserError when the shapes differ or aren't those of images.
    """
    stack, target_stack = as_stacks(image, target)
    return _psnr_per_plane(gamut_map(stack), gamut_map(target_stack))


def psnr_xyz(image: ArrayLike, target: ArrayLike) -> Psnr:
    """PSNR of XYZ images (y, x, 3) or stacks (plane, y, x, 3) with peak 1, not clipped to the range of a screen.

    Raises UserError when the shapes differ or aren't those of images.
    """
    return _psnr_per_plane(*as_stacks(image, target))


def psnr_luminance(image: ArrayLike, target: ArrayLike) -> Psnr:
    """PSNR of the luminance Y of XYZ images (y, x, 3) or stacks (plane, y, x, 3) with peak 1, not clipped.

    Raises UserError when the shapes differ or aren't those of images.
    """
    stack, target_stack = as_stacks(image, target)
    return _psnr_per_plane(stack[..., 1], target_stack[..., 1])


def _checked_pair(image: ArrayLike, target: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    values, expected = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if values.shape != expected.shape or values.size == 0:
        raise UserError("image", f"shape {values.shape}", expected=f"the target's shape, {expected.shape}, not empty")
    return values, expected


def _psnr_per_plane(stack: NDArray[np.float64], target: NDArray[np.float64]) -> Psnr:
    planes = tuple(psnr(image, expected) for image, expected in zip(stack, target, strict=True))
    return Psnr(mean_db=sum(planes) / len(planes), planes_db=planes)


# --- scores of planes -------------------------------------------------------------------------------------------------


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


# --- colour difference ---


def delta_e_xyz(image: ArrayLike, target: ArrayLike) -> float:
    """Mean CIEDE2000 over all pixels of two XYZ images (…, 3) whose white is D65 with Y = 1; 0 for equal images.

    Raises UserError when the shapes differ or the last axis isn't XYZ.
    """
    return float(np.mean(delta_e_map_xyz(image, target)))


def delta_e_linear_srgb(image: ArrayLike, target: ArrayLike) -> float:
    """Mean CIEDE2000 over all pixels of two linear sRGB images (…, 3), both clipped to 0…1 as a screen would.

    Raises UserError when the shapes differ or the last axis isn't RGB.
    """
    return delta_e_xyz(gamut_map(image) @ SRGB_TO_XYZ.T, gamut_map(target) @ SRGB_TO_XYZ.T)


def delta_e_map_xyz(image: ArrayLike, target: ArrayLike) -> NDArray[np.float64]:
    """CIEDE2000 of each pixel, shape (…), of two XYZ images (…, 3); white and errors as in `delta_e_xyz`."""
    image_xyz, target_xyz = np.asarray(image, dtype=np.float64), np.asarray(target, dtype=np.float64)
    if image_xyz.shape != target_xyz.shape or image_xyz.shape[-1:] != (3,) or image_xyz.size == 0:
        expected = f"(…, 3) as the target, {target_xyz.shape}, not empty"
        raise UserError("image", f"shape {image_xyz.shape}", expected=expected)
    science = import_colour_science()
    white_xy = D65_WHITE[:2] / D65_WHITE.sum()
    lab, target_lab = (science.XYZ_to_Lab(xyz, illuminant=white_xy) for xyz in (image_xyz, target_xyz))
    difference: NDArray[np.float64] = np.asarray(science.delta_E(lab, target_lab, method="CIE 2000"), dtype=np.float64)
    return difference


def light_differences(light: PlaneLight, reference: PlaneLight) -> list[dict[str, Any]]:
    """How far the light of each plane is from a reference with as many samples, as JSON values.

    equal: whether what both files store of XYZ, RGB of one colour space and intensities is the same bit by bit, or else
    XYZ; quantities: which were compared. psnr_db: of linear sRGB, clipped. delta_e: mean CIEDE2000. largest_xyz: the
    largest difference. Of equal light these are endless, 0 and 0.
    """
    same_space = light.about.get("rgb_space") == reference.about.get("rgb_space")
    names = [name for name in light.stored if name in reference.stored and (name != "rgb" or same_space)]
    if light.intensity is None or reference.intensity is None or light.intensity.shape != reference.intensity.shape:
        names = [name for name in names if name != "intensity"]
    names = names or ["xyz"]
    rows = []
    for plane, (seen, wanted) in enumerate(zip(light.xyz, reference.xyz, strict=True)):
        pairs = [(getattr(light, name)[plane], getattr(reference, name)[plane]) for name in names]
        is_equal = all(np.array_equal(one, other) for one, other in pairs)
        wanted = seen if is_equal else wanted  # a file without XYZ has it from its RGB, but for rounding
        rgb, wanted_rgb = (xyz_to_linear_srgb(xyz) for xyz in (seen, wanted))
        rows.append(
            {
                "plane_m": float(reference.planes_m[plane]) if len(reference.planes_m) > plane else None,
                "equal": is_equal,
                "quantities": names,
                "psnr_db": psnr_linear_srgb(rgb, wanted_rgb).mean_db,
                "delta_e": delta_e_linear_srgb(rgb, wanted_rgb),
                "largest_xyz": float(np.abs(np.asarray(seen, dtype=np.float64) - wanted).max()),
            }
        )
    return rows
