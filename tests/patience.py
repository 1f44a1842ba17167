"""How long a test waits for an event: it goes on at once when the event comes, however busy the machine is."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 600.0
"""Seconds after which an event is taken never to come. An idle machine needs a hundredth of them; beside nine other
programs on its cores, a program that a test starts takes a minute to import its libraries."""


def wait_until(
    is_so: Callable[[], object], meanwhile: Callable[[], object] = lambda: None, pause_s: float = 0.1
) -> None:
    """Calls `meanwhile` again and again until something is so; the test fails where it doesn't come about."""
    until = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < until, "it didn't come about in time"
        meanwhile()
        time.sleep(pause_s)
