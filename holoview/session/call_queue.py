"""Calls that any thread hands to the one that owns a session."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue

Call = Callable[[], None]


class CallQueue:
    """Calls in the order in which they came."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[Call] = SimpleQueue()

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits to be called."""
        return self._waiting.empty()

    def put(self, call: Call) -> None:
        """From any thread."""
        self._waiting.put(call)

    def drain(self) -> Iterator[Call]:
        """The calls that wait, and those that come meanwhile."""
        while True:
            try:
                yield self._waiting.get_nowait()
            except Empty:
                return
