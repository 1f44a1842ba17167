"""PSNR at fixed brightness."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.holograms.metrics.fidelity import psnr, psnr_linear_srgb, psnr_luminance, psnr_xyz
from holoview.util.errors import UserError


def test_an_error_of_a_tenth_everywhere_is_twenty_decibels() -> None:
    target = np.full((4, 5), 0.5)
    assert psnr(target + 0.1, target) == pytest.approx(20.0, abs=1e-12)
    assert psnr(target + 0.1, target, peak=2.0) == pytest.approx(20.0 + 20 * np.log10(2), abs=1e-12)


def test_an_identical_image_is_infinitely_good_without_a_warning() -> None:
    image = np.random.default_rng(0).uniform(size=(2, 3, 4, 3))
    assert psnr(image, image) == np.inf
    result = psnr_linear_srgb(image, image)
    assert result.mean_db == np.inf and result.planes_db == (np.inf, np.inf)


def test_brightness_is_not_fitted_so_scaling_both_images_moves_the_result_by_minus_20_log10() -> None:
    rng = np.random.default_rng(1)
    target, image = rng.uniform(size=(2, 8, 9, 3))
    assert psnr_xyz(image / 2, target / 2).mean_db == pytest.approx(
        psnr_xyz(image, target).mean_db + 20 * np.log10(2), abs=1e-9
    )
    assert np.isfinite(psnr(target / 2, target))


def test_a_stack_is_the_mean_of_its_planes_decibels() -> None:
    target = np.full((2, 4, 4, 3), 0.5)
    image = target + np.array([0.1, 0.01])[:, None, None, None]
    result = psnr_linear_srgb(image, target)
    np.testing.assert_allclose(result.planes_db, (20, 40), atol=1e-9)
    assert result.mean_db == pytest.approx(30.0, abs=1e-9)
    assert psnr_linear_srgb(image[0], target[0]).planes_db == result.planes_db[:1]


def test_linear_srgb_is_clipped_on_both_sides_and_xyz_is_not() -> None:
    target, image = np.full((3, 3, 3), 1.2), np.full((3, 3, 3), 1.5)
    assert psnr_linear_srgb(image, target).mean_db == np.inf
    assert psnr_linear_srgb(-image, -target).mean_db == np.inf
    assert psnr_xyz(image, target).mean_db == pytest.approx(-20 * np.log10(0.3), abs=1e-9)


def test_luminance_looks_at_y_alone() -> None:
    target = np.zeros((3, 3, 3))
    image = target + np.array([0.5, 0.1, 0.5])
    assert psnr_luminance(image, target).mean_db == pytest.approx(20.0, abs=1e-9)


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(UserError, match=r"the target's shape, \(4, 5\)"):
        psnr(np.zeros((4, 4)), np.zeros((4, 5)))
    with pytest.raises(UserError, match=r"\(plane, y, x, 3\)"):
        psnr_xyz(np.zeros((4, 4)), np.zeros((4, 4)))
    with pytest.raises(UserError, match="not empty"):
        psnr([], [])
