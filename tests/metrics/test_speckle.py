"""Speckle contrast on fields whose statistics are known.

The tolerance on C is four standard deviations of its estimate from n independent pixels. For the sum of N patterns (a
gamma distribution of shape N) the delta method gives Var(Ĉ) = C²·(1 + 1/N)/(2n).
"""

from __future__ import annotations

import numpy as np
import pytest

from holoview.metrics.speckle import independent_patterns, speckle_contrast
from holoview.util.errors import UserError

SIZE = 256


def _speckle(patterns: int, seed: int) -> np.ndarray:
    """Mean of `patterns` intensities of circular complex Gaussian fields, independent from pixel to pixel; mean 1."""
    real, imaginary = np.random.default_rng(seed).normal(scale=np.sqrt(0.5), size=(2, patterns, SIZE, SIZE))
    return np.asarray(np.mean(real**2 + imaginary**2, axis=0))


def _tolerance(patterns: int, n_pixels: int) -> float:
    return 4 * float(np.sqrt((1 + 1 / patterns) / (2 * n_pixels) / patterns))


@pytest.mark.parametrize("patterns", [1, 3, 8])
def test_the_sum_of_independent_patterns_has_contrast_one_over_root_n(patterns: int) -> None:
    result = speckle_contrast(_speckle(patterns, seed=patterns))
    assert result.contrast == pytest.approx(1 / np.sqrt(patterns), abs=_tolerance(patterns, SIZE**2))
    assert independent_patterns(result.contrast) == pytest.approx(patterns, rel=0.04)
    assert result.n_pixels == SIZE**2
    assert result.contrast == result.std / result.mean


def test_contrast_ignores_brightness_and_a_smooth_image_has_none() -> None:
    image = _speckle(2, seed=0)
    assert speckle_contrast(7.5 * image).contrast == pytest.approx(speckle_contrast(image).contrast, rel=1e-12)
    flat = speckle_contrast(np.full((5, 6), 0.25))
    assert (flat.contrast, flat.mean, flat.n_pixels) == (0.0, 0.25, 30)
    assert independent_patterns(flat.contrast) == np.inf


def test_a_region_is_x_y_width_height() -> None:
    image = np.zeros((10, 20))
    image[2:5, 12:19] = 3.0
    result = speckle_contrast(image, region=(12, 2, 7, 3))
    assert (result.contrast, result.mean, result.n_pixels) == (0.0, 3.0, 21)


@pytest.mark.parametrize("region", [(0, 0, 0, 5), (0, 0, 5, -1), (-1, 0, 5, 5), (16, 0, 5, 5), (0, 6, 5, 5)])
def test_a_region_that_is_empty_or_outside_is_refused_with_the_size_of_the_image(
    region: tuple[int, int, int, int],
) -> None:
    with pytest.raises(UserError, match="20 × 10 pixels"):
        speckle_contrast(np.ones((10, 20)), region=region)


@pytest.mark.parametrize("patterns", [1, 8])
def test_a_known_target_is_divided_out_where_plain_contrast_is_far_off(patterns: int) -> None:
    y, x = np.mgrid[:SIZE, :SIZE]
    texture = 1.0 + 0.9 * np.sin(x / 9) * np.cos(y / 7) + 2.0 * (x // 32 % 2)
    image = 0.37 * texture * _speckle(patterns, seed=10 + patterns)
    true = 1 / np.sqrt(patterns)
    plain, divided = speckle_contrast(image), speckle_contrast(image, target=texture)
    assert plain.contrast > 1.2 * true
    assert divided.contrast == pytest.approx(true, abs=_tolerance(patterns, divided.n_pixels))
    assert divided.mean == pytest.approx(1.0, abs=0.02)  # the gain is fitted, over 65 536 pixels of contrast ≤ 1


def test_stray_light_where_the_target_is_dark_takes_no_part() -> None:
    target = np.ones((SIZE, SIZE))
    target[:, : SIZE // 2] = 1e-3
    image = target * _speckle(4, seed=5) + 0.02 * (target < 1)
    result = speckle_contrast(image, target=target)
    assert result.n_pixels == SIZE**2 // 2
    assert result.contrast == pytest.approx(0.5, abs=_tolerance(4, result.n_pixels))


def test_what_cannot_be_measured_is_refused() -> None:
    with pytest.raises(UserError, match="luminance"):
        speckle_contrast(np.ones((4, 4, 3)))
    with pytest.raises(UserError, match="light on them"):
        speckle_contrast(np.zeros((4, 4)))
    with pytest.raises(UserError, match="two or more pixels"):
        speckle_contrast(np.ones((4, 4)), region=(1, 1, 1, 1))
    with pytest.raises(UserError, match="light on them"):
        speckle_contrast(np.ones((4, 4)), target=np.zeros((4, 4)))
    with pytest.raises(UserError, match="the image's shape"):
        speckle_contrast(np.ones((4, 4)), target=np.ones((4, 5)))
    with pytest.raises(UserError, match="0 or more"):
        independent_patterns(-0.1)
