"""Devices of a window: calls in their order, the latest of a key, lasers that another thread switches off for good."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from threading import Event, Thread

import pytest

from holoview.bench.rig.live_devices import DeviceWorker, LaserInterlock, LasersForbidden
from holoview.viewer.document.editing_session import CallQueue
from tests.patience import PATIENCE_S

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
    made.worker.abandon()
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


def test_an_abandoned_worker_makes_and_delivers_nothing_more(owner: _Owner) -> None:
    owner.submit("a", lambda: owner.done.append("made"))
    owner.worker.abandon()
    owner.gate.set()
    assert owner.worker.join(PATIENCE_S)
    for call in owner.queue.drain():
        call()
    assert owner.done == []


class _SlowLasers:
    """Lasers that take until `may_go_on` to switch on."""

    wavelengths_m = (450e-9,)

    def __init__(self) -> None:
        self.is_on, self.began, self.may_go_on = False, Event(), Event()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.began.set()
        assert self.may_go_on.wait(PATIENCE_S)
        self.is_on = True

    def switch_off(self) -> None:
        self.is_on = False

    def close(self) -> None:
        pass


def test_a_laser_that_was_being_switched_on_goes_off_again() -> None:
    lasers = _SlowLasers()
    interlock = LaserInterlock(lasers)
    interlock.begin(1)
    raised: list[BaseException] = []

    def switch_on() -> None:
        try:
            interlock.switch_on(450e-9, 1.0)
        except LasersForbidden as error:
            raised.append(error)

    thread = Thread(target=switch_on)
    thread.start()
    assert lasers.began.wait(PATIENCE_S)
    interlock.forbid(1)
    lasers.may_go_on.set()
    thread.join()
    assert raised and not lasers.is_on


def test_a_later_call_may_switch_them_on() -> None:
    lasers = _SlowLasers()
    lasers.may_go_on.set()
    interlock = LaserInterlock(lasers)
    interlock.begin(1)
    interlock.forbid(1)
    with pytest.raises(LasersForbidden):
        interlock.switch_on(450e-9, 1.0)
    assert not lasers.began.is_set()
    interlock.begin(2)
    interlock.switch_on(450e-9, 1.0)
    assert lasers.is_on
