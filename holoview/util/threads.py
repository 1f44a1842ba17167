"""The end of a program whose threads may still be at work."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
import time
from contextlib import suppress
from typing import NoReturn

_AT_THE_END_S, _BEFORE_LEAVING_S = 10.0, 1.0
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


def is_left() -> bool:
    """Whether this process ends by `leave`: one that another process supervises."""
    return multiprocessing.parent_process() is not None


def last_work_s() -> float:
    """Seconds that work which was cancelled has to end before this process does."""
    return _BEFORE_LEAVING_S if is_left() else _AT_THE_END_S


def leave(code: int) -> NoReturn:
    """Ends this process at once with an exit code, whatever its threads do; call it when all is saved and closed.

    The usual end of Python waits for the threads of pools until these have done all that they were given, and collects
    every object: seconds, and more on a busy machine, for memory that the system takes back in any case.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()
    os._exit(code)
