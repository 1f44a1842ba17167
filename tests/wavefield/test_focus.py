"""Fields whose image lies at a known distance, on either side, are found to be in focus there."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from holoview.holograms.fields.focus import MEASURES, default_range_m, edge_sparsity, find_focus, normalised_variance
from holoview.holograms.fields.propagation import propagate_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.util.errors import UserError

SIDE, PITCH_M, WAVELENGTH = 256, 4e-6, 532e-9


def _wavefield(values: np.ndarray, **options) -> Wavefield:
    return Wavefield(values.astype(np.complex64)[None, None], (PITCH_M, PITCH_M), np.array([WAVELENGTH]), **options)


def _spots(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    image = np.zeros((SIDE, SIDE))
    image[tuple(rng.integers(SIDE // 4, 3 * SIDE // 4, (2, 20)))] = 1
    return image


def _bars(seed: int) -> np.ndarray:
    image = np.zeros((SIDE, SIDE))
    image[64:192, 64:192] = (np.arange(128) // 8 % 2)[None] * (np.arange(128) // 32 % 2)[:, None]
    return image * np.exp(2j * math.pi * np.random.default_rng(seed).random(image.shape))


def _depth_of_focus(distance_m: float) -> float:
    na = min(WAVELENGTH / (2 * PITCH_M), SIDE * PITCH_M / (2 * abs(distance_m)))
    return WAVELENGTH / na**2


@pytest.mark.long
@pytest.mark.parametrize("distance_m", [0.012, -0.012])
@pytest.mark.parametrize("image", [_spots, _bars])
def test_the_sharpest_distance_is_found_on_its_side_within_two_depths_of_focus(image, distance_m: float) -> None:
    """Structures are as small as the samples in the first image and 8 samples wide, in speckle, in the second."""
    there = _wavefield(image(1))
    field = _wavefield(propagate_field(there, -distance_m, "asm").values[0, 0].numpy())
    found = find_focus(field, *default_range_m(field))
    for name in MEASURES:
        assert abs(found.distances_m[name] - distance_m) < 2 * _depth_of_focus(distance_m), name
        assert found.other_side_m[name] * distance_m < 0  # type: ignore[operator]
        assert found.other_side_share[name] < 0.9
    assert found.curves[0].distances_m[0] < 0 < found.curves[0].distances_m[-1]


def test_light_that_leaves_the_field_counts_too() -> None:
    """An image which lies wholly beside its hologram, at the carrier of a tilted plane wave."""
    y = np.arange(SIDE)[:, None]
    straight = _wavefield(propagate_field(_wavefield(_spots(2)), -0.008, "asm").values[0, 0].numpy())
    field = _wavefield(straight.values[0, 0] * np.exp(2j * math.pi * 0.3 * y))
    found = find_focus(field, 0.002, 0.02)
    # the oblique path makes the distance appear as z·cos³θ and adds astigmatism: θ = 2.3°, 0.2 %
    assert found.distance_m == pytest.approx(0.008, abs=2 * _depth_of_focus(0.008))


def test_a_diffuse_object_wider_than_its_recording_is_found_without_a_stated_distance() -> None:
    """Its light leaves the frame, as in recordings of a die by a camera; the range is that of the light's band.

    In 45 draws edge sparsity, whose distance counts, found it to 0.0009 m r.m.s., half a depth of focus; the other
    measure missed it in seven.
    """
    rng = np.random.default_rng(5)
    wide = np.zeros((3 * SIDE, 3 * SIDE), complex)
    wide[SIDE:-SIDE, SIDE // 2 : -SIDE // 2] = np.exp(2j * math.pi * rng.random((SIDE, 2 * SIDE)))
    wide[SIDE + 80 : SIDE + 150, SIDE + 40 : SIDE + 140] = 0
    wide[SIDE + 20 : SIDE + 60, SIDE + 194 : SIDE + 344] = 0
    spectrum = np.fft.fft2(wide)
    narrow = np.abs(np.fft.fftfreq(3 * SIDE)) < 0.12  # as of an order that was cut out
    there = _wavefield(np.fft.ifft2(spectrum * narrow[:, None] * narrow[None, :]))
    distance_m = 0.03
    whole = propagate_field(there, -distance_m, "asm").values[0, 0].numpy()
    field = _wavefield(whole[SIDE:-SIDE, SIDE:-SIDE])
    found = find_focus(field, *default_range_m(field))
    assert found.distance_m == pytest.approx(distance_m, abs=2.6 * _depth_of_focus(distance_m))


def test_a_spherical_reference_is_searched_by_one_transform() -> None:
    radius_m, distance_m = 0.05, 0.055
    curvature = 1 / distance_m - 1 / radius_m
    y, x = np.meshgrid(*(np.arange(SIDE) - (SIDE - 1) / 2,) * 2, indexing="ij")
    lens = np.exp(-1j * math.pi * curvature * (y**2 + x**2) * PITCH_M**2 / WAVELENGTH)
    field = np.zeros((SIDE, SIDE), complex)
    for row, column in np.random.default_rng(3).integers(-100, 100, (12, 2)):  # points in the plane of the image
        field += lens * np.exp(2j * math.pi * (row * y + column * x) / SIDE)
    found = find_focus(_wavefield(field, reference_radius_m=radius_m), 0.045, 0.065)
    assert found.distance_m == pytest.approx(distance_m, abs=2 * WAVELENGTH * (2 * distance_m / (SIDE * PITCH_M)) ** 2)


def test_the_measures_are_those_of_the_papers() -> None:
    half = torch.zeros(40, 41, dtype=torch.complex64)
    half[:, 20:] = 2
    # one column of 40 has the slope 2: mean 2/40, variance 4·(1/40)·(39/40)·n/(n − 1)
    assert edge_sparsity(half) == pytest.approx(math.sqrt(math.sqrt(4 / 40 * 39 / 40) / (2 / 40)), rel=1e-3)
    assert normalised_variance(half[:, :40]) == pytest.approx(1.0, rel=1e-3)
    assert edge_sparsity(torch.ones(5, 5, dtype=torch.complex64)) == 0
    assert normalised_variance(torch.zeros(5, 5, dtype=torch.complex64)) == 0


def test_progress_is_told_and_a_range_is_checked() -> None:
    field = _wavefield(_spots(4))
    seen: list[int] = []
    find_focus(field, -0.001, 0.001, lambda done, total, note: seen.append(done))
    assert seen == sorted(seen)
    assert default_range_m(_wavefield(_spots(4), distance_m=-0.1)) == (0.05, pytest.approx(0.15))
    with pytest.raises(UserError):
        find_focus(field, 0.02, 0.01)
    with pytest.raises(UserError):
        find_focus(_wavefield(1j * _spots(4), reference_radius_m=0.3), 1e-3, 2e-3)


@pytest.mark.long
def test_an_image_within_two_depths_of_focus_of_the_plane_is_clear() -> None:
    """The order of an off-axis recording holds a small part of the spectrum, whose depth of focus is as long as the
    way to the object; the other side of the plane is less sharp all the same."""
    cycles = np.hypot(*np.meshgrid(*(np.fft.fftfreq(SIDE),) * 2, indexing="ij"))
    depth_m = PITCH_M**2 / (0.11**2 * WAVELENGTH)  # λ/NA² of NA = 0.11·λ/pitch
    screen = np.ones((SIDE, SIDE), complex)
    for row, column in np.random.default_rng(8).integers(20, SIDE - 40, (12, 2)):
        screen[row : row + 16, column : column + 7] = 0.2
    narrow = np.fft.ifft2(np.fft.fft2(screen) * (cycles < 0.11))
    field = propagate_field(_wavefield(narrow), -1.2 * depth_m, "asm").values[0, 0].numpy()
    found = find_focus(_wavefield(field), *default_range_m(_wavefield(field)))
    assert found.clear
    assert found.distance_m == pytest.approx(1.2 * depth_m, abs=depth_m)
