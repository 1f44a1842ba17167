"""A program that ends waits for its own threads in the background, for a while."""

from __future__ import annotations

import gc
import multiprocessing
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from holoview.util.processes import (
    PREFIX,
    end_with_parent,
    garbage_kept,
    lock_passed_on,
    process_start,
    wait_for_threads,
)
from tests.patience import PATIENCE_S


def test_own_threads_are_waited_for_and_others_are_not() -> None:
    go, end = threading.Event(), threading.Event()
    own = threading.Thread(target=go.wait, name="of this test: own", daemon=True)
    other = threading.Thread(target=end.wait, name="another", daemon=True)
    own.start()
    other.start()
    assert not wait_for_threads(0.0, "of this test"), "it is still at work"
    threading.Timer(0.05, go.set).start()
    assert wait_for_threads(30.0, "of this test") and not own.is_alive() and other.is_alive()
    end.set()


def test_the_watch_on_the_parent_isn_t_work_to_wait_for(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = multiprocessing.Pipe(duplex=False)
    ended = threading.Event()
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: SimpleNamespace(sentinel=reading))
    monkeypatch.setattr(os, "_exit", lambda code: ended.set())
    before = set(threading.enumerate())
    end_with_parent()
    (watch,) = set(threading.enumerate()) - before
    assert not watch.name.startswith(PREFIX)
    writing.close()
    assert ended.wait(PATIENCE_S)


def test_a_process_keeps_its_start_and_another_has_its_own() -> None:
    own = process_start(os.getpid())
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        assert process_start(child.pid) != own == process_start(os.getpid())
    with pytest.raises(psutil.Error):
        process_start(child.pid)


def test_the_name_of_a_program_may_hold_anything(tmp_path: Path) -> None:
    (tmp_path / "sys" / "kernel" / "random").mkdir(parents=True)
    (tmp_path / "sys" / "kernel" / "random" / "boot_id").write_text("b00t\n", encoding="ascii")
    (tmp_path / "7").mkdir()
    fields = " ".join(str(n) for n in range(3, 53))  # of proc(5), by their numbers; starttime is 22
    (tmp_path / "7" / "stat").write_text(f"7 (a) S 1 (b c) {fields}\n", encoding="ascii")
    assert process_start(7, tmp_path) == "22 ticks of b00t"


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system notes the clock's time")
def test_the_clock_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    own = process_start(os.getpid())
    monkeypatch.setattr(psutil.Process, "create_time", lambda self: 0.0)
    assert process_start(os.getpid()) == own


def test_the_lock_is_held_as_long_as_before_once_all_blocks_have_ended_in_any_order() -> None:
    before = sys.getswitchinterval()
    one, other = lock_passed_on(), lock_passed_on()
    for block in (one, other):
        block.__enter__()
        assert sys.getswitchinterval() < before
    one.__exit__(None, None, None)
    assert sys.getswitchinterval() < before
    other.__exit__(None, None, None)
    assert sys.getswitchinterval() == before


def test_garbage_is_collected_again_afterwards_whatever_happens_if_it_was_before() -> None:
    with pytest.raises(ValueError, match="within"), garbage_kept():
        assert not gc.isenabled()
        raise ValueError("within")
    assert gc.isenabled()
    with garbage_kept():
        with garbage_kept():
            pass
        assert not gc.isenabled()
