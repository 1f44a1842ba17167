"""What runs on a thread beside its owner: calls are sent to the thread, their results come back as calls of the owner.

Mailbox       calls in their order, of which a later one of the same key replaces one that still waits
LatestTask    only the latest request, and not twice for the same inputs
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from threading import Condition, Thread
from typing import Any, Generic, TypeVar

T = TypeVar("T")
Inputs = tuple[Any, ...]
Deliver = Callable[[Callable[[], None]], None]
"""Makes the owner's thread call a function."""


@dataclass(frozen=True)
class _Call:
    """A call that waits. number: rises from call to call. due_s: earliest begin, on `time.monotonic`."""

    key: str
    number: int
    due_s: float
    work: Callable[[], Any]
    on_result: Callable[[Any], None]
    on_error: Callable[[BaseException], None]


class Mailbox:
    """Makes calls in their order; a later call of the same key replaces a call that still waits.

    name: of the thread. deliver: results and exceptions go to the owner by it. on_begin: called on the thread with the
    number of each call before it is made.
    """

    def __init__(self, name: str, deliver: Deliver, on_begin: Callable[[int], None] = lambda number: None) -> None:
        self._name, self._deliver, self._on_begin = name, deliver, on_begin
        self._condition, self._waiting = Condition(), list[_Call]()
        self._count = self._untaken = 0  # untaken: calls that were begun and whose answers weren't given yet
        self._is_closed = False
        self._thread: Thread | None = None

    def submit(
        self,
        work: Callable[[], T],
        on_result: Callable[[T], None],
        on_error: Callable[[BaseException], None],
        *,
        key: str = "",
        delay_s: float = 0.0,
    ) -> None:
        """Has the thread make the call `work`, and the owner one of the other calls. delay_s: the least until then."""
        with self._condition:
            self._count += 1
            call = _Call(key, self._count, time.monotonic() + delay_s, work, on_result, on_error)
            self._waiting = [*(other for other in self._waiting if other.key != key), call]
            self._condition.notify()
        if self._thread is None:
            self._thread = Thread(target=self._run, name=f"holoview: {self._name}", daemon=True)
            self._thread.start()

    @property
    def count(self) -> int:
        """The number of the last call that was submitted."""
        return self._count

    @property
    def is_busy(self) -> bool:
        """Whether a call waits or is being made, or its result waits for the owner."""
        with self._condition:
            return bool(self._untaken or self._waiting)

    @property
    def is_superseded(self) -> bool:
        """Whether a further call waits, or none is made any more."""
        with self._condition:
            return self._is_closed or bool(self._waiting)

    @property
    def is_closed(self) -> bool:
        """Whether it was closed."""
        return self._is_closed

    def forget_waiting(self) -> None:
        """Drops the calls that haven't begun."""
        with self._condition:
            self._waiting = []

    def close(self) -> None:
        """Makes no further call, and delivers nothing more; the call that is being made goes on."""
        with self._condition:
            self._is_closed, self._waiting = True, []
            self._condition.notify()

    def join(self, timeout_s: float) -> bool:
        """Waits until the thread has ended, which it does once it is closed; returns whether it has."""
        if self._thread is None:
            return True
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (call := self._next()) is not None:
            self._on_begin(call.number)
            try:
                answer = partial(call.on_result, call.work())
            except BaseException as error:  # else nobody would hear of it
                answer = partial(call.on_error, error)
            self._deliver(partial(self._hand_over, answer))

    def _next(self) -> _Call | None:
        """The first call that is due, which is waited for; None once it is closed."""
        with self._condition:
            while not self._is_closed:
                now = time.monotonic()
                due = next((call for call in self._waiting if call.due_s <= now), None)
                if due is not None:
                    self._waiting = [call for call in self._waiting if call is not due]
                    self._untaken += 1
                    return due
                first = min((call.due_s for call in self._waiting), default=None)
                self._condition.wait(None if first is None else first - now)
        return None

    def _hand_over(self, answer: Callable[[], None]) -> None:
        """Called by the owner: takes what a call returned or raised, unless it was closed by then."""
        try:
            if not self._is_closed:
                answer()
        finally:
            with self._condition:  # not earlier: who sees that nothing is awaited any more finds what the answer left
                self._untaken -= 1


def are_same(one: Inputs, other: Inputs) -> bool:
    """Whether all inputs are equal; arrays are compared by identity, as edits share unchanged arrays."""
    return len(one) == len(other) and all(
        a is b or (not hasattr(a, "__array__") and bool(a == b)) for a, b in zip(one, other, strict=True)
    )


class LatestTask(Generic[T]):
    """Runs the request that was submitted last and delivers its results, or its exception, to the owner.

    name: of the thread. deliver: has the owner make a call. on_error: called by the owner with the exception.
    """

    def __init__(self, name: str, deliver: Deliver, on_error: Callable[[BaseException], None]) -> None:
        self._mailbox = Mailbox(name, deliver)
        self._deliver, self._on_error = deliver, on_error
        self._inputs: Inputs | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a request waits or is being run, or its result waits for the owner."""
        return self._mailbox.is_busy

    def submit(self, work: Callable[[], T], on_result: Callable[[T], None], inputs: Inputs | None = None) -> None:
        """Runs `work` on the thread; the owner then calls `on_result` with the result.

        inputs: of the work, which isn't done again while they stay the same; None: it is done each time.
        """
        self._submit(work, on_result, inputs)

    def submit_steps(
        self, steps: Callable[[], Iterable[T]], on_result: Callable[[T], None], inputs: Inputs | None = None
    ) -> None:
        """As `submit`; the owner calls `on_result` with the result of each step. A newer request ends the steps."""

        def run() -> None:
            for result in steps():
                self._deliver(partial(on_result, result))
                if self._mailbox.is_superseded:
                    break

        self._submit(run, lambda _: None, inputs)

    def _submit(self, work: Callable[[], Any], on_result: Callable[[Any], None], inputs: Inputs | None) -> None:
        if inputs is None or self._inputs is None or not are_same(inputs, self._inputs):
            self._inputs = inputs
            self._mailbox.submit(work, on_result, self._on_error)

    def close(self) -> None:
        """Ends the thread after the request that it is running, whose result isn't delivered any more."""
        self._mailbox.close()
