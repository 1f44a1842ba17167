"""Captures for tests that need images but no optics."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from holoview.bench.captures.dataset import Camera, Captures, SlmSpec
from holoview.light.model.bench_parts import Relay

SHAPE = (32, 40)


def pictures(count: int = 4, seed: int = 0, **changes: Any) -> Captures:
    """Captures whose images are independent random numbers, without optics; two wavelengths take turns."""
    rng = np.random.default_rng(seed)
    plain = Captures(
        levels=rng.integers(0, 16, (count, 2, *SHAPE), dtype=np.uint8),
        images=rng.integers(200, 1500, (count, 2 * SHAPE[0], 2 * SHAPE[1])).astype(np.uint16),
        wavelength_m=np.resize([450e-9, 600e-9], count),
        distance_m=np.full(count, 4e-3),
        power=np.ones(count),
        exposure_s=np.ones(count),
        slms=(SlmSpec(8e-6, 16, 825e-9),) * 2,
        camera=Camera(4e-6, 12, 4.0, 3.0, 64.0),
        gap_m=1e-3,
        relay1=Relay(iris_na=0.03),
        relay2=Relay(iris_na=0.03),
    )
    return dataclasses.replace(plain, **changes)


@pytest.fixture
def make_captures() -> Callable[..., Captures]:
    """Makes captures whose images are random numbers."""
    return pictures
