"""A small measurement session, and what is predicted for it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from holoview.bench.captures.dataset import Camera, Captures, SlmSpec
from holoview.bench.captures.predictor import Predictor
from holoview.light.model.bench_parts import Relay

SHAPE = (20, 28)
PITCH = 8e-6


def session(count: int = 2, modulators: int = 2, **changes: Any) -> Captures:
    """Captures of random patterns at 520 nm, 3 mm behind modulator 2; single ones 3 mm behind the only one."""
    rng = np.random.default_rng(3)
    two = modulators == 2
    plain = Captures(
        levels=rng.integers(0, 16, (count, modulators, *SHAPE), dtype=np.uint8),
        images=np.full((count, 2 * SHAPE[0], 2 * SHAPE[1]), 500, np.uint16),
        wavelength_m=np.full(count, 520e-9),
        distance_m=np.full(count, 3e-3),
        power=np.ones(count),
        exposure_s=np.ones(count),
        slms=(SlmSpec(PITCH, 16, 780e-9),) * modulators,
        camera=Camera(PITCH / 2, 12, 4.0, 3.0, 64.0),
        gap_m=1e-3 if two else None,
        relay1=Relay(iris_na=0.03 if two else None),
        relay2=Relay(iris_na=0.03),
    )
    return dataclasses.replace(plain, **changes)


def fourier(count: int = 2, **changes: Any) -> Captures:
    """Captures on a Fourier bench of 100 mm focal length, camera pixels of 10 µm."""
    camera = Camera(10e-6, 12, 4.0, 3.0, 64.0)
    own: dict[str, Any] = {"distance_m": np.zeros(count), "relay2": Relay(), "camera": camera, "focal_length_m": 0.1}
    return session(count, 1, images=np.full((count, 61, 81), 500, np.uint16), **{**own, **changes})


def signals(captures: Captures, effects: dict[str, dict[str, float]] | None = None) -> torch.Tensor:
    """Predicted signals of all captures, float64."""
    return Predictor(captures, double_precision=True)(range(len(captures)), effects or {}).signal


@pytest.fixture
def make_session() -> Callable[..., Captures]:
    return session


@pytest.fixture
def make_fourier() -> Callable[..., Captures]:
    return fourier


@pytest.fixture
def predicted() -> Callable[..., torch.Tensor]:
    return signals
