"""Contrast in a band of visual frequencies: gratings, scaling, and what can't be measured."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.holograms.metrics.perceptual import band_contrast, contrast_like
from holoview.util.errors import UserError

DEGREES = 1 / 170


def _grating(cycles_a_degree: float, modulation: float) -> NDArray[np.float64]:
    x = np.arange(512) * DEGREES
    return np.tile(5.0 * (1 + modulation * np.sin(2 * np.pi * cycles_a_degree * x)), (384, 1))


@pytest.mark.parametrize("modulation", [0.1, 0.7])
def test_a_grating_of_modulation_m_has_the_contrast_m_over_root_2(modulation: float) -> None:
    """Over the 18 periods under the window, some 10⁻³ of its power leaks out of the band."""
    found = band_contrast(_grating(6.0, modulation), DEGREES, (3.0, 12.0))
    assert found == pytest.approx(modulation / np.sqrt(2), rel=2e-3)


def test_a_grating_outside_the_band_doesn_t_count() -> None:
    assert band_contrast(_grating(30.0, 0.9), DEGREES, (3.0, 12.0)) < 1e-3
    assert band_contrast(np.full((64, 64), 2.0), DEGREES, (3.0, 12.0)) == pytest.approx(0, abs=1e-12)


def test_brightness_doesn_t_count() -> None:
    image = np.random.default_rng(0).random((128, 128))
    one, other = (band_contrast(factor * image, DEGREES, (3.0, 12.0)) for factor in (1.0, 7.0))
    assert one == pytest.approx(other, rel=1e-12)


@pytest.mark.parametrize(
    ("image", "degrees"), [(np.zeros((64, 64)), DEGREES), (np.ones((8, 8)), DEGREES), (np.ones((64, 64)), 0.1)]
)
def test_what_can_t_be_measured_is_refused(image: NDArray[np.float64], degrees: float) -> None:
    with pytest.raises(UserError, match="cycles a degree"):
        band_contrast(image, degrees, (3.0, 12.0))


def test_only_what_is_like_the_reference_counts() -> None:
    """Half of a grating's contrast, under noise whose own contrast is larger, comes back within the noise's projection.

    Noise of N band coefficients has a part of about 1/√N of its contrast along any one of them. The image has 2900 in
    the band, of which its Hann window leaves 0.514² (per axis (3/8)²/(35/128)) independent ones: N ≈ 760.
    """
    wanted, noise = _grating(6.0, 0.4), np.random.default_rng(1).normal(size=(384, 512))
    own = band_contrast(wanted, DEGREES, (3.0, 12.0))
    assert contrast_like(wanted, wanted, DEGREES, (3.0, 12.0)) == pytest.approx(own, rel=1e-12)
    seen = _grating(6.0, 0.2) + 8 * noise
    assert band_contrast(seen, DEGREES, (3.0, 12.0)) > 1.2 * own / 2
    found = contrast_like(seen, wanted, DEGREES, (3.0, 12.0))
    assert found == pytest.approx(own / 2, abs=5 * band_contrast(5 + 8 * noise, DEGREES, (3.0, 12.0)) / np.sqrt(760))
    # under the window, the mean of the grating is 5 to a millionth
    assert contrast_like(10 - wanted, wanted, DEGREES, (3.0, 12.0)) == pytest.approx(-own, rel=1e-5)
