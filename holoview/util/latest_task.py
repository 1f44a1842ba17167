"""A worker thread that runs only the latest request: one that still waits is dropped when another one comes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from threading import Condition, Thread
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestTask(Generic[T]):
    """Runs the request that was submitted last and delivers its result, or its exception, to the owner.

    name: of the thread. deliver: has the owner make a call. on_error: called by the owner with the exception.
    """

    def __init__(
        self, name: str, deliver: Callable[[Callable[[], None]], None], on_error: Callable[[BaseException], None]
    ) -> None:
        self._name, self._deliver, self._on_error = name, deliver, on_error
        self._condition, self._closed = Condition(), False
        self._request: tuple[Callable[[], T], Callable[[T], None]] | None = None
        self._untaken = 0  # requests that were begun and whose results the owner hasn't got
        self._thread: Thread | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a request waits or is being run, or its result waits for the owner."""
        with self._condition:
            return self._untaken > 0 or self._request is not None

    def submit(self, work: Callable[[], T], on_result: Callable[[T], None]) -> None:
        """Runs `work` on the thread; the owner then calls `on_result` with what it returned."""
        with self._condition:
            self._request = (work, on_result)
            self._condition.notify()
        if self._thread is None:
            self._thread = Thread(target=self._run, name=f"holoview: {self._name}", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Ends the thread after the request that it is running."""
        with self._condition:
            self._closed = True
            self._condition.notify()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closed or self._request is not None)
                if self._closed or self._request is None:
                    return
                (work, on_result), self._request = self._request, None
                self._untaken += 1
            try:
                call = partial(on_result, work())
            except Exception as error:  # any exception is reported to the owner, as nobody waits for this thread
                call = partial(self._on_error, error)
            self._deliver(partial(self._hand_over, call))

    def _hand_over(self, call: Callable[[], None]) -> None:
        """Called by the owner: makes the call of a request that has been run."""
        with self._condition:
            self._untaken -= 1
        call()
