"""Work that is cut into slices and dropped in the middle leaves nothing behind that counts as done."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import Device
from holoview.model.bench_parts import Modulator
from holoview.model.system import System
from holoview.view import random_drive

pytestmark = pytest.mark.gpu

MODULATOR = Modulator(pitch_m=8e-6, shape=(16, 24), stroke_m=700e-9)
BENCH = System(
    wavelengths_m=[460e-9, 530e-9, 638e-9],
    amplitudes=[[1.0, 1.0, 1.0]],
    modulators=(MODULATOR, MODULATOR),
    gap_m=1e-3,
    planes_m=[3e-3],
    source={"directions": [[0.0, 0.0], [0.0, 0.01]]},
)
A_DISPATCH = 1e-9
EDITS = [
    {"gap": "1 mm"},
    {"gap": "1.5 mm"},
    {"relay2.iris_na": 0.02},
    {"relay2.iris_na": None},
    {"amplitudes": [[1, 2, 0]]},
]


def _fresh(device: Device, system: System, drive: np.ndarray, plane_m: float) -> np.ndarray:
    session = IncrementalRenderer(system, drive, device, plane_m=plane_m)
    session.update(with_srgb=False)
    return session.xyz()


@pytest.mark.parametrize("budget", [2**30, 0], ids=["all is kept", "nothing is kept"])
def test_whatever_is_dropped_half_done_the_next_update_is_right(device: Device, budget: int) -> None:
    dice, drive = np.random.default_rng(5), random_drive(BENCH, 1)
    session = IncrementalRenderer(BENCH, drive, device, budget_bytes=budget)
    system, plane_m = BENCH, 3e-3
    for turn in range(24):
        system = system.edit(EDITS[dice.integers(len(EDITS))])
        plane_m = float(dice.choice([3e-3, 4e-3]))
        session.edit(system=system, plane_m=plane_m)
        if turn % 6 != 5:
            for _ in islice(session.steps(with_srgb=False, slice_s=A_DISPATCH), int(dice.integers(1, 40))):
                pass
            continue
        session.update(with_srgb=False)
        np.testing.assert_array_equal(session.xyz(), _fresh(device, system, drive, plane_m))


def test_another_iterator_ends_the_one_before(device: Device) -> None:
    session = IncrementalRenderer(BENCH, random_drive(BENCH, 1), device)
    first = session.steps(slice_s=A_DISPATCH)
    next(first)
    second = session.steps(slice_s=A_DISPATCH)
    next(second)
    assert list(first) == []
    assert list(second)
    np.testing.assert_array_equal(session.xyz(), _fresh(device, BENCH, random_drive(BENCH, 1), 3e-3))


def test_an_intensity_that_is_asked_for_in_between_ends_an_update(device: Device) -> None:
    session = IncrementalRenderer(BENCH, random_drive(BENCH, 1), device)
    steps = session.steps(slice_s=A_DISPATCH)
    next(steps)
    wanted = session.intensity(2)
    assert list(steps) == []
    session.update()
    np.testing.assert_array_equal(session.intensity(2), wanted)
