"""The end of a program whose threads may still be at work."""

from __future__ import annotations

import threading
import time

PREFIX = "holoview: "
"""Names of threads that this program starts for work in the background begin with it."""


def wait_for_threads(timeout_s: float, prefix: str = PREFIX) -> bool:
    """Waits until the daemon threads whose names begin so have ended; returns whether they have.

    A program that ends while one of them is inside a library written in C++ is aborted: the interpreter ends the thread
    where that library doesn't expect it.
    """
    until = time.monotonic() + timeout_s
    threads = [t for t in threading.enumerate() if t.daemon and t.name.startswith(prefix)]
    for thread in threads:
        thread.join(max(until - time.monotonic(), 0.0))
    return not any(thread.is_alive() for thread in threads)
