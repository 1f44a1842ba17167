"""A program that ends waits for its own threads in the background, for a while."""

from __future__ import annotations

import multiprocessing
import os
import threading
from types import SimpleNamespace

import pytest

from holoview.util.processes import PREFIX, end_with_parent, wait_for_threads


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
    assert ended.wait(60)
