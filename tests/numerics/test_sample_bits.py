"""The bits of a picture show in the numbers that don't occur, its clipping in the largest number."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from holoview.light.numerics.sample_bits import find_bits, find_clipping


def _speckle(mean: float, bits: int, seed: int = 0) -> NDArray[np.uint16]:
    """Counts (y, x) of fully developed speckle, clipped at the full scale of so many bits."""
    intensity = np.random.default_rng(seed).exponential(mean, (200, 200))
    return np.clip(intensity, 0, (1 << bits) - 1).astype(np.uint16)


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_each_layout_is_told_by_its_values(bits: int) -> None:
    counts = _speckle((1 << bits) / 2.0, bits)
    shift = np.uint16(16 - bits)
    layouts = {
        "plain": counts,
        "left-justified": counts << shift,
        "replicated": counts << shift | counts >> np.uint16(2 * bits - 16),
        "scaled": np.rint(counts * (65535 / ((1 << bits) - 1))).astype(np.uint16),
    }
    white = {"plain": (1 << bits) - 1, "left-justified": ((1 << bits) - 1) << (16 - bits)}
    for layout, samples in layouts.items():
        found = find_bits(samples)
        if layout == "scaled" and (samples == layouts["replicated"]).all():
            continue  # the two differ by rounding alone
        assert (found.layout, found.significant, found.full_scale) == (layout, bits, white.get(layout, 65535))
        assert found.is_sure


def test_8_bits_repeated_in_16_have_the_white_of_16() -> None:
    found = find_bits(_speckle(60, 8) * np.uint16(257))
    assert (found.layout, found.significant, found.full_scale) == ("replicated", 8, 65535)


def test_a_factor_that_is_no_power_of_two_is_told() -> None:
    found = find_bits(_speckle(500, 12) * np.uint16(10))
    assert (found.step, found.describe()) == (10, "multiples of 10")


def test_few_values_show_nothing() -> None:
    """Four values are multiples of 16 with a probability of 2⁻¹⁶ by chance, or by a drawing's choice."""
    found = find_bits(np.array([[0, 16, 160, 1600]], np.uint16))
    assert (found.layout, found.step) == ("plain", 1)


def test_a_dark_picture_of_16_bits_has_no_sure_full_scale() -> None:
    counts = np.clip(_speckle(200, 12), 0, 4000)
    found = find_bits(counts)
    assert not found.is_sure and found.full_scale == 65535


@pytest.mark.parametrize("level", [4095, 3000, 1365])
def test_a_clipped_share_is_exact(level: int) -> None:
    """A share p is clipped at level/mean = −ln p of exponential light."""
    counts = np.minimum(_speckle(level / 2.0, 15), np.uint16(level))
    for values in (counts, counts << np.uint16(2), counts / np.float32(level)):
        clip = find_clipping(values)
        assert clip is not None and clip.level == values.max()
        assert clip.share == np.mean(counts == level)


def test_smooth_pictures_are_not_clipped() -> None:
    """Fringes have their crest most often: 2.41 times as often as the next number. 5000 draws of four laws beside."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:60, :60]
    for _ in range(200):
        kx, ky, deviation = rng.uniform(0.05, 3.0), rng.uniform(0.05, 3.0), rng.uniform(2, 30)
        drawn = (
            128 + 100 * np.sin(kx * x + ky * y),
            rng.normal(128, deviation, (60, 60)),
            rng.exponential(deviation, (60, 60)),
            rng.uniform(0, 8 * deviation, (60, 60)),
        )
        for values in drawn:
            assert find_clipping(np.clip(values, 0, 60000).astype(np.uint16)) is None


def test_a_drawing_of_two_tones_is_not_clipped() -> None:
    assert find_clipping(np.where(np.eye(64) > 0, np.uint8(200), np.uint8(10))) is None
