"""Recorded iterations are the same as those that are launched one by one: on a card, and with recordings replayed
here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

import holoview as hv
from holoview.holograms.optimise import solve
from holoview.holograms.optimise.problem import Problem
from holoview.holograms.optimise.solve import GraphedStep
from holoview.holograms.optimise.variables import PatternVariables
from holoview.light.model.system import System
from tests.second_device import SecondDevice, small_bench

pytestmark = pytest.mark.usefixtures("kernels_of_a_card")

SETTINGS: dict[str, dict[str, Any]] = {
    "patterns": {"free": ("patterns",)},
    "patterns and amplitudes": {},
    "planes in turn": {"drawn_planes": 1},
    "sRGB": {"loss": "srgb", "free": ("patterns",)},
    "region": {"region": (4, 4, 20, 20), "plane_weights": (1.0, 2.0)},
}
BENCHES: dict[str, dict[str, Any]] = {
    "plain": {},
    "two sources": {"source": {"directions": [[0.0, 0.0], [0.01, -0.02]]}},
    "two frames": {"amplitudes": [[2.0, 0.0, 1.0], [0.0, 4.0, 1.0]]},
    "stops": {"relay1.iris_na": 0.03, "relay2.iris_na": 0.02},
    "one modulator": {"modulators": [{"pitch": "8 um", "shape": [12, 16], "stroke": "825 nm"}], "gap": None},
}
PAIRS = [("plain", name) for name in SETTINGS] + [
    (name, "patterns and amplitudes") for name in BENCHES if name != "plain"
]
OTHERS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "levels": ({"levels": [i / 15 for i in range(16)]}, {}),
    "eyebox": ({}, {"eyebox": 0.01}),
    "amplitudes": ({}, {"free": ("amplitudes",)}),
    "wavelengths": ({}, {"free": ("patterns", "wavelengths")}),
    "structure": ({}, {"loss": "ms-ssim", "free": ("patterns",)}),
    "crosstalk": ({"effects.crosstalk.sigma": 0.3}, {"free": ("patterns",)}),
}
"""Changes of the bench and settings of optimisations whose iterations need the processor."""


class Recording(TorchDispatchMode):
    """Repeats operations on the memory that they had, as a CUDA graph does; no number may reach the program meanwhile.

    A mode for a `with` block, in which the operations run once; `replay` runs them again.
    """

    def __init__(self) -> None:
        super().__init__()
        self._calls: list[tuple[Any, Any, Any, Any]] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Run an operation and keep it."""
        assert func is not torch.ops.aten._local_scalar_dense.default, "a number of the device is read"
        out = func(*args, **(kwargs or {}))
        self._calls.append((func, args, kwargs or {}, out))
        return out

    def replay(self) -> None:
        """Run the kept operations in their order; results go where those of the recording are."""
        with torch._C.DisableTorchFunction():
            for func, args, kwargs, out in self._calls:
                again = func(*args, **kwargs)
                for there, new in zip(tree_leaves(out), tree_leaves(again), strict=True):
                    if isinstance(there, torch.Tensor) and there.data_ptr() != new.data_ptr():
                        there.copy_(new)


class Recorder:
    """Stands in for `CudaRecorder`. count: of recordings."""

    def __init__(self, memories: SecondDevice, kept: list[torch.Tensor]) -> None:
        self.count, self._memories, self._kept = 0, memories, kept

    def __call__(self, function: Callable[[], None]) -> Callable[[], None]:
        """Record a function; what it changes in the optimiser's variables meanwhile is undone."""
        before, moves = [tensor.clone() for tensor in self._kept], self._memories.moves
        with Recording() as recording:
            function()
        assert self._memories.moves == moves, "memory of the processor is copied while the card records"
        for tensor, value in zip(self._kept, before, strict=True):
            tensor.copy_(value)
        self.count += 1
        return recording.replay


@pytest.fixture
def one_thread() -> Any:
    """Operations in the thread that records, by the kernels that a card has."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _states(system: System, device: str, record: bool, **settings: Any) -> list[tuple[float, Any]]:
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)
    stack = np.random.default_rng(0).random((len(system.planes_m), rows, columns, 3), dtype=np.float32)
    chosen = hv.Settings(iterations=8, **{"amplitudes_every": 4, **settings})
    states = list(hv.iterate(system, stack, chosen, device=device, record=record))
    return [(state.loss, state.best.drive) for state in states]


@pytest.fixture
def recorders(monkeypatch: pytest.MonkeyPatch, one_thread: None) -> list[Recorder]:
    """The recorders of all optimisations that begin from now on, in place of a card's."""
    made: list[Recorder] = []

    def graphed(problem: Problem, patterns: PatternVariables, memories: SecondDevice) -> GraphedStep:
        moments = [patterns.adam.first_moment, patterns.adam.second_moment]
        made.append(Recorder(memories, [patterns.drive, *moments]))
        return GraphedStep(problem, patterns, made[-1])

    monkeypatch.setattr(solve, "GraphedStep", graphed)
    return made


@pytest.fixture
def memories(monkeypatch: pytest.MonkeyPatch) -> SecondDevice:
    """A card that isn't there, which can record."""
    mode = SecondDevice()
    monkeypatch.setattr(solve, "recorder_for", lambda device: mode if device == "cuda" else None)
    return mode


def _are_equal(found: list[tuple[float, Any]], expected: list[tuple[float, Any]]) -> bool:
    return all(a == b and np.array_equal(c, d) for (a, c), (b, d) in zip(found, expected, strict=True))


@pytest.mark.parametrize(("bench", "settings"), PAIRS)
def test_repeated_recordings_are_iterations(
    bench: str, settings: str, recorders: list[Recorder], memories: SecondDevice
) -> None:
    system, chosen = small_bench(**BENCHES[bench]), SETTINGS[settings]
    expected = _states(system, "cpu", True, **chosen)
    with memories:
        assert _are_equal(_states(system, "cuda", True, **chosen), expected)
    assert [recorder.count for recorder in recorders] == [3 if "drawn_planes" in chosen else 1]


@pytest.mark.parametrize("name", OTHERS)
def test_iterations_that_need_the_processor_are_not_recorded(
    name: str, recorders: list[Recorder], memories: SecondDevice
) -> None:
    changes, settings = OTHERS[name]
    system = small_bench(**changes)
    expected = _states(system, "cpu", True, **settings)
    with memories:
        assert _are_equal(_states(system, "cuda", True, **settings), expected)
    assert sum(recorder.count for recorder in recorders) == 0


def test_drawn_pupils_keep_the_recording(recorders: list[Recorder], memories: SecondDevice) -> None:
    """Their targets and stops change in the same memory."""
    system = small_bench(eye={"pupil": "2 mm"})
    rows, columns = (n * system.sampling.upsample for n in system.modulators[0].shape)

    def stacks(places_m: Any) -> np.ndarray:
        light = np.random.default_rng([int(1e9 * abs(y)) for y, _ in places_m])
        return light.random((2 * len(places_m), rows, columns, 3), dtype=np.float32)

    chosen = hv.Settings(iterations=6, amplitudes_every=3, drawn_pupils=2, drawn_radius_m=5e-4)
    expected = [state.loss for state in hv.iterate(system, stacks, chosen)]
    with memories:
        found = [state.loss for state in hv.iterate(system, stacks, chosen, device="cuda")]
    assert found == expected and recorders[0].count == 1


def test_a_recording_that_fails_is_said_and_launched_instead(
    monkeypatch: pytest.MonkeyPatch, memories: SecondDevice
) -> None:
    def fails(function: Callable[[], None]) -> Callable[[], None]:
        raise RuntimeError("operation not permitted when stream is capturing\nmore lines")

    monkeypatch.setattr(solve, "recorder_for", lambda device: fails if device == "cuda" else None)
    expected = _states(small_bench(), "cpu", True)
    with (
        memories,
        pytest.warns(RuntimeWarning, match="aren't recorded as CUDA graphs: operation not permitted") as said,
    ):
        assert _are_equal(_states(small_bench(), "cuda", True), expected)
    assert len(said) == 1


@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch has no CUDA device here")
@pytest.mark.parametrize("bench", BENCHES)
@pytest.mark.parametrize("settings", SETTINGS)
def test_on_a_card_both_ways_agree(bench: str, settings: str) -> None:
    """Adam divides by a number of the device in one and of the program in the other, which may round differently.

    The step of a pixel with a small gradient depends on rounding: only losses are compared, whose relative differences
    stay below 1e-4 over 8 steps (1e-7 of the amplitudes of 768 pixels or more, magnified at most a hundredfold).
    """
    system, chosen = small_bench(**BENCHES[bench]), SETTINGS[settings]
    launched, recorded = (_states(system, "cuda", record, **chosen) for record in (False, True))
    assert [loss for loss, _ in recorded] == pytest.approx([loss for loss, _ in launched], rel=1e-4)
