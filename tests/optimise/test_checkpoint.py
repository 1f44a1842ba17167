"""An optimisation continues from its checkpoint bit for bit, and refuses that of another optimisation."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.holograms.optimise.checkpoint import Checkpoint, IterationState, load_checkpoint, target_digest
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import iterate
from holoview.light.model.system import System
from holoview.util.errors import UserError

BRIEF = {"iterations": 9, "amplitudes_every": 4}
EVERYTHING = ("patterns", "amplitudes", "wavelengths")

# What is optimised, and after how many iterations it is stopped.
RUNS: dict[str, tuple[dict[str, Any], dict[str, Any], tuple[int, ...]]] = {
    "default": ({}, {}, (1, 4, 5, 9)),
    "encoded": ({}, {"loss": "srgb"}, (1, 5)),
    "wavelengths": ({}, {"free": EVERYTHING, "iterations": 12, "amplitudes_every": 2}, (1, 4, 6, 9)),
    "eyebox": ({}, {"eyebox": 0.05, "begin": "smooth"}, (2, 6)),
    "levels": ({"levels": 4}, {}, (3,)),
    "sources": ({"source": {"directions": [[0, 0], [0.01, -0.02]]}}, {"region": (2, 3, 20, 15)}, (3,)),
    "patterns only": ({}, {"free": ("patterns",), "plane_weights": (1.0, 2.0)}, (3,)),
}
CASES = [(name, stopped) for name, (_, _, stops) in RUNS.items() for stopped in stops]


def _system(**changes: Any) -> System:
    small = {"shape": [12, 16], "wavelengths": ["460 nm", "532 nm", "638 nm"], "amplitudes": "white"}
    near = {"gap": "0.4 mm", "planes": ["0.4 mm", "0.5 mm"]}
    return hv.load("holochrome-8").edit(small | near | changes)


def _stack(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((2, 24, 32, 3)).astype(np.float32)


@cache
def _uninterrupted(name: str) -> list[IterationState]:
    return _states(name)


def _states(name: str, resume: Checkpoint | None = None) -> list[IterationState]:
    bench, settings, _ = RUNS[name]
    return list(iterate(_system(**bench), _stack(), Settings(**(BRIEF | settings)), resume=resume))


def _stopped_after(iterations: int, name: str = "default") -> Checkpoint:
    bench, settings, _ = RUNS[name]
    states = iterate(_system(**bench), _stack(), Settings(**(BRIEF | settings)))
    for _ in range(iterations):
        state = next(states)
    return state.checkpoint()


def _figures(states: list[IterationState]) -> list[tuple[float, ...]]:
    return [(s.iteration, s.loss, s.psnr_db, s.best_psnr_db, s.eyebox) for s in states]


@pytest.mark.parametrize(("name", "stopped"), CASES)
def test_a_resumed_optimisation_goes_bit_for_bit_where_it_would_have(name: str, stopped: int, tmp_path: Path) -> None:
    _stopped_after(stopped, name).save(tmp_path / "c.safetensors")
    found, expected = _states(name, load_checkpoint(tmp_path / "c.safetensors")), _uninterrupted(name)
    assert _figures(found) == _figures(expected)[stopped:]
    for one, other in zip(found, expected[stopped:], strict=True):
        np.testing.assert_array_equal(one.best.drive, other.best.drive)
        assert one.best.system == other.best.system
    ends = [states[-1].checkpoint().tensors for states in (found, expected)]
    for tensor, value in ends[1].items():
        np.testing.assert_array_equal(ends[0][tensor], value, err_msg=tensor)


def test_wavelengths_have_moved_before_and_after_the_stop() -> None:
    """Else the cases above would not try what they are for."""
    known, early, late = (
        c["wavelengths"]
        for c in (
            {"wavelengths": _system().wavelengths_m},
            _stopped_after(4, "wavelengths").tensors,
            _uninterrupted("wavelengths")[-1].checkpoint().tensors,
        )
    )
    assert (early != known).all()
    assert (late != early).all()


def test_the_time_spent_before_counts() -> None:
    checkpoint = _stopped_after(3)
    state = next(iterate(_system(), _stack(), Settings(**BRIEF), resume=checkpoint))
    assert state.seconds > checkpoint.progress.seconds > 0
    assert state.iteration == 3


@pytest.mark.parametrize(
    ("begin", "named"),
    [
        (lambda c: iterate(_system(gap="0.5 mm"), _stack(), Settings(**BRIEF), resume=c), "gap differ"),
        (lambda c: iterate(_system(stroke="800 nm"), _stack(), Settings(**BRIEF), resume=c), "modulators differ"),
        (lambda c: iterate(_system(), _stack(1), Settings(**BRIEF), resume=c), "the target differ"),
    ],
    ids=["gap", "stroke", "target"],
)
def test_a_checkpoint_of_another_optimisation_is_refused_with_what_differs(
    begin: Callable[[Checkpoint], Any], named: str
) -> None:
    with pytest.raises(UserError, match=named):
        begin(_stopped_after(2))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("iterations", 8),
        ("step_rad", 0.25),
        ("betas", (0.1, 0.2)),
        ("amplitudes_every", 3),
        ("seed", 1),
        ("free", ("patterns",)),
        ("loss", "xyz"),
        ("region", (0, 0, 5, 5)),
        ("plane_weights", (1.0, 3.0)),
        ("eyebox", 0.1),
        ("begin", "smooth"),
        ("wavelength_range_m", (450e-9, 660e-9)),
        ("wavelength_spacing_m", 5e-9),
        ("wavelength_step_m", 1e-9),
    ],
)
def test_other_settings_are_refused_by_name(field: str, value: Any, tmp_path: Path) -> None:
    _stopped_after(1).save(tmp_path / "c.safetensors")
    known = load_checkpoint(tmp_path / "c.safetensors")
    assert known.settings == Settings(**BRIEF)
    with pytest.raises(UserError, match=f"is of another optimisation: {field} differ"):
        iterate(_system(), _stack(), Settings(**(BRIEF | {field: value})), resume=known)


def test_a_checkpoint_that_fails_to_be_written_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.safetensors"
    _stopped_after(2).save(path)
    before = path.read_bytes()

    def full(handle: int, data: bytes, is_durable: bool) -> None:
        os.write(handle, bytes(data[:4]))
        os.close(handle)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("holoview.util.file_writer._write", full)
    with pytest.raises(UserError, match="No space left"):
        _stopped_after(4).save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("content", [b"", b"no checkpoint at all", None], ids=["empty", "text", "a hologram"])
def test_what_is_no_checkpoint_is_refused(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "c.safetensors"
    if content is None:
        system = _system()
        hv.Hologram(hv.random_drive(system), system).save(path)
    else:
        path.write_bytes(content)
    with pytest.raises(UserError, match=r"c\.safetensors: .*expected a checkpoint"):
        load_checkpoint(path)


def test_a_truncated_checkpoint_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.safetensors"
    _stopped_after(1).save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(UserError, match="can't be read"):
        load_checkpoint(path)


def test_a_missing_checkpoint_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"nowhere\.safetensors: no such file"):
        load_checkpoint(tmp_path / "nowhere.safetensors")


def test_the_digest_knows_values_and_shape() -> None:
    stack = _stack()
    assert target_digest(stack) == target_digest(stack.astype(np.float64))
    assert (
        len(
            {
                target_digest(stack),
                target_digest(stack[:1]),
                target_digest(stack.reshape(2, 32, 24, 3)),
                target_digest(stack + 1),
            }
        )
        == 4
    )
