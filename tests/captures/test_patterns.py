"""Random patterns use all levels and go from smooth to rough; roughness is a mean squared difference."""

from __future__ import annotations

import numpy as np
import pytest

from holoview.captures.patterns import pattern_roughness, random_levels
from tests.captures.conftest import SHAPE, pictures


def test_patterns_go_from_smooth_to_rough_and_use_the_range() -> None:
    rng = np.random.default_rng(0)
    steps = []
    for sigma in (6.0, 1.5, 0.0):
        levels = random_levels(rng, (64, 80), 16, sigma)
        assert (levels.min(), levels.max(), levels.dtype) == (0, 15, np.uint8)
        steps.append(np.abs(np.diff(levels.astype(int), axis=1)).mean())
    assert steps[0] < 0.3 * steps[1] < 0.3 * steps[2]
    assert random_levels(rng, (4, 4), 1024, 0.0).dtype == np.uint16


def test_roughness_is_the_mean_squared_step() -> None:
    """A ramp of one level a column: (1/15)² along rows, 0 along columns; a chequerboard: 1 and 1."""
    ramp = np.broadcast_to(np.arange(SHAPE[1]) % 16, SHAPE)
    chequers = 15 * (np.indices(SHAPE).sum(axis=0) % 2)
    flat = np.zeros(SHAPE)
    levels = np.stack([np.stack([p, p]) for p in (np.minimum(ramp, 15), chequers, flat)]).astype(np.uint8)
    rough = pattern_roughness(pictures(3, levels=levels))
    steps = np.diff(ramp.astype(float), axis=1) / 15
    assert rough == pytest.approx([np.mean(steps**2), 2.0, 0.0])
