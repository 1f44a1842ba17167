"""A reader that crashes, doesn't end or takes too much ends in a sentence, and this process goes on."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import psutil
import pytest

from holoview.util import reader_process
from holoview.util.errors import UserError
from holoview.util.reader_process import CAN_FORK, call_in_child, in_child
from tests.patience import PATIENCE_S

needs_fork = pytest.mark.skipif(not CAN_FORK, reason="readers run in this process here")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "f").write_bytes(bytes(10))
    return tmp_path / "f"


def test_the_result_is_that_of_the_work(path: Path) -> None:
    values = np.arange(300_000.0).reshape(3, -1)
    read, words = call_in_child("f", path, lambda: (values.T, {"a": None}))
    assert np.array_equal(read, values.T)
    assert words == {"a": None}
    assert read.flags.writeable


def test_requests_are_answered_one_after_the_other_by_one_child(path: Path) -> None:
    @contextmanager
    def serve() -> Iterator[Callable[[Any], Any]]:
        asked: list[int] = []

        def answer(number: int) -> tuple[list[int], int]:
            asked.append(number)
            return asked, os.getpid()

        yield answer

    with in_child("f", path, serve) as ask:
        answers = [ask(number) for number in (3, 1, 4)]
    assert [numbers for numbers, _ in answers] == [[3], [3, 1], [3, 1, 4]]
    assert len({pid for _, pid in answers}) == 1
    assert (answers[0][1] != os.getpid()) == CAN_FORK


@pytest.mark.parametrize("error", [UserError("a", "is wrong", remedy="mend it"), KeyError("x"), MemoryError()])
def test_errors_are_raised_here(path: Path, error: Exception) -> None:
    def work() -> None:
        raise error

    with pytest.raises(type(error)) as caught:
        call_in_child("f", path, work)
    assert str(caught.value) == str(error)


@needs_fork
@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT])
def test_a_crash_is_a_sentence(path: Path, number: signal.Signals) -> None:
    with pytest.raises(UserError, match=rf"^f: is damaged: it crashed the library that reads it \({number.name}\)"):
        call_in_child("f", path, lambda: os.kill(os.getpid(), number))


@needs_fork
class Unrestorable(Exception):
    """As those of decoders: it takes more arguments than its pickle holds."""

    def __init__(self, function: str, code: int) -> None:
        super().__init__(f"{function} returned {code}")


def test_an_error_is_sent_without_its_cause(path: Path) -> None:
    """Dask's workers pickle an error with its cause, from when on they are loaded."""
    support = pytest.importorskip("tblib.pickling_support")

    def work() -> None:
        try:
            raise Unrestorable("decode", 7)
        except Unrestorable as error:
            wrong = UserError("a.tif", "is damaged")
            support.install(wrong)
            raise wrong from error

    with pytest.raises(UserError, match="is damaged"):
        call_in_child(str(path), path, work)


def test_a_real_crash_is_a_sentence(path: Path) -> None:
    with pytest.raises(UserError, match="SIGSEGV"):
        call_in_child("f", path, lambda: ctypes.string_at(0))


@pytest.mark.long
@needs_fork
def test_work_without_end_is_a_sentence(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader_process, "_CPU_S", 0.1)
    monkeypatch.setattr(reader_process, "_WALL_FACTOR", 10 * PATIENCE_S)

    def for_ever() -> None:
        while True:
            pass

    with pytest.raises(UserError, match="takes too long to read"):
        call_in_child("f", path, for_ever)


class _WaitsForALock:
    """Garbage whose end waits for a lock, as those of a device's buffers do."""

    def __init__(self, lock: Lock) -> None:
        self.lock, self.itself = lock, self

    def __del__(self) -> None:
        with self.lock:
            pass


@needs_fork
def test_what_the_parent_left_isnt_collected_in_the_child(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader_process, "_WALL_FACTOR", PATIENCE_S / 100)
    lock = Lock()
    gc.disable()
    try:
        _WaitsForALock(lock)
        with lock:  # as another thread that holds it at the moment of the fork: nobody gives it back in the child
            assert call_in_child("f", path, lambda: gc.collect() >= 0)
    finally:
        gc.enable()
    gc.collect()


@needs_fork
def test_a_reader_that_stands_still_doesnt_call_the_file_damaged(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader_process, "_WALL_FACTOR", 0.01)
    with pytest.raises(UserError, match=r"f: couldn't be read: its reader gave no answer for 0 s; try again") as found:
        call_in_child("f", path, lambda: time.sleep(PATIENCE_S))
    assert "damaged" not in str(found.value)


@needs_fork
def test_memory_is_bounded_and_no_child_stays(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOLOVIEW_MEMORY", "8GB")
    with pytest.raises(MemoryError):
        call_in_child("f", path, lambda: bytes(64 << 30))
    before = len([*Path("/proc/self/fd").iterdir()])
    for _ in range(3):
        call_in_child("f", path, lambda: None)
    assert len([*Path("/proc/self/fd").iterdir()]) == before
    assert not [child for child in psutil.Process().children() if child.status() == psutil.STATUS_ZOMBIE]


@needs_fork
def test_without_a_place_for_a_child_the_work_is_done_here(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_place() -> int:
        raise BlockingIOError

    monkeypatch.setattr(os, "fork", no_place)
    assert call_in_child("f", path, os.getpid) == os.getpid()


@needs_fork
def test_a_child_doesnt_start_another_one(path: Path) -> None:
    outer, inner = call_in_child("f", path, lambda: (os.getpid(), call_in_child("f", path, os.getpid)))
    assert outer == inner
