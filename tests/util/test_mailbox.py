"""A mailbox: calls in their order, the latest of a key; a task that is done again only for other inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from queue import Queue
from threading import Event

import numpy as np
import pytest

from holoview.util.mailbox import LatestTask, Mailbox
from holoview.viewer.document.editing_session import CallQueue
from tests.patience import PATIENCE_S, wait_until

Calls = list[str]


class _Owner:
    """A mailbox whose first call waits for `gate`, and what it did and delivered."""

    def __init__(self) -> None:
        self.queue, self.gate, self.done = CallQueue(), Event(), Calls()
        self.began = Event()
        self.worker = Mailbox("test", self.queue.put)
        self.submit("gate", self._wait)

    def submit(self, key: str, work: Callable[[], object]) -> None:
        self.worker.submit(work, lambda _: self.done.append(key), lambda e: self.done.append(f"{key}: {e}"), key=key)

    def finish(self) -> Calls:
        """Opens the gate, lets the worker end after a last call, and takes what was delivered."""
        last = Event()
        self.submit("last", last.set)
        self.gate.set()
        assert last.wait(PATIENCE_S)
        while "last" not in self.done:
            for call in self.queue.drain():
                call()
        return self.done

    def _wait(self) -> None:
        self.began.set()
        assert self.gate.wait(PATIENCE_S)


@pytest.fixture
def owner() -> Iterator[_Owner]:
    made = _Owner()
    assert made.began.wait(PATIENCE_S)
    yield made
    made.gate.set()
    made.worker.close()
    assert made.worker.join(PATIENCE_S)


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


def test_a_closed_mailbox_makes_and_delivers_nothing_more(owner: _Owner) -> None:
    owner.submit("a", lambda: owner.done.append("made"))
    owner.worker.close()
    owner.gate.set()
    assert owner.worker.join(PATIENCE_S)
    for call in owner.queue.drain():
        call()
    assert owner.done == []


def test_work_is_done_again_only_when_its_inputs_change() -> None:
    results, picture = Queue[str](), np.zeros(3)
    task = LatestTask[str]("test", lambda call: call(), lambda error: None)
    task.submit(lambda: "first", results.put, (picture, 1))
    assert results.get(timeout=PATIENCE_S) == "first"
    task.submit(lambda: "the same", results.put, (picture, 1))
    task.submit(lambda: "a copy", results.put, (picture.copy(), 1))
    assert results.get(timeout=PATIENCE_S) == "a copy", "arrays are the same by identity"
    task.submit(lambda: "no inputs", results.put)
    assert results.get(timeout=PATIENCE_S) == "no inputs"
    task.close()


def test_it_is_busy_until_its_owner_has_all_results(owner: _Owner) -> None:
    owner.submit("a", lambda: None)
    assert owner.worker.is_busy and owner.worker.is_superseded, "a call waits behind that which is being made"
    owner.finish()
    assert not owner.worker.is_busy and not owner.worker.is_superseded


def test_it_is_busy_while_its_owner_takes_a_result(owner: _Owner) -> None:
    """Another thread that sees it idle finds what the owner made of the result."""
    owner.finish()
    was_busy: list[bool] = []
    owner.worker.submit(lambda: None, lambda result: was_busy.append(owner.worker.is_busy), lambda error: None)
    wait_until(lambda: not owner.queue.is_empty)
    for call in owner.queue.drain():
        call()
    assert was_busy == [True] and not owner.worker.is_busy


def test_a_call_waits_for_its_delay_and_lets_later_calls_pass() -> None:
    """Only the order is certain: a delay of so many seconds is never over first."""
    done = Queue[str]()
    mailbox = Mailbox("test", lambda call: call())
    mailbox.submit(lambda: "late", done.put, lambda error: None, key="late", delay_s=PATIENCE_S)
    mailbox.submit(lambda: "soon", done.put, lambda error: None, key="soon")
    assert done.get(timeout=PATIENCE_S) == "soon" and mailbox.is_busy
    mailbox.forget_waiting()
    assert not mailbox.is_superseded
    mailbox.close()
    assert mailbox.join(PATIENCE_S) and done.empty()


def test_steps_end_when_a_newer_request_comes() -> None:
    steps, results = Queue[int](), Queue[int]()
    task = LatestTask[int]("test", lambda call: call(), lambda error: None)
    task.submit_steps(lambda: iter(steps.get, None), results.put)
    steps.put(1)
    assert results.get(timeout=PATIENCE_S) == 1
    task.submit(lambda: 7, results.put)
    steps.put(2)
    assert [results.get(timeout=PATIENCE_S) for _ in range(2)] == [2, 7]
    task.close()
