"""Correlations of speckle: as the number of grains says for unrelated pictures, blind to brightness and position."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from holoview.bench.captures.records.trials import SpeckleComparison

SHAPE = (64, 80)
PAIRS = 150
UNRELATED_TOLERANCE = 5 * (2 / PAIRS) ** 0.5
"""5 σ of the sample variance of so many numbers of variance 1."""


def _speckle(rng: np.random.Generator, grain_px: float) -> NDArray[np.float64]:
    """Light of a random field whose grains are about so large."""
    field = gaussian_filter(rng.standard_normal((2, *SHAPE)), (0, grain_px, grain_px), mode="wrap")
    return np.square(field).sum(axis=0)


@pytest.mark.parametrize("grain_px", [1.0, 2.0, 4.0])
def test_unrelated_pictures_scatter_as_the_grains_say(grain_px: float) -> None:
    comparison, rng = SpeckleComparison(SHAPE), np.random.default_rng(0)
    squares = []
    for _ in range(PAIRS):
        match = comparison.match(*(comparison.contrast(_speckle(rng, grain_px)) for _ in range(2)))
        middle = match.fisher_z.shape[1] // 2
        squares.append(match.fisher_z[:, middle, middle] ** 2 * match.grains)
    assert np.mean(squares, axis=0) == pytest.approx(1.0, abs=UNRELATED_TOLERANCE)


def test_large_grains_are_fewer() -> None:
    """At the widest blur, where they differ least, log G of one pair is 4.59 ± 0.17 and 4.20 ± 0.19 (200 pairs).

    The difference of the means of 20 pairs is then 0.39 ± 0.06, negative once in 10¹⁰.
    """
    comparison, rng = SpeckleComparison(SHAPE), np.random.default_rng(0)

    def log_grains(size_px: float) -> NDArray[np.float64]:
        pictures = [[comparison.contrast(_speckle(rng, size_px)) for _ in range(2)] for _ in range(20)]
        return np.mean([np.log(comparison.match(*pair).grains) for pair in pictures], axis=0)

    assert (log_grains(1.0) > log_grains(4.0)).all()


def test_neither_a_beam_nor_a_power_nor_a_small_shift_lowers_the_correlation() -> None:
    comparison, rng = SpeckleComparison(SHAPE), np.random.default_rng(1)
    light = _speckle(rng, 2.0)
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in SHAPE), indexing="ij")
    seen = np.roll(40 * light * np.exp(-(y**2 + x**2) / 2), (3, -2), (0, 1))
    match = comparison.match(comparison.contrast(seen), comparison.contrast(light))
    reach = match.fisher_z.shape[1] // 2
    assert np.tanh(match.fisher_z[0].max()) > 0.9
    peak = np.unravel_index(match.fisher_z[0].argmax(), match.fisher_z[0].shape)
    assert tuple(int(p) - reach for p in peak) == (3, -2)


def test_a_dark_picture_correlates_with_nothing() -> None:
    comparison = SpeckleComparison(SHAPE)
    dark, lit = comparison.contrast(np.zeros(SHAPE)), comparison.contrast(_speckle(np.random.default_rng(0), 2.0))
    match = comparison.match(dark, lit)
    assert np.abs(match.fisher_z).max() < 1e-6 and np.isfinite(match.grains).all()
