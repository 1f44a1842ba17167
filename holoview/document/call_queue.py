"""A queue of calls from any thread to the thread that owns a session."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue

Call = Callable[[], None]


class CallQueue:
    """A thread-safe queue of calls without arguments, in the order of `put`."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[Call] = SimpleQueue()

    @property
    def is_empty(self) -> bool:
        """Whether no call waits."""
        return self._waiting.empty()

    def put(self, call: Call) -> None:
        """Adds a call. May be called on any thread."""
        self._waiting.put(call)

    def drain(self) -> Iterator[Call]:
        """Takes the waiting calls, and those that are added meanwhile, for the owner to make."""
        while True:
            try:
                yield self._waiting.get_nowait()
            except Empty:
                return
