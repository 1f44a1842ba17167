"""Intensity on the camera's pixels of a field that is known by its spectrum, for any position of the camera.

If the camera's pixels coincide with the simulation's samples, the samples are used directly. A camera with another
pitch, shift or magnification gets the field at its pixels exactly, as a Fourier sum over the spectrum. A rotated camera
gets it from a grid twice as fine, by windowed sinc interpolation, with an error of 1e-4. A pixel larger than a sample
averages the intensity at several points.

`FrequencyBand` has the FFTs between a field and the frequencies that a relay passes. With an iris most frequencies of a
padded grid are zero, and columns outside the band are never transformed. The field occupies the first samples of the
padded grid, wherever the plan puts it: propagation is a convolution, so that a shift of the field within the grid only
shifts the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch

from holoview.model.effects.hook_contexts import Pose
from holoview.model.passband import band_of_rows
from holoview.model.plan import Grid
from holoview.model.transfer import Transfer
from holoview.numerics.resample import affine_warp, band_limited_warp, centred_indices
from holoview.numerics.sampling import frequency_indices

Tensor = torch.Tensor
_PITCH_TOLERANCE = 1e-6  # relative difference of pitches that are meant to be equal
_INTERPOLATION_MARGIN = 5  # samples, of which interpolation needs 3.5 beyond the outermost pixel, with some to spare


@dataclass(frozen=True)
class PixelGrid:
    """The camera's pixels, referred to the modulator's plane and centred on the axis: pitch, (rows, columns).

    points_per_axis: a pixel averages the intensity over this number of points along each axis; None: one point for
    each simulation sample that fits on the pixel.
    """

    pitch_m: float
    shape: tuple[int, int]
    points_per_axis: int | None = None


def sample_intensity(spectrum: Tensor, band: FrequencyBand, grid: Grid, pixel_grid: PixelGrid, pose: Pose) -> Tensor:
    """|field|² on the camera, (y, x).

    spectrum: of the field on the padded simulation `grid`, in a band. pose: how the camera is shifted, rotated and
    magnified; its `softness` is the fraction of the image that is interpolated linearly between samples, which blurs,
    and acts only if the camera has the simulation's pitch.
    """
    same_pitch = abs(pixel_grid.pitch_m / grid.pitch_m - 1) < _PITCH_TOLERANCE
    points = pixel_grid.points_per_axis or max(1, round(pixel_grid.pitch_m / grid.pitch_m))
    if same_pitch and points == 1 and pixel_grid.shape == grid.shape and pose.is_identity:
        return squared_magnitude(band.inverse(spectrum, grid.shape))
    point_grid = PixelGrid(pixel_grid.pitch_m / points, (pixel_grid.shape[0] * points, pixel_grid.shape[1] * points))
    field_at = _field_by_fourier_sum if pose.rotation_rad == 0 else _field_by_interpolation
    image = mean_over_pixels(squared_magnitude(field_at(spectrum, band, grid, point_grid, pose)), points)
    if pose.softness and same_pitch:
        unshifted = squared_magnitude(band.inverse(spectrum, grid.shape))
        soft = affine_warp(unshifted, pose.inverse_affine(grid.pitch_m), shape=pixel_grid.shape)
        image = (1 - pose.softness) * image + pose.softness * soft
    return image


def squared_magnitude(field: Tensor) -> Tensor:
    """|field|² of a complex field of any shape."""
    return field.real.square() + field.imag.square()


def _field_by_fourier_sum(spectrum: Tensor, band: FrequencyBand, grid: Grid, points: PixelGrid, pose: Pose) -> Tensor:
    """The field at points whose rows and columns are parallel to the grid's: a Fourier sum along each axis.

    Zero beyond half the padded grid, where the periodic field would repeat itself.
    """
    affine = pose.inverse_affine(points.pitch_m)
    matrices = []
    for axis, k in enumerate(band.frequency_indices):
        position = centred_indices(points.shape[axis], torch.float64, k.device) * affine[axis][axis] + affine[axis][2]
        sample = position * (points.pitch_m / grid.pitch_m) + (grid.shape[axis] - 1) / 2
        turns = torch.remainder(sample[:, None] * (k.double() / grid.padded[axis])[None, :], 1.0)
        from_centre = sample - (grid.shape[axis] - 1) / 2
        within_period = (from_centre.abs() < grid.padded[axis] / 2).double()
        amplitude = (within_period / grid.padded[axis])[:, None].expand_as(turns)
        matrices.append(torch.polar(amplitude, 2 * math.pi * turns).to(spectrum.dtype))
    return matrices[0] @ (spectrum @ matrices[1].T)


def _field_by_interpolation(spectrum: Tensor, band: FrequencyBand, grid: Grid, points: PixelGrid, pose: Pose) -> Tensor:
    """The field at points of any orientation: windowed sinc interpolation on a grid twice as fine.

    The finer grid begins `margins` samples before the field.
    """
    affine = pose.inverse_affine(points.pitch_m)
    margins = _margins(grid, points, affine)
    max_y, max_x = (min(k, p // 2) for k, p in zip(band.max_indices, band.padded, strict=True))
    finer = FrequencyBand((2 * band.padded[0], 2 * band.padded[1]), (max_y, max_x))
    shift_y, shift_x = (
        torch.polar(torch.ones_like(k), -2 * math.pi * k * margin / padded)
        for k, margin, padded in zip((k.double() for k in finer.frequency_indices), margins, band.padded, strict=True)
    )
    spectrum = _with_positive_nyquist(spectrum, band) * (shift_y[:, None] * shift_x[None, :]).to(spectrum.dtype)
    shape = (2 * (grid.shape[0] + 2 * margins[0]), 2 * (grid.shape[1] + 2 * margins[1]))
    field = 4 * finer.inverse(spectrum, shape)
    scale = points.pitch_m / (grid.pitch_m / 2)
    half = 0.5  # both grids begin at the same sample, so the finer one's centre lies half a finer sample further
    (a, b, c), (d, e, f) = affine
    source = ((a * scale, b * scale, c * scale - half), (d * scale, e * scale, f * scale - half))
    return band_limited_warp(field, source, points.shape)


def _margins(grid: Grid, points: PixelGrid, affine: tuple[tuple[float, float, float], ...]) -> tuple[int, int]:
    """Samples (y, x) to add on each side of the field so that it covers the camera's corners, within the padding."""
    corner = [(n - 1) / 2 for n in points.shape]
    margins = []
    for axis, (a, b, c) in enumerate(affine):
        farthest = (abs(a) * corner[0] + abs(b) * corner[1] + abs(c)) * points.pitch_m / grid.pitch_m
        needed = math.ceil(farthest - (grid.shape[axis] - 1) / 2) + _INTERPOLATION_MARGIN
        margins.append(max(0, min(needed, (grid.padded[axis] - grid.shape[axis]) // 2)))
    return margins[0], margins[1]


def _with_positive_nyquist(spectrum: Tensor, band: FrequencyBand) -> Tensor:
    """The spectrum with a zero for the positive Nyquist frequency, which a full band of even length has as negative."""
    for dim in (0, 1):
        half = band.padded[dim] // 2
        if spectrum.shape[dim] == band.padded[dim] == 2 * half:
            zero = torch.zeros_like(spectrum.narrow(dim, 0, 1))
            parts = (spectrum.narrow(dim, 0, half), zero, spectrum.narrow(dim, half, half))
            spectrum = torch.cat(parts, dim=dim)
    return spectrum


def mean_over_pixels(image: Tensor, points: int) -> Tensor:
    """The mean of each square of `points` × `points` values."""
    if points == 1:
        return image
    rows, columns = (n // points for n in image.shape)
    return image.reshape(rows, points, columns, points).mean(dim=(1, 3))


# --- frequencies that a relay passes ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrequencyBand:
    """Frequencies |k_y| ≤ max_indices[0], |k_x| ≤ max_indices[1] of a grid of `padded` (y, x) samples.

    A spectrum in the band is (rows, columns) in FFT order, without the frequencies outside. A maximum of half the grid
    or more stands for all frequencies of that axis.
    """

    padded: tuple[int, int]
    max_indices: tuple[int, int]

    @staticmethod
    def from_transfer(transfer: Transfer, grid: Grid) -> FrequencyBand:
        """The smallest such band that holds all frequencies that a transfer function passes."""
        band = band_of_rows([transfer.support])
        max_y, max_x = (max(0, -low, high) for low, high in zip(band.lowest, band.highest, strict=True))
        return FrequencyBand(grid.padded, (max_y, max_x))

    @property
    def frequency_indices(self) -> tuple[Tensor, Tensor]:
        """Signed frequency indices of the rows and of the columns of a spectrum."""
        (rows, columns), (max_y, max_x) = self.padded, self.max_indices
        return _indices_within(rows, max_y), _indices_within(columns, max_x)

    def forward(self, field: Tensor) -> Tensor:
        """Spectrum (rows, columns) of a field (y, x) that is zero on the rest of the padded grid."""
        lines = _crop_spectrum(torch.fft.fft(field, n=self.padded[1], dim=1), self.padded[1], self.max_indices[1], 1)
        return _crop_spectrum(torch.fft.fft(lines, n=self.padded[0], dim=0), self.padded[0], self.max_indices[0], 0)

    def inverse(self, spectrum: Tensor, shape: tuple[int, int]) -> Tensor:
        """The first `shape` samples (y, x) of the field whose spectrum (rows, columns) is zero outside the band."""
        lines = torch.fft.ifft(_zero_pad_spectrum(spectrum, self.padded[0], self.max_indices[0], 0), dim=0)[: shape[0]]
        return torch.fft.ifft(_zero_pad_spectrum(lines, self.padded[1], self.max_indices[1], 1), dim=1)[:, : shape[1]]


@lru_cache(maxsize=256)
def _indices_within(padded: int, max_index: int) -> Tensor:
    k = torch.from_numpy(frequency_indices(padded))
    return k if 2 * max_index + 1 >= padded else k[k.abs() <= max_index]


def _crop_spectrum(spectrum: Tensor, padded: int, max_index: int, dim: int) -> Tensor:
    if 2 * max_index + 1 >= padded:
        return spectrum
    parts = (spectrum.narrow(dim, 0, max_index + 1), spectrum.narrow(dim, padded - max_index, max_index))
    return torch.cat(parts, dim=dim)


def _zero_pad_spectrum(spectrum: Tensor, padded: int, max_index: int, dim: int) -> Tensor:
    if 2 * max_index + 1 >= padded:
        return spectrum
    shape = list(spectrum.shape)
    shape[dim] = padded
    padded_spectrum = spectrum.new_empty(shape)
    padded_spectrum.narrow(dim, max_index + 1, padded - 2 * max_index - 1).zero_()
    padded_spectrum.narrow(dim, 0, max_index + 1).copy_(spectrum.narrow(dim, 0, max_index + 1))
    padded_spectrum.narrow(dim, padded - max_index, max_index).copy_(spectrum.narrow(dim, max_index + 1, max_index))
    return padded_spectrum
