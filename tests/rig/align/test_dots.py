"""Dots in pictures that are known."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.rig.align.dots import brightest_dot, find_dots

SIGMA = 2.0
WIDTH = SIGMA / 0.4


def picture(places: list[tuple[float, float]], shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return sum(np.exp(-((y - a) ** 2 + (x - b) ** 2) / (2 * SIGMA**2)) for a, b in places)


@pytest.mark.parametrize("place", [(20.0, 30.0), (20.3, 30.5), (20.49, 29.51)])
def test_a_gaussian_dot_is_found_to_a_hundredth_of_a_pixel(place: tuple[float, float]) -> None:
    """What is left is the edge of the window, 3 σ away, where the background is taken from: e^-4.5 of the height."""
    found = find_dots(picture([place]), np.array([[22.0, 28.0]]), WIDTH, 8.0)
    assert np.abs(found.position_px[0] - place).max() < 0.01


def test_noise_moves_a_dot_by_what_its_light_allows() -> None:
    """σ of the centroid is at least σ_dot/√N; the weight and the background make it up to twice that."""
    rng, errors = np.random.default_rng(0), []
    for _ in range(50):
        noisy = rng.poisson(1000 * picture([(20.3, 30.4)])).astype(float)
        errors.append(find_dots(noisy, np.array([[20.0, 30.0]]), WIDTH, 8.0).position_px[0] - [20.3, 30.4])
    photons = 1000 * 2 * np.pi * SIGMA**2
    assert SIGMA / np.sqrt(photons) * 0.7 < np.std(errors) < 3 * SIGMA / np.sqrt(photons)


def test_each_dot_is_found_in_its_own_reach_and_none_beyond_the_picture() -> None:
    found = find_dots(
        picture([(20, 20), (20, 45)]), np.array([[21.0, 19.0], [19.0, 46.0], [1.0, 70.0], [90.0, 20.0]]), WIDTH, 9.0
    )
    assert np.abs(found.position_px[:2] - [[20, 20], [20, 45]]).max() < 0.02
    assert np.isnan(found.position_px[3]).all()
    assert found.contrast[1] > 100


def test_the_brightest_dot_stands_out_of_noise_and_noise_has_none() -> None:
    noise = np.random.default_rng(1).standard_normal((300, 300))
    place, contrast = brightest_dot(noise + 5 * picture([(140.0, 200.0)], (300, 300)), WIDTH)
    assert np.abs(place - [140, 200]).max() <= 2 and contrast > 12  # 5/2 of 1/(2√π·σ), less the noise's own share
    assert brightest_dot(noise, WIDTH)[1] < 8  # 300² values of unit deviation reach 4.4, smoothed ones less
