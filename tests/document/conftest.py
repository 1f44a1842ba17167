"""A small bench and a session on it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from holoview.light.model.bench_parts import Modulator
from holoview.light.model.system import System
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.target_builder import TargetSpec

MODULATOR = Modulator(pitch_m=8e-6, shape=(24, 32), stroke_m=825e-9)


def small_system(**changes: object) -> System:
    """Three lasers, two modulators of 24 × 32 pixels, two focal planes; a simulated image of 48 × 64."""
    system = System(
        wavelengths_m=[460e-9, 532e-9, 638e-9],
        amplitudes=[[1.0, 1.0, 1.0]],
        modulators=(MODULATOR, MODULATOR),
        gap_m=1e-3,
        planes_m=[3e-3, 4e-3],
        name="small",
    )
    return system.edit(changes) if changes else system


@pytest.fixture
def session() -> Iterator[EditingSession]:
    made = EditingSession(small_system())
    yield made
    made.close()


@pytest.fixture
def target_spec() -> TargetSpec:
    """A bright square on grey."""
    pixels = np.full((48, 64, 3), 90, np.uint8)
    pixels[12:36, 16:48] = 230
    return target_from_pixels(pixels, "square")
