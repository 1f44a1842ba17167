"""A renderer starts with a strategy that is ready and changes to a faster one later; its results stay valid."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from holoview.holograms.view import random_drive
from holoview.light.engine import incremental
from holoview.light.engine.incremental import IncrementalRenderer
from holoview.light.gpu.device import Device
from holoview.light.gpu.line_fft import Strategy, TransformShader
from holoview.light.model.bench_parts import Modulator
from holoview.light.model.system import System

pytestmark = pytest.mark.gpu

MODULATOR = Modulator(pitch_m=8e-6, shape=(16, 32), stroke_m=825e-9)
SYSTEM = System(
    wavelengths_m=[460e-9, 638e-9],
    amplitudes=[[1.0, 2.0]],
    modulators=(MODULATOR, MODULATOR),
    gap_m=1e-3,
    planes_m=[3e-3],
)
AGREEMENT = 1e-6
"""Relative L2 of XYZ by two strategies, each in f32."""


class _FakeTuner:
    """A search that ends with the strategy `result` when `end` is called."""

    created: list[_FakeTuner]
    result: Strategy = "workgroup"

    def __init__(
        self, device: Device, shape: tuple[int, int], shaders: Callable[[Strategy], Iterable[TransformShader]]
    ) -> None:
        self.shape, self.shaders = shape, list(shaders(self.result))
        self.current: Strategy = "passes"
        self.is_settled = self.is_closed = False
        self.created.append(self)

    def poll(self) -> bool:
        return False

    def end(self) -> None:
        self.current, self.is_settled = self.result, True

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def tuners(monkeypatch: pytest.MonkeyPatch) -> list[_FakeTuner]:
    """The searches that were begun; nothing is remembered."""
    created: list[_FakeTuner] = []
    monkeypatch.setattr(incremental, "FftTuner", type("FakeTuner", (_FakeTuner,), {"created": created}))
    monkeypatch.setattr(incremental, "remembered_strategy", lambda device, shape: "passes")
    return created


def _open(device: Device, system: System = SYSTEM, **settings: Any) -> IncrementalRenderer:
    renderer = IncrementalRenderer(system, random_drive(system), device, **settings)
    renderer.update()
    return renderer


def _cost(renderer: IncrementalRenderer) -> dict[str, int]:
    before = Counter(renderer.dispatch_counts)
    renderer.update()
    return dict(renderer.dispatch_counts - before)


def test_a_renderer_goes_on_by_the_faster_strategy_with_all_that_it_has(
    device: Device, tuners: list[_FakeTuner]
) -> None:
    renderer = _open(device)
    assert renderer.strategy == "passes" and not tuners
    assert not renderer.poll_strategy() and not renderer.poll_strategy()
    (tuner,) = tuners
    assert tuner.shape == (64, 128) and len(tuner.shaders) == len(KERNELS)
    tuner.end()
    shown = renderer.xyz()
    assert renderer.poll_strategy() and renderer.strategy == "workgroup" and tuner.is_closed
    assert _cost(renderer) == {}
    renderer.edit(plane_m=4e-3)
    cost = _cost(renderer)
    assert (cost["light"], cost["propagate"], cost["observe"]) == (2, 4, 2)  # spectra were in another order
    renderer.edit(plane_m=3e-3)
    assert "light" not in _cost(renderer)
    assert np.linalg.norm(renderer.xyz() - shown) <= AGREEMENT * np.linalg.norm(shown)
    assert not renderer.poll_strategy() and len(tuners) == 1


KERNELS = ("light", "propagate in place", "propagate elsewhere", "modulate", "observe")


def test_an_update_goes_on_when_the_strategy_changes(device: Device, tuners: list[_FakeTuner]) -> None:
    expected = _open(device, strategy="passes").xyz()
    renderer = IncrementalRenderer(SYSTEM, random_drive(SYSTEM), device)
    renderer.poll_strategy()
    tuners[0].end()
    steps = renderer.steps()
    next(steps)
    assert renderer.poll_strategy()
    assert len(list(steps)) == 3
    assert np.linalg.norm(renderer.xyz() - expected) <= AGREEMENT * np.linalg.norm(expected)


def test_kernels_that_are_not_compiled_yet_are_taken_from_passes_until_they_are(
    device: Device, tuners: list[_FakeTuner]
) -> None:
    renderer = _open(device)
    renderer.poll_strategy()
    tuners[0].end()
    renderer.poll_strategy()
    tilted = SYSTEM.edit({"source": {"directions": [[0.0, 0.01]]}})
    renderer.edit(system=tilted)
    assert renderer.strategy == "passes"
    assert not renderer.poll_strategy() and len(tuners) == 2
    renderer.edit(system=SYSTEM)
    assert renderer.strategy == "workgroup"
    renderer.edit(system=tilted)
    tuners[1].end()
    assert renderer.poll_strategy() and renderer.strategy == "workgroup"
    renderer.edit(system=SYSTEM)
    assert renderer.strategy == "workgroup" and len(tuners) == 2


def test_another_grid_begins_anew_and_ends_the_search_for_the_one_before(
    device: Device, tuners: list[_FakeTuner]
) -> None:
    renderer = _open(device)
    renderer.poll_strategy()
    renderer.edit(system=SYSTEM.edit({"upsample": 1}))
    assert tuners[0].is_closed and renderer.strategy == "passes"
    renderer.poll_strategy()
    assert tuners[1].shape == (32, 64)
    renderer.close()
    assert tuners[1].is_closed


def test_a_named_strategy_stays(device: Device, tuners: list[_FakeTuner]) -> None:
    renderer = _open(device, strategy="workgroup")
    assert not renderer.poll_strategy() and renderer.strategy == "workgroup" and not tuners


def test_what_is_remembered_to_compile_at_once_is_taken_from_the_start(
    device: Device, tuners: list[_FakeTuner], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(incremental, "remembered_strategy", lambda device, shape: "workgroup")
    renderer = _open(device)
    assert renderer.strategy == "workgroup"
    renderer.edit(system=SYSTEM.edit({"source": {"directions": [[0.0, 0.01]]}}))
    assert renderer.strategy == "workgroup"
