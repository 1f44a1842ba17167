"""Image quality: infinite PSNR for the target itself, known speckle, and an eyebox that tells diffuse from flat."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.hologram import Hologram
from holoview.holograms.metrics.image_quality import (
    EyeboxUniformity,
    eyebox_uniformity_of,
    measure_image_quality,
)
from holoview.holograms.view import View
from holoview.light.colour import SRGB_TO_XYZ
from holoview.light.numerics.sampling import central_region

SIDE = 256


def _view(xyz: np.ndarray) -> View:
    return View(
        intensity=np.zeros((len(xyz), 1, *xyz.shape[1:3])),
        xyz=xyz,
        wavelengths_m=np.array([550e-9]),
        planes_m=np.arange(1.0, len(xyz) + 1) * 1e-3,
        focus_m=np.arange(1.0, len(xyz) + 1) * 1e-3,
        pitch_m=4e-6,
        backend="made up",
    )


def _stack(planes: int = 2, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.2, 0.8, (planes, 16, 24, 3))


def _eyebox(drive: Any, **changes: Any) -> EyeboxUniformity:
    """Of one modulator whose stroke is the wavelength, so that a uniform random phase has no zero order."""
    system = hv.load("holochrome-8-1slm").edit(
        {"shape": [SIDE, SIDE], "wavelengths": ["550 nm"], "amplitudes": [[1.0]], "stroke": "550 nm", "planes": "1 mm"}
        | changes
    )
    return eyebox_uniformity_of(Hologram(np.asarray(drive, np.float32).reshape(system.drive_shape), system))


def _random_drive(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((SIDE, SIDE), dtype=np.float32)


def test_a_perfect_view_has_infinite_psnr_no_colour_difference_and_no_speckle() -> None:
    stack = _stack()
    view = _view(stack @ SRGB_TO_XYZ.T)
    assert measure_image_quality(view, stack).psnr_luminance.mean_db == math.inf
    quality = measure_image_quality(view, view.rgb)
    assert quality.psnr.mean_db == math.inf
    assert quality.psnr.planes_db == (math.inf, math.inf)
    assert quality.delta_e == pytest.approx(0, abs=1e-9)
    assert quality.mean_speckle_contrast == pytest.approx(0, abs=1e-9)


def test_an_error_of_a_tenth_is_20_db() -> None:
    stack = _stack(planes=1)
    assert measure_image_quality(_view((stack + 0.1) @ SRGB_TO_XYZ.T), stack).psnr.mean_db == pytest.approx(
        20.0, abs=1e-9
    )


def test_speckle_is_told_from_the_picture_s_own_structure_plane_by_plane() -> None:
    stack = _stack()
    grains = np.where(np.arange(24) % 2, 1.5, 0.5)[:, None]  # mean 1, standard deviation 1/2
    quality = measure_image_quality(_view(np.stack([stack[0], stack[1] * grains]) @ SRGB_TO_XYZ.T), stack)
    first, second = (plane.contrast for plane in quality.speckle)
    assert first == pytest.approx(0, abs=1e-9)
    assert second == pytest.approx(0.5, abs=0.02)
    assert quality.mean_speckle_contrast == pytest.approx((first + second) / 2)


def test_speckle_is_judged_in_the_central_half_unless_told_otherwise() -> None:
    stack = _stack(planes=1)
    seen = stack.copy()
    seen[:, :4] *= 3
    x, y, w, h = central_region(stack.shape[1:3])
    assert (x, y, w, h) == (6, 4, 12, 8)
    assert measure_image_quality(_view(seen @ SRGB_TO_XYZ.T), stack).mean_speckle_contrast == pytest.approx(0, abs=1e-9)
    assert measure_image_quality(_view(seen @ SRGB_TO_XYZ.T), stack, (0, 0, 24, 16)).mean_speckle_contrast > 0.3


def test_the_central_region_is_half_as_wide_and_high() -> None:
    assert central_region((48, 64)) == (16, 12, 32, 24)


def test_random_phase_fills_the_eyebox_evenly() -> None:
    # 64 blocks of 32 × 32 independent samples of speckle: their means scatter by 1/32, and none is 5.5 of these off
    found = _eyebox(_random_drive())
    assert found.coefficient_of_variation < 0.05
    assert found.uniformity > 1 - 5.5 / 32
    assert found.centre_share == pytest.approx(1, abs=5.5 / 32)


def test_a_flat_modulator_sends_all_light_to_the_centre_of_the_eyebox() -> None:
    found = _eyebox(np.zeros((SIDE, SIDE)))
    assert found.uniformity < 0.01
    assert found.centre_share > 0.95 * 64


def test_a_stroke_that_is_no_whole_wavelength_leaves_a_zero_order() -> None:
    # uniform phase in 0…3π has the mean sinc(1.5): 4.5 % of the light isn't diffracted and meets the 1/64 at the centre
    share = np.sinc(1.5) ** 2
    found = _eyebox(_random_drive(), stroke="825 nm")
    # of random phase each of the SIDE² orders has (1 − share)/SIDE², which the zero order's amplitude interferes with
    interference = 64 * 2 * np.sqrt(share * (1 - share) / 2) / SIDE
    deviation = np.hypot(interference, (1 - share) / 32)
    assert found.centre_share == pytest.approx(64 * share + 1 - share, abs=5.5 * deviation)


def test_lasers_of_one_colour_fill_the_eyebox_as_one_does() -> None:
    twice, once = (
        _eyebox(_random_drive(), wavelengths=["550 nm"] * count, amplitudes=[[1.0, 3.0][:count]]) for count in (2, 1)
    )
    assert twice.coefficient_of_variation == pytest.approx(once.coefficient_of_variation)
    assert twice.uniformity == pytest.approx(once.uniformity)


def test_an_iris_that_cuts_the_corners_shows_in_the_eyebox() -> None:
    open_na = 550e-9 / (2 * 8e-6)
    assert _eyebox(_random_drive(), **{"relay2.iris_na": open_na}).uniformity < 0.3


def test_two_modulators_in_contact_show_the_sum_of_their_paths() -> None:
    system = hv.load("holochrome-8").edit(
        {"shape": [64, 64], "wavelengths": ["550 nm"], "amplitudes": [[1.0]], "stroke": "550 nm", "planes": "0.5 mm"}
        | {"gap": "0 mm"}
    )
    half = np.full((1, 2, 64, 64), 0.25, np.float32)
    assert eyebox_uniformity_of(Hologram(half, system)).centre_share > 0.9 * 64
