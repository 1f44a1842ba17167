"""Work of which only the newest request counts: what waits is dropped when another one comes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from threading import Condition, Thread
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestTask(Generic[T]):
    """A thread that does what was asked for last, and hands the result or the exception to the owner.

    name: of the thread. deliver: has the owner make a call. failed: told, by the owner, what went wrong.
    """

    def __init__(
        self, name: str, deliver: Callable[[Callable[[], None]], None], on_error: Callable[[BaseException], None]
    ) -> None:
        self._name, self._deliver, self._failed = name, deliver, on_error
        self._condition, self._closed = Condition(), False
        self._waiting: tuple[Callable[[], T], Callable[[T], None]] | None = None
        self._busy = False
        self._thread: Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a request is being worked on or waits."""
        return self._busy or self._waiting is not None

    def submit(self, work: Callable[[], T], on_result: Callable[[T], None]) -> None:
        """Has `work` done on the thread and its result given to `take` by the owner."""
        with self._condition:
            self._waiting = (work, on_result)
            self._condition.notify()
        if self._thread is None:
            self._thread = Thread(target=self._run, name=f"holoview: {self._name}", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Ends the thread once it has done what it is at."""
        with self._condition:
            self._closed = True
            self._condition.notify()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closed or self._waiting is not None)
                if self._closed or self._waiting is None:
                    return
                (work, take), self._waiting, self._busy = self._waiting, None, True
            try:
                call = partial(take, work())
            except Exception as error:  # whatever it is, the owner is told
                call = partial(self._failed, error)
            self._deliver(call)
            self._busy = False
