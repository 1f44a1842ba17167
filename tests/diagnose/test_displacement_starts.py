"""Pictures are moved, their slopes taken and their displacements measured to a small part of a pixel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from holoview.bench.diagnose.starts.picture import measure_displacement
from holoview.light.numerics.subpixel_shift import image_gradient, shift_images

SINC_ERROR = 0.005
"""Of a windowed sinc of 13 taps, at frequencies up to 0.6 of Nyquist; worst seen 0.003."""

SLOPE_ERROR = 0.006
"""Of the fitted kernel of 17 taps, up to 0.75 of Nyquist; worst seen 0.4 %. Two per cent at 0.8."""


def _wave(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A sum of waves up to 0.6 of Nyquist, at any position."""
    return 1 + 0.5 * np.cos(2 * np.pi * (0.21 * y + 0.13 * x) + 1) + 0.3 * np.cos(2 * np.pi * (0.3 * x - 0.05 * y))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.3, -0.45), (-0.5, 0.5)])
def test_a_picture_is_moved_as_if_it_were_known_between_its_pixels(shift: tuple[float, float]) -> None:
    y, x = np.indices((40, 50)).astype(float)
    found = shift_images(_wave(y, x)[None].astype(np.float32), np.array([shift]))[0]
    expected = _wave(y - shift[0], x - shift[1])
    assert found[8:-8, 8:-8] == pytest.approx(expected[8:-8, 8:-8], abs=SINC_ERROR)


def test_slopes_are_the_derivatives() -> None:
    y, x = np.indices((40, 50)).astype(float)
    slope_y, slope_x = image_gradient(_wave(y, x)[None].astype(np.float32))
    h = 1e-4
    for found, expected in (
        (slope_y[0], (_wave(y + h, x) - _wave(y - h, x)) / (2 * h)),
        (slope_x[0], (_wave(y, x + h) - _wave(y, x - h)) / (2 * h)),
    ):
        assert found[8:-8, 8:-8] == pytest.approx(expected[8:-8, 8:-8], abs=SLOPE_ERROR * np.abs(expected).max())


@pytest.mark.parametrize("of_nyquist", [0.05, 0.2, 0.4, 0.6, 0.75])
def test_slopes_of_one_wave(of_nyquist: float) -> None:
    x = np.indices((20, 60))[1].astype(float)
    slope = image_gradient(np.sin(np.pi * of_nyquist * x)[None].astype(np.float32))[1][0]
    expected = np.pi * of_nyquist * np.cos(np.pi * of_nyquist * x)
    assert slope[:, 8:-8] == pytest.approx(expected[:, 8:-8], abs=SLOPE_ERROR * np.pi * of_nyquist)


@pytest.mark.parametrize("shift", [(3.0, -7.0), (0.0, 0.0), (-11.0, 15.0)])
def test_whole_pixels_are_measured_exactly_in_noise(shift: tuple[float, float]) -> None:
    rng = np.random.default_rng(0)
    picture = gaussian_filter(rng.exponential(size=(3, 60, 80)), (0, 1, 1), mode="wrap")
    seen = np.roll(picture, [int(s) for s in shift], (1, 2)) + 0.05 * rng.standard_normal(picture.shape)
    assert measure_displacement(seen.astype(np.float32), picture.astype(np.float32)) == pytest.approx(shift, abs=0.1)


def test_parts_of_a_pixel_are_measured_roughly() -> None:
    """A parabola through three samples of the correlation: a tenth of a pixel, enough to start a fit."""
    rng = np.random.default_rng(1)
    picture = gaussian_filter(rng.exponential(size=(4, 64, 64)), (0, 2, 2), mode="wrap").astype(np.float32)
    seen = shift_images(picture, np.tile([0.4, -0.3], (4, 1)))
    assert measure_displacement(seen, picture) == pytest.approx((0.4, -0.3), abs=0.1)
