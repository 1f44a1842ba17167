"""MS-SSIM of linear sRGB images: of the display signal, clipped, channel by channel and plane by plane."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from holoview.colour import srgb_encode
from holoview.metrics.perceptual import ms_ssim
from holoview.numerics.structural_similarity import multi_scale_similarity
from holoview.util.errors import UserError


def _light(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.1, 1.1, shape)


def test_equal_images_have_1_and_planes_their_own_values() -> None:
    target = _light(3, 24, 30, 3)
    image = target.copy()
    image[1] = _light(24, 30, 3, seed=1)
    found = ms_ssim(image, target)
    assert found.planes[0] == found.planes[2] == pytest.approx(1, abs=1e-12)
    assert found.planes[1] < 0.5 and found.mean == pytest.approx(np.mean(found.planes)) and found.scales == 2


def test_it_is_the_mean_over_channels_of_the_clipped_display_signal() -> None:
    image, target = _light(40, 30, 3), _light(40, 30, 3, seed=1)
    signals = [torch.from_numpy(np.moveaxis(srgb_encode(np.clip(one, 0, 1)), -1, 0).copy()) for one in (image, target)]
    assert ms_ssim(image, target).mean == pytest.approx(float(multi_scale_similarity(*signals).mean()), rel=1e-12)


def test_brightness_is_not_fitted() -> None:
    target = 0.6 * np.clip(_light(32, 32, 3), 0, 1)
    assert ms_ssim(0.5 * target, target).mean < 0.95


@pytest.mark.parametrize(
    ("image", "target", "words"),
    [
        ((8, 40, 3), (8, 40, 3), "40 x 8 samples; expected at least 11 rows and columns"),
        ((20, 20, 3), (20, 21, 3), r"expected \(y, x, 3\)"),
        ((20, 20), (20, 20), r"expected \(y, x, 3\)"),
    ],
)
def test_images_that_do_not_fit_are_refused(image: tuple[int, ...], target: tuple[int, ...], words: str) -> None:
    with pytest.raises(UserError, match=words):
        ms_ssim(np.zeros(image), np.zeros(target))
