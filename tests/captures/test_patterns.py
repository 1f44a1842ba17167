"""Random patterns use all levels and go from smooth to rough; roughness is a mean squared difference."""

from __future__ import annotations

import math

import numpy as np
import pytest

from holoview.bench.captures.patterns import pattern_roughness, random_levels
from tests.captures.conftest import SHAPE, pictures


def test_patterns_use_the_range() -> None:
    rng = np.random.default_rng(0)
    for sigma in (6.0, 1.5, 0.0):
        levels = random_levels(rng, (64, 80), 16, sigma)
        assert (levels.min(), levels.max(), levels.dtype) == (0, 15, np.uint8)
    assert random_levels(rng, (4, 4), 1024, 0.0).dtype == np.uint16


@pytest.mark.parametrize("sigma_px", [6.0, 1.5, 0.0])
def test_patterns_are_as_smooth_as_their_blur(sigma_px: float) -> None:
    """Neighbours have the correlation exp(−1/4σ²), so that ⟨Δ²⟩ is 2·(1 − exp(−1/4σ²)) of the variance.

    A mean square of n correlated normal numbers has the relative variance 2·Σρ²/n with Σρ² = 2πσ² at most, and the
    ratio of two at most four times that: 5 σ of it, a chance below 1e-6. Mirrored edges add 4σ of a side.
    """
    shape = (512, 640)
    levels = random_levels(np.random.default_rng(0), shape, 4096, sigma_px).astype(float)
    correlation = math.exp(-1 / (4 * sigma_px**2)) if sigma_px else 0.0
    deviation = 2 * math.sqrt(2 * max(2 * math.pi * sigma_px**2, 1.0) / math.prod(shape))
    step = np.mean(np.diff(levels, axis=1) ** 2) / levels.var()
    assert step == pytest.approx(2 * (1 - correlation), rel=5 * deviation + 4 * sigma_px / min(shape))


def test_roughness_is_the_mean_squared_step() -> None:
    """A ramp of one level a column: (1/15)² along rows, 0 along columns; a chequerboard: 1 and 1."""
    ramp = np.broadcast_to(np.arange(SHAPE[1]) % 16, SHAPE)
    chequers = 15 * (np.indices(SHAPE).sum(axis=0) % 2)
    flat = np.zeros(SHAPE)
    levels = np.stack([np.stack([p, p]) for p in (np.minimum(ramp, 15), chequers, flat)]).astype(np.uint8)
    rough = pattern_roughness(pictures(3, levels=levels))
    steps = np.diff(ramp.astype(float), axis=1) / 15
    assert rough == pytest.approx([np.mean(steps**2), 2.0, 0.0])
