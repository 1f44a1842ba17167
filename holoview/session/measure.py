"""Figures of what is seen: speckle and fidelity of a region, a line, a pixel. Arrays in, results out.

What lasers would give if each had its own speckle is told beside what they give: those of one hologram need not be
independent (see `holoview.metrics.speckle_histogram` for the law).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from holoview.colour import SRGB_TO_XYZ, gamut_map, observer_weights, xyz_to_linear_srgb
from holoview.metrics.delta_e import delta_e_linear_srgb
from holoview.metrics.psnr import psnr
from holoview.metrics.speckle import speckle_contrast
from holoview.model.system import System
from holoview.session.view_settings import Line, Region
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RegionMetrics:
    """A region's figures; psnr_db and delta_e need a target, and then contrast is that of the ratio to the target.

    contrast: of the luminance; raw_contrast: with the picture's own structure in it. mean: luminance, 1 is white.
    psnr_db: of linear sRGB clipped to 0…1. delta_e: mean CIEDE2000. pixels: how many there are.
    """

    contrast: float
    raw_contrast: float
    mean: float
    n_pixels: int
    psnr_db: float | None = None
    delta_e: float | None = None


def measure_region(
    xyz: NDArray[np.floating], region: Region, target: NDArray[np.floating] | None = None
) -> RegionMetrics:
    """Figures of a region (x, y, w, h) of XYZ (y, x, 3), beside a target (y, x, 3) in linear sRGB.

    Raises UserError for a region outside, one without light, and a target of another shape.
    """
    luminance = np.asarray(xyz)[..., 1]
    raw = speckle_contrast(luminance, region)
    if target is None:
        return RegionMetrics(raw.contrast, raw.contrast, raw.mean, raw.n_pixels)
    if target.shape != xyz.shape:
        raise UserError("target", f"shape {target.shape}", expected=f"the image's shape, {xyz.shape}")
    found, wanted = gamut_map(xyz_to_linear_srgb(crop(xyz, region))), gamut_map(crop(target, region))
    return RegionMetrics(
        contrast=_structure_free(luminance, region, target, raw.contrast),
        raw_contrast=raw.contrast,
        mean=raw.mean,
        n_pixels=raw.n_pixels,
        psnr_db=psnr(found, wanted),
        delta_e=delta_e_linear_srgb(found, wanted),
    )


def _structure_free(
    luminance: NDArray[np.floating], region: Region, target: NDArray[np.floating], otherwise: float
) -> float:
    """Contrast of the ratio to the target; the plain one where the target is black in the region."""
    wanted = np.asarray(target) @ SRGB_TO_XYZ[1]
    if not np.any(crop(wanted, region) > 0):
        return otherwise
    return speckle_contrast(luminance, region, wanted).contrast


def crop(image: NDArray[np.floating], region: Region) -> NDArray[np.floating]:
    """The region (x, y, w, h) of an image (y, x, …)."""
    x, y, width, height = region
    return image[y : y + height, x : x + width]


# --- lasers ---------------------------------------------------------------------------------------------------------


def laser_luminances(system: System) -> Floats:
    """Mean luminance (frame, wavelength) that each laser adds to an evenly lit image: amplitude/frames × Y."""
    visible = np.maximum(observer_weights(system.observer, system.wavelengths_m)[:, 1], 0.0)
    power: Floats = system.amplitudes / system.frames * visible
    return power


def independent_pattern_count(system: System) -> float:
    """Independent speckle patterns in the luminance if every laser, frame and source has its own: (Σm)²/Σm²."""
    means = np.repeat(laser_luminances(system).ravel(), len(system.source.directions_rad)) / len(
        system.source.directions_rad
    )
    return float(means.sum() ** 2 / np.square(means).sum()) if np.any(means > 0) else 1.0


# --- contrast by the number of wavelengths --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ContrastCurve:
    """Luminance contrast of the first 1, 2, … N lasers together, brightest first; each array is (N,).

    measured: in the image. independent: what these lasers would give if each had its own fully developed pattern.
    """

    wavelengths_m: Floats
    measured: Floats
    independent: Floats


def contrast_by_wavelength(
    intensity: Callable[[int], NDArray[np.floating]],
    system: System,
    region: Region,
    target: NDArray[np.floating] | None = None,
) -> ContrastCurve:
    """Speckle contrast of more and more lasers; intensity(wavelength) (y, x) has its amplitude applied.

    target (y, x, 3) linear sRGB: its structure is divided out, which is right for greys only, because a colour isn't
    equally bright in every laser. Raises UserError when no laser lights the region.
    """
    means = laser_luminances(system)
    visible = np.maximum(observer_weights(system.observer, system.wavelengths_m)[:, 1], 0.0)
    order = [int(i) for i in np.argsort(-means.sum(axis=0), kind="stable") if means[:, i].sum() > 0]
    known = None if target is None else np.asarray(target) @ SRGB_TO_XYZ[1]
    total, measured, independent, sources = 0.0, [], [], len(system.source.directions_rad)
    for count, wavelength in enumerate(order, start=1):
        total = total + visible[wavelength] * np.asarray(crop(intensity(wavelength), region), dtype=np.float64)
        wanted = None if known is None or not np.any(crop(known, region) > 0) else crop(known, region)
        measured.append(speckle_contrast(total, target=wanted).contrast)
        some = means[:, order[:count]]
        independent.append(float(np.sqrt(np.square(some).sum() / sources) / some.sum()))
    if not order:
        raise UserError("lasers", "none that can be seen is on", remedy="switch one on")
    return ContrastCurve(system.wavelengths_m[order], np.array(measured), np.array(independent))


# --- lines and pixels -----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LineProfile:
    """Values (n, channel) along a line, at distances (n,) in metres from its start."""

    distance_m: Floats
    values: Floats


def line_profile(image: NDArray[np.floating], line: Line, pitch_m: float) -> LineProfile:
    """Values of an image (y, x) or (y, x, channel) along a line, a sample apart, linear between samples.

    Raises UserError for a line that leaves the image.
    """
    x0, y0, x1, y1 = line
    rows, columns = image.shape[:2]
    ends_x, ends_y = sorted((x0, x1)), sorted((y0, y1))
    if ends_x[0] < 0 or ends_y[0] < 0 or ends_x[1] > columns - 1 or ends_y[1] > rows - 1:
        raise UserError("line", f"{line}", expected=f"inside the image of {columns} × {rows} samples")
    length = float(np.hypot(x1 - x0, y1 - y0))
    along = np.linspace(0.0, 1.0, max(round(length), 1) + 1)
    where = np.stack([y0 + (y1 - y0) * along, x0 + (x1 - x0) * along])
    channels = np.asarray(image, dtype=np.float64).reshape(rows, columns, -1)
    values = [ndimage.map_coordinates(channels[..., i], where, order=1) for i in range(channels.shape[2])]
    return LineProfile(along * length * pitch_m, np.stack(values, axis=-1))


@dataclass(frozen=True, eq=False)
class PixelValues:
    """A sample's XYZ (3,), linear sRGB (3,) and, where known, the intensity of every laser (wavelength,)."""

    x: int
    y: int
    xyz: Floats
    linear_rgb: Floats
    intensity: Floats | None = None


def sample_pixel(
    x: int, y: int, xyz: NDArray[np.floating], intensity: NDArray[np.floating] | None = None
) -> PixelValues | None:
    """The values at a sample of XYZ (y, x, 3) and intensity (wavelength, y, x); None outside the image."""
    if not (0 <= y < xyz.shape[0] and 0 <= x < xyz.shape[1]):
        return None
    values = np.asarray(xyz[y, x], dtype=np.float64)
    lasers = None if intensity is None else np.asarray(intensity[:, y, x], dtype=np.float64)
    return PixelValues(x, y, values, xyz_to_linear_srgb(values), lasers)
