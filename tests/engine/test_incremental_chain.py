"""The renderer of chains on a device: the reference's picture, after each edit, and nothing computed where none is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.light.engine.fused import DeviceTables
from holoview.light.engine.incremental import BUDGET_BYTES, IncrementalRenderer
from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.line_fft import STRATEGIES, Strategy, supported_strategies
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


def assert_is_reference(renderer: IncrementalRenderer, system: System, drive: object, plane_m: float) -> None:
    """To the tolerance of a frame in tests/parity/test_frame.py, relative L2: rounding of single precision."""
    renderer.update()
    view = hv.simulate(system, drive, planes=[plane_m], backend="torch64")
    assert np.linalg.norm(renderer.xyz() - view.xyz[0]) < TOLERANCE * np.linalg.norm(view.xyz[0])
    for laser, expected in enumerate(view.intensity[0]):
        assert np.linalg.norm(renderer.intensity(laser) - expected) < TOLERANCE * np.linalg.norm(expected)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_it_shows_what_the_reference_does_after_each_edit(device: Device, strategy: Strategy) -> None:
    """Kernels work in place here, but for `passes`, until light behind the first element is kept."""
    system, drive = chain(), hv.random_drive(chain())
    if strategy not in supported_strategies(device, hv.make_plan(system).grid.padded):
        pytest.skip("this adapter's lanes exchange nothing")
    renderer = IncrementalRenderer(system, drive, device, plane_m=6e-3, strategy=strategy)
    assert_is_reference(renderer, system, drive, 6e-3)
    renderer.edit(plane_m=5e-3)
    assert_is_reference(renderer, system, drive, 5e-3)
    longer, other = chain(**{"elements.1.distance": "3 mm"}), hv.random_drive(system, 1)
    renderer.edit(system=longer, drive=other)
    assert_is_reference(renderer, longer, other, 5e-3)
    for share in (0.9, 0.8):
        darker = dict(other) | {"coarse": other["coarse"] * np.float32(share)}
        renderer.edit(drive=darker)
        assert_is_reference(renderer, longer, darker, 5e-3)
        assert_is_new(renderer, device)


def test_an_equal_scene_needs_no_step_and_an_edit_ends_the_steps_before(device: Device) -> None:
    system, drive = chain(), hv.random_drive(chain())
    renderer = IncrementalRenderer(system, drive, device, plane_m=6e-3)
    steps = list(renderer.steps(with_srgb=False))
    assert [step.done for step in steps] == [1, 2, 3, 4]  # pairs of a frame and a laser that is on, and XYZ
    renderer.edit(system=chain(), drive=drive, plane_m=6e-3)
    assert renderer.pending_count(with_srgb=False) == 0
    assert_is_reference(renderer, system, drive, 6e-3)
    renderer.edit(plane_m=5e-3)
    half = renderer.steps()
    next(half)
    renderer.edit(plane_m=4e-3)
    assert list(half) == []
    assert_is_reference(renderer, system, drive, 4e-3)


def test_a_refused_edit_changes_nothing(device: Device) -> None:
    system, drive = chain(), hv.random_drive(chain())
    renderer = IncrementalRenderer(system, drive, device, plane_m=6e-3)
    with pytest.raises(hv.UserError, match="patterns of phase"):
        renderer.edit(drive={})
    assert renderer.drive is drive
    assert_is_reference(renderer, system, drive, 6e-3)


_SLM = {"kind": "phase", "pitch": "8 um", "shape": [12, 16], "stroke": "700 nm"}
ELEMENTS = (
    {**_SLM, "name": "slm"},
    {"kind": "space", "name": "one", "distance": "1 mm", "iris_na": 0.03},
    {"kind": "lens", "name": "lens", "focal_length": "20 mm"},
    {**_SLM, "kind": "mask", "name": "mask", "pattern": "random"},
    {**_SLM, "name": "arm", "beside": "mask"},
    {"kind": "space", "name": "two", "distance": "1 mm"},
    {"kind": "complex", "name": "cells", "pitch": "8 um", "shape": [12, 16]},
)


def long_chain(**changes: object) -> System:
    """Three places, at the second a lens before two elements beside each other; two frames of two lasers."""
    lasers = {"wavelengths_m": ["460 nm", "633 nm"], "amplitudes": [[1.0, 0.2], [0.3, 0.7]]}
    return System(**lasers, elements=ELEMENTS, planes_m=[4e-3, 6e-3]).edit(changes)


def computed(renderer: IncrementalRenderer, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The places, by their numbers on the way, at which an update multiplies light."""
    places, dense = [], DeviceTables.dense

    def counted(self: DeviceTables, frame: int, place: int, wavelength: int) -> tuple[bool, Buffer]:
        places.append(place)
        return dense(self, frame, place, wavelength)

    with monkeypatch.context() as patched:
        patched.setattr(DeviceTables, "dense", counted)
        renderer.update()
    return sorted(set(places))


def assert_is_new(renderer: IncrementalRenderer, device: Device) -> None:
    """The picture has the bits of a renderer that has kept nothing."""
    same = {"plane_m": renderer.plane_m, "strategy": renderer.strategy}
    new = IncrementalRenderer(renderer.system, renderer.drive, device, **same)
    new.update()
    np.testing.assert_array_equal(renderer.xyz(), new.xyz())


def test_what_goes_on_being_edited_computes_what_lies_behind_it(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, drive = long_chain(), dict(hv.random_drive(long_chain()))
    renderer = IncrementalRenderer(system, drive, device, plane_m=6e-3)
    assert computed(renderer, monkeypatch) == [0, 1, 2]
    edits = (
        (lambda step: {"plane_m": 5e-3 + step * 1e-4}, []),
        (lambda step: {"system": long_chain(**{"elements.two.distance": 1e-3 + step * 1e-4})}, [2]),
        (lambda step: {"drive": drive | {"arm": drive["arm"] * np.float32(0.8 - step / 10)}}, [1, 2]),
        (lambda step: {"drive": drive | {"slm": drive["slm"] * np.float32(0.8 - step / 10)}}, [0, 1, 2]),
        (lambda step: {"system": long_chain(**{"elements.lens.focal_length": 2e-2 + step * 1e-3})}, [1, 2]),
        (lambda step: {"system": long_chain(wavelengths=[470e-9 + step * 1e-9, 633e-9])}, [0, 1, 2]),
        (lambda step: {"system": long_chain(amplitudes=[[1.0, 0.2 + step / 10], [0.3, 0.7]])}, []),
    )
    for change, expected in edits:
        for step in range(3):
            renderer.edit(**change(step))
            numbers = computed(renderer, monkeypatch)
        assert numbers == expected
        assert_is_new(renderer, device)


@pytest.mark.parametrize("seed", range(3))
def test_any_edits_give_the_bits_of_a_new_renderer(device: Device, seed: int) -> None:
    """Some updates are left half done; in one run memory has room for the light of two of four beams, of 18 kB each."""
    budget_bytes = 60_000 if seed == 2 else BUDGET_BYTES
    rng, system = np.random.default_rng(seed), long_chain(**{"effects.misplaced@cells.shift_y": 3e-6} if seed else {})
    drive = dict(hv.random_drive(system))
    renderer = IncrementalRenderer(system, drive, device, plane_m=6e-3, budget_bytes=budget_bytes)
    edits: list[Callable[[], dict[str, Any]]] = [
        lambda: {"plane_m": float(rng.uniform(4e-3, 6e-3))},
        lambda: {
            "system": renderer.system.edit({f"elements.{rng.choice(['one', 'two'])}.distance": rng.uniform(0, 2e-3)})
        },
        lambda: {"system": renderer.system.edit({"elements.one.iris_na": rng.uniform(0.029, 0.0304)})},
        lambda: {"system": renderer.system.edit({"elements.mask.seed": int(rng.integers(9))})},
        lambda: {"system": renderer.system.edit({"amplitudes": rng.uniform(size=(2, 2)) * rng.integers(0, 2, (2, 2))})},
        lambda: {"system": renderer.system.edit({"eye": [{"pupil": "2 mm"}, None][rng.integers(2)]})},
        lambda: {"system": renderer.system.edit({"effects.undiffracted@cells.share": rng.uniform(0, 0.3)})},
        lambda: {"system": renderer.system.edit({"effects.stroke@slm.stroke_error": rng.uniform(0, 0.3)})},
        lambda: {"drive": hv.random_drive(renderer.system, int(rng.integers(9)))},
        lambda: {"drive": dict(renderer.drive) | {"cells": renderer.drive["cells"] * np.complex64(0.9)}},
    ]
    for _ in range(12):
        change = edits[rng.integers(len(edits))]
        for _ in range(rng.integers(1, 4)):
            renderer.edit(**change())
            next(iter(renderer.steps()), None)
        renderer.update()
        assert_is_new(renderer, device)
