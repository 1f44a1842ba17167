"""An optimisation goes on from a checkpoint as if nothing had happened, and from no other one's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import holoview as hv
from holoview.errors import UserError
from holoview.optimise.checkpoint import Checkpoint, digest, load_checkpoint
from holoview.optimise.settings import Settings
from holoview.optimise.solve import State, iterate
from holoview.system import System

SETTINGS = Settings(iterations=9, amplitudes_every=4)


def _system(**changes: Any) -> System:
    small = {"shape": [12, 16], "wavelengths": ["460 nm", "532 nm", "638 nm"], "amplitudes": "white"}
    near = {"gap": "0.4 mm", "planes": ["0.4 mm", "0.5 mm"]}
    return hv.load("holochrome-8").edit(small | near | changes)


def _stack(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((2, 24, 32, 3)).astype(np.float32)


def _stopped_after(iterations: int) -> Checkpoint:
    states = iterate(_system(), _stack(), SETTINGS)
    for _ in range(iterations):
        state = next(states)
    return state.checkpoint()


def _last(resume: Checkpoint | None = None) -> State:
    *_, state = iterate(_system(), _stack(), SETTINGS, resume=resume)
    return state


@pytest.mark.parametrize("iterations", [1, 4, 5, 9])
def test_a_resumed_optimisation_ends_bit_for_bit_where_it_would_have(iterations: int, tmp_path: Path) -> None:
    _stopped_after(iterations).save(tmp_path / "c.safetensors")
    found, expected = _last(load_checkpoint(tmp_path / "c.safetensors")), _last()
    np.testing.assert_array_equal(found.best.drive, expected.best.drive)
    assert found.best.system == expected.best.system
    assert (found.loss, found.psnr_db, found.best_psnr_db) == (expected.loss, expected.psnr_db, expected.best_psnr_db)


def test_the_time_spent_before_counts() -> None:
    checkpoint = _stopped_after(3)
    state = next(iterate(_system(), _stack(), SETTINGS, resume=checkpoint))
    assert state.seconds > checkpoint.progress.seconds > 0
    assert state.iteration == 3


@pytest.mark.parametrize(
    ("begin", "named"),
    [
        (lambda c: iterate(_system(gap="0.5 mm"), _stack(), SETTINGS, resume=c), "gap differ"),
        (lambda c: iterate(_system(stroke="800 nm"), _stack(), SETTINGS, resume=c), "modulators differ"),
        (lambda c: iterate(_system(), _stack(1), SETTINGS, resume=c), "the target differ"),
        (
            lambda c: iterate(_system(), _stack(), Settings(iterations=8), resume=c),
            "iterations, amplitudes_every differ",
        ),
    ],
    ids=["gap", "stroke", "target", "settings"],
)
def test_a_checkpoint_of_another_optimisation_is_refused_with_what_differs(
    begin: Callable[[Checkpoint], Any], named: str
) -> None:
    with pytest.raises(UserError, match=named):
        begin(_stopped_after(2))


def test_a_checkpoint_that_fails_to_be_written_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.safetensors"
    _stopped_after(2).save(path)
    before = path.read_bytes()

    def full(tensors: dict[str, np.ndarray], file: Path, metadata: dict[str, str]) -> None:
        Path(file).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("holoview.tensors.save_file", full)
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
    assert digest(stack) == digest(stack.astype(np.float64))
    assert len({digest(stack), digest(stack[:1]), digest(stack.reshape(2, 32, 24, 3)), digest(stack + 1)}) == 4
