"""The thread that makes all calls of a rig's devices, one after the other; nobody waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from threading import Condition, Thread
from typing import Any

Deliver = Callable[[Callable[[], None]], None]
"""Has the owner's thread make a call."""


@dataclass(frozen=True)
class _Call:
    """A call that waits. number: rises from call to call. due_s: earliest begin, on `time.monotonic`."""

    key: str
    number: int
    due_s: float
    work: Callable[[], Any]
    on_result: Callable[[Any], None]
    on_error: Callable[[BaseException], None]


class DeviceWorker:
    """Makes calls in their order; one that still waits is replaced by a later one of the same key.

    deliver: results and exceptions go to the owner by it. on_begin: called on the thread with the number of each call
    before it is made.
    """

    def __init__(self, deliver: Deliver, on_begin: Callable[[int], None]) -> None:
        self._deliver, self._on_begin = deliver, on_begin
        self._condition, self._waiting = Condition(), list[_Call]()
        self._count, self._is_abandoned = 0, False
        self._thread = Thread(target=self._run, name="holoview: devices", daemon=True)
        self._thread.start()

    def submit(
        self,
        work: Callable[[], Any],
        on_result: Callable[[Any], None],
        on_error: Callable[[BaseException], None],
        *,
        key: str,
        delay_s: float = 0.0,
    ) -> None:
        """Has the thread make the call `work`, and the owner one of the other two. delay_s: the least until then."""
        with self._condition:
            self._count += 1
            call = _Call(key, self._count, time.monotonic() + delay_s, work, on_result, on_error)
            self._waiting = [*(other for other in self._waiting if other.key != key), call]
            self._condition.notify()

    @property
    def count(self) -> int:
        """The number of the last call that was submitted."""
        return self._count

    def forget_waiting(self) -> None:
        """Drops the calls that haven't begun."""
        with self._condition:
            self._waiting = []

    def abandon(self) -> None:
        """Makes no further call, and delivers nothing more; the one that is being made goes on."""
        with self._condition:
            self._is_abandoned, self._waiting = True, []
            self._condition.notify()

    @property
    def is_abandoned(self) -> bool:
        """Whether it was abandoned."""
        return self._is_abandoned

    def join(self, timeout_s: float) -> bool:
        """Waits until the thread of an abandoned worker has ended; returns whether it has."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (call := self._next()) is not None:
            self._on_begin(call.number)
            try:
                result = call.work()
            except BaseException as error:  # nobody else hears of it
                self._hand_over(partial(call.on_error, error))
            else:
                self._hand_over(partial(call.on_result, result))

    def _next(self) -> _Call | None:
        """The first call that is due, which is waited for; None once the worker is abandoned."""
        with self._condition:
            while not self._is_abandoned:
                now = time.monotonic()
                due = next((call for call in self._waiting if call.due_s <= now), None)
                if due is not None:
                    self._waiting = [call for call in self._waiting if call is not due]
                    return due
                first = min((call.due_s for call in self._waiting), default=None)
                self._condition.wait(None if first is None else first - now)
        return None

    def _hand_over(self, call: Callable[[], None]) -> None:
        """Has the owner make a call, unless the worker is abandoned by then."""
        self._deliver(lambda: None if self._is_abandoned else call())
