"""Workers return what a single one would, in order; what goes wrong in one of them is told here."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from functools import partial

import numpy as np
import pytest

from holoview.diagnose.worker_pool import WorkerPool
from holoview.util.errors import UserError

TEAMS = [WorkerPool(1), WorkerPool(3, use_processes=False), WorkerPool(3, use_processes=True)]


def _late(number: int) -> np.ndarray:
    time.sleep(0.01 * (5 - number))
    return np.full(3, number)


def _fails(number: int) -> int:
    if number > 2:
        raise UserError("here", f"{number}", expected="less")
    return number


class Odd(Exception):
    """Can't pass from one process to another."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.stays_here = lambda: text


def _odd() -> None:
    raise Odd("very odd")


@pytest.mark.parametrize("team", TEAMS)
def test_results_come_in_order_and_are_counted(team: WorkerPool) -> None:
    told: list[int] = []
    results = team.run([partial(_late, k) for k in range(5)], told.append)
    assert [int(r[0]) for r in results] == [0, 1, 2, 3, 4]
    assert told == [1, 2, 3, 4, 5]
    assert team.run([]) == []


@pytest.mark.parametrize("team", TEAMS)
def test_the_first_mistake_in_order_is_raised(team: WorkerPool) -> None:
    with pytest.raises(UserError, match="here: 3; expected less"):
        team.run([partial(_fails, k) for k in range(6)])


def test_processes_are_copies() -> None:
    found = WorkerPool(2, use_processes=True).run([os.getpid] * 6)
    assert os.getpid() not in found and 1 <= len(set(found)) <= 2
    assert set(WorkerPool(2, use_processes=False).run([os.getpid] * 6)) == {os.getpid()}


def test_an_exception_that_cant_be_sent_is_told_in_words() -> None:
    with pytest.raises(RuntimeError, match="Odd: very odd"):
        WorkerPool(2, use_processes=True).run([_odd, _odd])


def test_workers_that_died_are_told() -> None:
    with pytest.raises(UserError, match=r"one died.*--workers 1"):
        WorkerPool(2, use_processes=True).run([partial(os._exit, 3)] * 4)


def test_an_interrupt_ends_the_workers() -> None:
    def interrupted(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        WorkerPool(2, use_processes=True).run(
            [partial(time.sleep, 0.01), *[partial(time.sleep, 3600)] * 3], interrupted
        )
    assert not multiprocessing.active_children()


def test_workers_dont_hear_ctrl_c() -> None:
    """The parent does, and ends them."""
    assert WorkerPool(2, use_processes=True).run([partial(signal.getsignal, signal.SIGINT)] * 2) == [signal.SIG_IGN] * 2
