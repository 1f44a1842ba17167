"""Measurements of an image: speckle contrast and fidelity of a region, line profiles, pixel values.

Contrasts are compared with those of statistically independent speckle patterns, one for each laser; the patterns of
one hologram need not be independent (the law is in `holoview.metrics.speckle`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.colour import SRGB_TO_XYZ, gamut_map, observer_weights, xyz_to_linear_srgb
from holoview.metrics.delta_e import delta_e_linear_srgb
from holoview.metrics.psnr import psnr
from holoview.metrics.speckle import laser_luminances, speckle_contrast
from holoview.model.system import System
from holoview.render.view_settings import Line, Region
from holoview.util.errors import UserError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RegionMetrics:
    """Measurements of a region.

    contrast: speckle contrast σ/μ of the luminance, divided by the target's luminance if there is a target.
    raw_contrast: the same without this division. mean: mean luminance, 1 is white. n_pixels: number of samples.
    psnr_db: PSNR of linear sRGB clipped to 0…1; delta_e: mean CIEDE2000; both None without a target.
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
    """Measures a region (x, y, width, height) of XYZ (y, x, 3), compared with a target (y, x, 3) in linear sRGB.

    Raises UserError for a region outside the image, one without light, and a target of another shape.
    """
    luminance = np.asarray(xyz)[..., 1]
    plain = speckle_contrast(luminance, region)
    if target is None:
        return RegionMetrics(plain.contrast, plain.contrast, plain.mean, plain.n_pixels)
    if target.shape != xyz.shape:
        raise UserError("target", f"shape {target.shape}", expected=f"the image's shape, {xyz.shape}")
    image_rgb, reference = gamut_map(xyz_to_linear_srgb(crop(xyz, region))), gamut_map(crop(target, region))
    return RegionMetrics(
        contrast=_structure_free(luminance, region, target, plain.contrast),
        raw_contrast=plain.contrast,
        mean=plain.mean,
        n_pixels=plain.n_pixels,
        psnr_db=psnr(image_rgb, reference),
        delta_e=delta_e_linear_srgb(image_rgb, reference),
    )


def _structure_free(
    luminance: NDArray[np.floating], region: Region, target: NDArray[np.floating], otherwise: float
) -> float:
    """Contrast of the luminance divided by the target's; `otherwise` if the target is black in the region."""
    reference = luminance_of(target, region)
    return otherwise if reference is None else speckle_contrast(luminance, region, reference).contrast


def luminance_of(target: NDArray[np.floating], region: Region) -> Floats | None:
    """Luminance (y, x) of a target (y, x, 3) in linear sRGB; None if it is black in the region."""
    reference: Floats = np.asarray(target, dtype=np.float64) @ SRGB_TO_XYZ[1]
    return reference if np.any(crop(reference, region) > 0) else None


def crop(image: NDArray[np.floating], region: Region) -> NDArray[np.floating]:
    """The region (x, y, width, height) of an image (y, x, …)."""
    x, y, width, height = region
    return image[y : y + height, x : x + width]


# --- contrast by the number of wavelengths --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ContrastCurve:
    """Luminance contrast of the brightest 1, 2, … N lasers together; each array is (N,).

    wavelengths_m: of the lasers, brightest first. measured: contrast in the image. independent: the contrast
    √(Σm²)/Σm of independent, fully developed patterns of mean luminance m.
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
    """Speckle contrast of a region as lasers are added one by one, brightest first.

    intensity: returns the intensity (y, x) of a wavelength's index, with its amplitude applied. target (y, x, 3) in
    linear sRGB: its luminance is divided out; this is exact for grey targets only, since a colour isn't equally bright
    in every laser. Raises UserError when no visible laser is on.
    """
    means = laser_luminances(system)
    visible = np.maximum(observer_weights(system.observer, system.wavelengths_m)[:, 1], 0.0)
    order = [int(i) for i in np.argsort(-means.sum(axis=0), kind="stable") if means[:, i].sum() > 0]
    reference = None if target is None else crop(np.asarray(target) @ SRGB_TO_XYZ[1], region)
    if reference is not None and not np.any(reference > 0):
        reference = None
    total, measured, independent, sources = 0.0, [], [], len(system.source.directions_rad)
    for count, wavelength in enumerate(order, start=1):
        total = total + visible[wavelength] * np.asarray(crop(intensity(wavelength), region), dtype=np.float64)
        measured.append(speckle_contrast(total, target=reference).contrast)
        added = means[:, order[:count]]
        independent.append(float(np.sqrt(np.square(added).sum() / sources) / added.sum()))
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
    """Values of an image (y, x) or (y, x, channel) along a line, about one sample apart, by linear interpolation.

    pitch_m: distance between samples in metres. Raises UserError for a line that leaves the image.
    """
    from scipy import ndimage  # slow start: most sessions draw no line

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
    """XYZ (3,) and linear sRGB (3,) of a sample, and the intensity of each laser (wavelength,) if it was given."""

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
