"""What the camera's pixels see of a field that is known by its spectrum, wherever the camera lies.

A camera whose pixels are the simulation's samples takes them as they are. Any other, also one that moved or magnifies,
takes the field at its pixels' places exactly, from the spectrum; one that turned, by cubic interpolation of the field
on a grid twice as fine. Pixels larger than samples average what falls on them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from holoview.captures.frequency_band import FrequencyBand
from holoview.model.effects.hook_contexts import Pose
from holoview.model.plan import Grid
from holoview.numerics.resample import affine_warp, centred_indices

Tensor = torch.Tensor
_PITCH_TOLERANCE = 1e-6  # relative difference of pitches that are meant to be equal


@dataclass(frozen=True)
class PixelGrid:
    """The camera's pixels, in the plane of the modulator: pitch, rows and columns.

    points: how many points each way a pixel averages; None: one for each sample on it.
    """

    pitch_m: float
    shape: tuple[int, int]
    points_per_pixel: int | None = None


def sample_intensity(spectrum: Tensor, band: FrequencyBand, grid: Grid, pixel_grid: PixelGrid, pose: Pose) -> Tensor:
    """|field|² on the camera, (y, x), for the field's spectrum in a band of the padded grid."""
    same = abs(pixel_grid.pitch_m / grid.pitch_m - 1) < _PITCH_TOLERANCE
    each = pixel_grid.points_per_pixel or max(1, round(pixel_grid.pitch_m / grid.pitch_m))
    if same and each == 1 and pixel_grid.shape == grid.shape and pose.is_identity:
        return _intensity(band.inverse(spectrum, grid.shape))
    fine = PixelGrid(pixel_grid.pitch_m / each, (pixel_grid.shape[0] * each, pixel_grid.shape[1] * each))
    read = _field_by_fourier_sum if pose.rotation_rad == 0 else _field_by_interpolation
    image = _bin_pixels(_intensity(read(spectrum, band, grid, fine, pose)), each)
    if pose.softness and same:
        plain = _intensity(band.inverse(spectrum, grid.shape))
        soft = affine_warp(plain, pose.inverse_affine(grid.pitch_m), shape=pixel_grid.shape)
        image = (1 - pose.softness) * image + pose.softness * soft
    return image


def _field_by_fourier_sum(spectrum: Tensor, band: FrequencyBand, grid: Grid, pixels: PixelGrid, pose: Pose) -> Tensor:
    """The field at pixels that are in rows and columns of the grid's directions: a sum over frequencies each way."""
    rows = pose.inverse_affine(pixels.pitch_m)
    sides = []
    for axis, k in enumerate(band.frequency_indices):
        place = centred_indices(pixels.shape[axis], torch.float64, k.device) * rows[axis][axis] + rows[axis][2]
        sample = place * (pixels.pitch_m / grid.pitch_m) + (grid.shape[axis] - 1) / 2
        turns = torch.remainder(sample[:, None] * (k.double() / grid.padded[axis])[None, :], 1.0)
        away = sample - (grid.shape[axis] - 1) / 2
        there = (away.abs() < grid.padded[axis] / 2).double()  # beyond, the grid begins again, and nothing is known
        amplitude = (there / grid.padded[axis])[:, None].expand_as(turns)
        wave = torch.polar(amplitude, 2 * math.pi * turns)
        sides.append(wave.to(spectrum.dtype))
    return sides[0] @ (spectrum @ sides[1].T)


def _field_by_interpolation(spectrum: Tensor, band: FrequencyBand, grid: Grid, pixels: PixelGrid, pose: Pose) -> Tensor:
    """The field at pixels that lie anyhow, cubic between samples of a grid twice as fine."""
    reach = (min(band.max_indices[0], (band.padded[0] - 1) // 2), min(band.max_indices[1], (band.padded[1] - 1) // 2))
    finer = FrequencyBand((2 * band.padded[0], 2 * band.padded[1]), reach)
    (a, b, c), (d, e, f) = pose.inverse_affine(pixels.pitch_m)
    margins = _margins(grid, pixels, ((a, b, c), (d, e, f)))
    begins = [
        torch.polar(torch.ones_like(k), -2 * math.pi * k * m / p)
        for k, m, p in zip((k.double() for k in finer.frequency_indices), margins, band.padded, strict=True)
    ]
    spectrum = _without_nyquist(spectrum, band) * (begins[0][:, None] * begins[1][None, :]).to(spectrum.dtype)
    shape = (2 * (grid.shape[0] + 2 * margins[0]), 2 * (grid.shape[1] + 2 * margins[1]))
    field = 4 * finer.inverse(spectrum, shape)
    scale = pixels.pitch_m / (grid.pitch_m / 2)
    half = 0.5  # the finer grid begins at the same place, so that its centre lies half of its samples further
    source = ((a * scale, b * scale, c * scale - half), (d * scale, e * scale, f * scale - half))
    return affine_warp(field, source, mode="bicubic", shape=pixels.shape)


def _margins(grid: Grid, pixels: PixelGrid, rows: tuple[tuple[float, float, float], ...]) -> tuple[int, int]:
    """Samples (y, x) around the field on which the camera's corners lie, within what the padding holds."""
    corner = [(n - 1) / 2 for n in pixels.shape]
    margins = []
    for axis, (a, b, c) in enumerate(rows):
        farthest = (abs(a) * corner[0] + abs(b) * corner[1] + abs(c)) * pixels.pitch_m / grid.pitch_m
        wanted = math.ceil(farthest - (grid.shape[axis] - 1) / 2) + 3
        margins.append(max(0, min(wanted, (grid.padded[axis] - grid.shape[axis]) // 2)))
    return margins[0], margins[1]


def _without_nyquist(spectrum: Tensor, band: FrequencyBand) -> Tensor:
    """The spectrum with both signs of the highest frequency, where the band is all that the grid has."""
    for dim in (0, 1):
        padded, reach = band.padded[dim], band.max_indices[dim]
        if 2 * reach + 1 >= padded and spectrum.shape[dim] == padded:
            keep = (padded - 1) // 2
            parts = (spectrum.narrow(dim, 0, keep + 1), spectrum.narrow(dim, padded - keep, keep))
            spectrum = torch.cat(parts, dim=dim)
    return spectrum


def _bin_pixels(image: Tensor, each: int) -> Tensor:
    """The mean of each square of `each` samples."""
    if each == 1:
        return image
    rows, columns = (n // each for n in image.shape)
    return image.reshape(rows, each, columns, each).mean(dim=(1, 3))


def _intensity(field: Tensor) -> Tensor:
    return field.real.square() + field.imag.square()
