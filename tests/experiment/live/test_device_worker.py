"""The devices' thread: calls in their order, the latest of a key, nothing once it is abandoned."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from threading import Event

import pytest

from holoview.document.call_queue import CallQueue
from holoview.rig.live_devices import DeviceWorker

Calls = list[str]


class _Owner:
    """A worker whose first call waits for `gate`, and what it did and delivered."""

    def __init__(self) -> None:
        self.queue, self.gate, self.done = CallQueue(), Event(), Calls()
        self.began = Event()
        self.worker = DeviceWorker(self.queue.put, lambda number: None)
        self.submit("gate", self._wait)

    def submit(self, key: str, work: Callable[[], object]) -> None:
        self.worker.submit(work, lambda _: self.done.append(key), lambda e: self.done.append(f"{key}: {e}"), key=key)

    def finish(self) -> Calls:
        """Opens the gate, lets the worker end after a last call, and takes what was delivered."""
        last = Event()
        self.submit("last", last.set)
        self.gate.set()
        assert last.wait(60)
        while "last" not in self.done:
            for call in self.queue.drain():
                call()
        return self.done

    def _wait(self) -> None:
        self.began.set()
        assert self.gate.wait(60)


@pytest.fixture
def owner() -> Iterator[_Owner]:
    made = _Owner()
    assert made.began.wait(60)
    yield made
    made.gate.set()
    made.worker.abandon()
    assert made.worker.join(60)


def test_calls_are_made_in_their_order_and_the_latest_of_a_key_counts(owner: _Owner) -> None:
    values = Calls()
    for key, value in (("a", "a1"), ("b", "b1"), ("a", "a2")):
        owner.submit(key, lambda value=value: values.append(value))  # type: ignore[misc]
    assert owner.finish() == ["gate", "b", "a", "last"]
    assert values == ["b1", "a2"]


def test_an_exception_is_delivered_and_the_next_call_is_made(owner: _Owner) -> None:
    def fail() -> None:
        raise ValueError("no")

    owner.submit("bad", fail)
    assert owner.finish() == ["gate", "bad: no", "last"]


def test_an_abandoned_worker_makes_and_delivers_nothing_more(owner: _Owner) -> None:
    owner.submit("a", lambda: owner.done.append("made"))
    owner.worker.abandon()
    owner.gate.set()
    assert owner.worker.join(60)
    for call in owner.queue.drain():
        call()
    assert owner.done == []
