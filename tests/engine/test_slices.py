"""Work that is submitted in slices gives the same image, and abandoned work leaves no result that counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.gpu.device import Device
from holoview.light.gpu.recorder import SlicedRecorder
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.system import System

pytestmark = pytest.mark.gpu

MODULATOR = Modulator(pitch_m=8e-6, shape=(24, 32), stroke_m=825e-9)
SYSTEM = System(
    wavelengths_m=[460e-9, 540e-9, 638e-9],
    amplitudes=[[1.0, 2.0, 0.5]],
    modulators=(MODULATOR, MODULATOR),
    gap_m=1e-3,
    planes_m=[3e-3],
)
SHORT_S = 1e-9  # a dispatch at a time
LONG_S = 10.0


def _open(device: Device, system: System = SYSTEM, **options: Any) -> IncrementalRenderer:
    return IncrementalRenderer(system, random_drive(system), device, strategy="passes", max_wavelengths=1, **options)


@pytest.mark.parametrize("slice_s", [SHORT_S, LONG_S])
@pytest.mark.parametrize("budget_bytes", [0, 2**30])
def test_slices_give_what_whole_steps_give(device: Device, slice_s: float, budget_bytes: int) -> None:
    whole, cut = _open(device, budget_bytes=budget_bytes), _open(device, budget_bytes=budget_bytes)
    whole.update()
    steps = list(cut.steps(slice_s=slice_s))
    assert steps[-1].done == steps[-1].total
    assert [step.done for step in steps] == sorted(step.done for step in steps)
    assert np.array_equal(cut.xyz(), whole.xyz())
    assert np.array_equal(cut.srgb8(), whole.srgb8())
    assert not list(cut.steps(slice_s=slice_s))


def test_a_slice_is_about_as_long_as_asked(device: Device) -> None:
    short, long = (len(list(_open(device).steps(slice_s=slice_s))) for slice_s in (SHORT_S, LONG_S))
    assert short > 2 * long


@pytest.mark.parametrize("sources", [1, 2])
@pytest.mark.parametrize("dropped_after", [1, 2, 4, 7, 9, 12, 15])
def test_work_dropped_between_slices_leaves_nothing_that_counts(
    device: Device, dropped_after: int, sources: int
) -> None:
    """An edit is begun, dropped half way, and taken back: what was half overwritten has to be computed again."""
    system = SYSTEM.edit({"source": {"grid": [1, sources], "spacing": "1 mrad"}}) if sources > 1 else SYSTEM
    renderer = _open(device, system)
    renderer.update()
    expected = renderer.xyz()
    for change in ({"gap": "1.5 mm"}, {"wavelengths": ["470 nm", "550 nm", "628 nm"]}, {"gap": "1.2 mm"}):
        renderer.edit(system=system.edit(change))
        steps = renderer.steps(slice_s=SHORT_S)
        for _ in range(dropped_after):
            next(steps, None)
        renderer.edit(system=system)
        renderer.update()
        assert np.array_equal(renderer.xyz(), expected)


def test_functions_of_a_sliced_recorder_are_called_at_its_end_only(device: Device) -> None:
    recorder, calls = SlicedRecorder(device), []
    buffers = [device.buffer(16, f"buffer {i}") for i in range(3)]
    for buffer in buffers:
        recorder.clear(buffer)
    recorder.on_submit(lambda: calls.append("done"))
    recorder.submit_next(2)
    assert (recorder.remaining, calls) == (1, [])
    recorder.submit_next(2, wait=True)
    assert (recorder.remaining, calls) == (0, ["done"])
