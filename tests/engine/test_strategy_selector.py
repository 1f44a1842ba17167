"""A session starts on what is ready and becomes faster while it is in use; what it has computed stays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from holoview.engine import strategy_selector as pace
from holoview.engine.incremental import IncrementalRenderer
from holoview.gpu.device import Device
from holoview.gpu.line_fft import Strategy, TransformShader
from holoview.model.bench_parts import Modulator
from holoview.model.system import System
from holoview.view import random_drive

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


class _Choice:
    """A search that ends with `found` when it is told to."""

    made: list[_Choice]
    found: Strategy = "workgroup"

    def __init__(
        self, device: Device, shape: tuple[int, int], shaders: Callable[[Strategy], Iterable[TransformShader]]
    ) -> None:
        self.shape, self.shaders = shape, list(shaders(self.found))
        self.current: Strategy = "passes"
        self.is_settled = self.is_closed = False
        self.made.append(self)

    def poll(self) -> bool:
        return False

    def end(self) -> None:
        self.current, self.is_settled = self.found, True

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def choices(monkeypatch: pytest.MonkeyPatch) -> list[_Choice]:
    """The searches that were begun; nothing is remembered."""
    made: list[_Choice] = []
    monkeypatch.setattr(pace, "FftTuner", type("Choice", (_Choice,), {"made": made}))
    monkeypatch.setattr(pace, "remembered_strategy", lambda device, shape: "passes")
    return made


def _open(device: Device, system: System = SYSTEM, **settings: Any) -> IncrementalRenderer:
    session = IncrementalRenderer(system, random_drive(system), device, **settings)
    session.update()
    return session


def _cost(session: IncrementalRenderer) -> dict[str, int]:
    before = Counter(session.dispatch_counts)
    session.update()
    return dict(session.dispatch_counts - before)


def test_a_session_goes_on_by_the_faster_strategy_with_all_that_it_has(device: Device, choices: list[_Choice]) -> None:
    session = _open(device)
    assert session.strategy == "passes" and not choices
    assert not session.poll_strategy() and not session.poll_strategy()
    (search,) = choices
    assert search.shape == (64, 128) and len(search.shaders) == len(KERNELS)
    search.end()
    shown = session.xyz()
    assert session.poll_strategy() and session.strategy == "workgroup" and search.is_closed
    assert _cost(session) == {}
    session.edit(plane_m=4e-3)
    cost = _cost(session)
    assert (cost["light"], cost["propagate"], cost["observe"]) == (2, 4, 2)  # spectra were in another order
    session.edit(plane_m=3e-3)
    assert "light" not in _cost(session)
    assert np.linalg.norm(session.xyz() - shown) <= AGREEMENT * np.linalg.norm(shown)
    assert not session.poll_strategy() and len(choices) == 1


KERNELS = ("light", "propagate in place", "propagate elsewhere", "modulate", "observe")


def test_an_update_goes_on_when_the_strategy_changes(device: Device, choices: list[_Choice]) -> None:
    expected = _open(device, strategy="passes").xyz()
    session = IncrementalRenderer(SYSTEM, random_drive(SYSTEM), device)
    session.poll_strategy()
    choices[0].end()
    steps = session.steps()
    next(steps)
    assert session.poll_strategy()
    assert len(list(steps)) == 3
    assert np.linalg.norm(session.xyz() - expected) <= AGREEMENT * np.linalg.norm(expected)


def test_kernels_that_are_not_compiled_yet_are_taken_from_passes_until_they_are(
    device: Device, choices: list[_Choice]
) -> None:
    session = _open(device)
    session.poll_strategy()
    choices[0].end()
    session.poll_strategy()
    tilted = SYSTEM.edit({"source": {"directions": [[0.0, 0.01]]}})
    session.edit(system=tilted)
    assert session.strategy == "passes"
    assert not session.poll_strategy() and len(choices) == 2
    session.edit(system=SYSTEM)
    assert session.strategy == "workgroup"
    session.edit(system=tilted)
    choices[1].end()
    assert session.poll_strategy() and session.strategy == "workgroup"
    session.edit(system=SYSTEM)
    assert session.strategy == "workgroup" and len(choices) == 2


def test_another_grid_begins_anew_and_ends_the_search_for_the_one_before(
    device: Device, choices: list[_Choice]
) -> None:
    session = _open(device)
    session.poll_strategy()
    session.edit(system=SYSTEM.edit({"upsample": 1}))
    assert choices[0].is_closed and session.strategy == "passes"
    session.poll_strategy()
    assert choices[1].shape == (32, 64)
    session.close()
    assert choices[1].is_closed


def test_a_named_strategy_stays(device: Device, choices: list[_Choice]) -> None:
    session = _open(device, strategy="workgroup")
    assert not session.poll_strategy() and session.strategy == "workgroup" and not choices


def test_what_is_remembered_to_compile_at_once_is_taken_from_the_start(
    device: Device, choices: list[_Choice], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pace, "remembered_strategy", lambda device, shape: "workgroup")
    session = _open(device)
    assert session.strategy == "workgroup"
    session.edit(system=SYSTEM.edit({"source": {"directions": [[0.0, 0.01]]}}))
    assert session.strategy == "workgroup"
