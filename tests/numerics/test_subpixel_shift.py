"""Shifts and gradients of waves below 0.8 of the Nyquist frequency agree with the analytic ones."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.light.numerics.subpixel_shift import image_gradient, shift_images

MARGIN = 12
"""Pixels at the edges that are left out: waves don't continue as the edge does."""
Y, X = np.meshgrid(np.arange(64.0), np.arange(80.0), indexing="ij")


def _wave(y: np.ndarray, x: np.ndarray, of_nyquist: float) -> np.ndarray:
    return np.asarray(np.cos(np.pi * of_nyquist * (0.6 * y + 0.8 * x)))


def _inner(image: np.ndarray) -> np.ndarray:
    return image[MARGIN:-MARGIN, MARGIN:-MARGIN]


@pytest.mark.parametrize("of_nyquist", [0.2, 0.5, 0.8])
def test_an_image_is_shifted_by_fractions_of_a_pixel_to_two_per_cent(of_nyquist: float) -> None:
    (found,) = shift_images(_wave(Y, X, of_nyquist).astype(np.float32)[None], np.array([[0.3, -1.6]]))
    assert _inner(found) == pytest.approx(_inner(_wave(Y - 0.3, X + 1.6, of_nyquist)), abs=0.02)


@pytest.mark.parametrize("of_nyquist", [0.2, 0.5, 0.8])
def test_gradients_are_right_to_two_per_cent(of_nyquist: float) -> None:
    slope_y, slope_x = image_gradient(_wave(Y, X, of_nyquist).astype(np.float32)[None])
    sine = -np.sin(np.pi * of_nyquist * (0.6 * Y + 0.8 * X))
    for slope, direction in ((slope_y[0], 0.6), (slope_x[0], 0.8)):
        expected = np.pi * of_nyquist * direction * sine
        assert _inner(slope) == pytest.approx(_inner(expected), abs=0.02 * float(np.abs(expected).max()))


def test_no_shift_changes_nothing() -> None:
    image = np.random.default_rng(0).random((1, 20, 30), dtype=np.float32)
    assert shift_images(image, np.zeros((1, 2))) == pytest.approx(image, abs=1e-6)
