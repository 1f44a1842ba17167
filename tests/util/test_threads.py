"""A program that ends waits for its own threads in the background, for a while."""

from __future__ import annotations

import threading

from holoview.util.threads import wait_for_threads


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
