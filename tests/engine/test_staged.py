"""The renderer of chains on a device: the reference's picture, after each edit, and nothing computed where none is."""

from __future__ import annotations

import numpy as np
import pytest

import holoview as hv
from holoview.light.engine.staged import StagedRenderer
from holoview.light.gpu.device import Device
from holoview.light.model.system import System

pytestmark = pytest.mark.gpu
TOLERANCE = 2e-6

_PHASE = {"kind": "phase", "name": "phase", "pitch": "8 um", "shape": [24, 32], "stroke": "700 nm"}
_COARSE = {"kind": "amplitude", "name": "coarse", "pitch": "32 um", "shape": [6, 8]}


def chain(**changes: object) -> System:
    """Two frames of two lasers through a phase and a coarse amplitude modulator."""
    elements = (_PHASE, {"kind": "space", "distance": "2 mm"}, _COARSE)
    bench = System(["460 nm", "633 nm"], [[1.0, 0.0], [0.3, 0.7]], elements=elements, planes_m=[4e-3, 6e-3])
    return bench.edit(changes)


def assert_is_reference(renderer: StagedRenderer, system: System, drive: object, plane_m: float) -> None:
    """To the tolerance of a frame in tests/parity/test_frame.py, relative L2: rounding of single precision."""
    for _ in renderer.steps():
        pass
    view = hv.simulate(system, drive, planes=[plane_m], backend="torch64")
    assert np.linalg.norm(renderer.xyz() - view.xyz[0]) < TOLERANCE * np.linalg.norm(view.xyz[0])
    for laser, expected in enumerate(view.intensity[0]):
        assert np.linalg.norm(renderer.intensity(laser) - expected) < TOLERANCE * np.linalg.norm(expected)


def test_it_shows_what_the_reference_does_after_each_edit(device: Device) -> None:
    system, drive = chain(), hv.random_drive(chain())
    renderer = StagedRenderer(system, drive, device, plane_m=6e-3)
    assert_is_reference(renderer, system, drive, 6e-3)
    renderer.edit(plane_m=5e-3)
    assert_is_reference(renderer, system, drive, 5e-3)
    longer, other = chain(**{"elements.1.distance": "3 mm"}), hv.random_drive(system, 1)
    renderer.edit(system=longer, drive=other)
    assert_is_reference(renderer, longer, other, 5e-3)


def test_an_equal_scene_needs_no_step_and_an_edit_ends_the_steps_before(device: Device) -> None:
    system, drive = chain(), hv.random_drive(chain())
    renderer = StagedRenderer(system, drive, device, plane_m=6e-3)
    steps = list(renderer.steps())
    assert [step.done for step in steps] == [1, 2, 3]  # pairs of a frame and a laser that is on
    renderer.edit(system=chain(), drive=drive, plane_m=6e-3)
    assert renderer.pending_count() == 0
    renderer.edit(plane_m=5e-3)
    half = renderer.steps()
    next(half)
    renderer.edit(plane_m=4e-3)
    assert list(half) == []
    assert_is_reference(renderer, system, drive, 4e-3)


def test_a_refused_edit_changes_nothing(device: Device) -> None:
    system, drive = chain(), hv.random_drive(chain())
    renderer = StagedRenderer(system, drive, device, plane_m=6e-3)
    with pytest.raises(hv.UserError, match="patterns of phase"):
        renderer.edit(drive={})
    assert renderer.drive is drive
    assert_is_reference(renderer, system, drive, 6e-3)
