"""An update that is abandoned between two slices leaves no result that is wrongly taken as current."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.gpu.device import Device
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.system import System
from tests.explored import explored

pytestmark = pytest.mark.gpu

MODULATOR = Modulator(pitch_m=8e-6, shape=(16, 24), stroke_m=700e-9)
SYSTEM = System(
    wavelengths_m=[460e-9, 530e-9, 638e-9],
    amplitudes=[[1.0, 1.0, 1.0]],
    modulators=(MODULATOR, MODULATOR),
    gap_m=1e-3,
    planes_m=[3e-3],
    source={"directions": [[0.0, 0.0], [0.0, 0.01]]},
)
ONE_DISPATCH_S = 1e-9
EDITS = [
    {"gap": "1 mm"},
    {"gap": "1.5 mm"},
    {"relay2.iris_na": 0.02},
    {"relay2.iris_na": None},
    {"amplitudes": [[1, 2, 0]]},
]


def _fresh(device: Device, system: System, drive: np.ndarray, plane_m: float) -> np.ndarray:
    """XYZ of a new renderer with the kernels of `SYSTEM`, which stops of an edit don't replace."""
    renderer = IncrementalRenderer(SYSTEM, drive, device, plane_m=plane_m)
    renderer.edit(system=system)
    renderer.update(with_srgb=False)
    return renderer.xyz()


@pytest.mark.parametrize("budget", explored([2**30, 0], [0]))
def test_whatever_is_dropped_half_done_the_next_update_is_right(device: Device, budget: int) -> None:
    rng, drive = np.random.default_rng(5), random_drive(SYSTEM, 1)
    renderer = IncrementalRenderer(SYSTEM, drive, device, budget_bytes=budget)
    system, plane_m = SYSTEM, 3e-3
    for turn in range(24):
        system = system.edit(EDITS[rng.integers(len(EDITS))])
        plane_m = float(rng.choice([3e-3, 4e-3]))
        renderer.edit(system=system, plane_m=plane_m)
        if turn % 6 != 5:
            for _ in islice(renderer.steps(with_srgb=False, slice_s=ONE_DISPATCH_S), int(rng.integers(1, 40))):
                pass
            continue
        renderer.update(with_srgb=False)
        np.testing.assert_array_equal(renderer.xyz(), _fresh(device, system, drive, plane_m))


def test_another_iterator_ends_the_one_before(device: Device) -> None:
    renderer = IncrementalRenderer(SYSTEM, random_drive(SYSTEM, 1), device)
    first = renderer.steps(slice_s=ONE_DISPATCH_S)
    next(first)
    second = renderer.steps(slice_s=ONE_DISPATCH_S)
    next(second)
    assert list(first) == []
    assert list(second)
    np.testing.assert_array_equal(renderer.xyz(), _fresh(device, SYSTEM, random_drive(SYSTEM, 1), 3e-3))


def test_an_intensity_that_is_asked_for_in_between_ends_an_update(device: Device) -> None:
    renderer = IncrementalRenderer(SYSTEM, random_drive(SYSTEM, 1), device)
    steps = renderer.steps(slice_s=ONE_DISPATCH_S)
    next(steps)
    intensity = renderer.intensity(2)
    assert list(steps) == []
    renderer.update()
    np.testing.assert_array_equal(renderer.intensity(2), intensity)
