"""Workers return what a single one would, in order; what goes wrong in one of them is told here."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest

from holoview.bench.diagnose.worker_pool import WorkerPool
from holoview.light.model.effects import registry
from holoview.light.model.effects.effect import Effect
from holoview.util.errors import UserError
from holoview.util.memory_limit import VARIABLE, WORKER_BYTES, parse_size
from tests.child_process import child_process
from tests.patience import PATIENCE_S

TABLE = {"answer": 42}


@pytest.fixture
def processes() -> Iterator[WorkerPool]:
    """Two processes that are ready."""
    with WorkerPool(2) as pool:
        pool.share({"table": TABLE})
        pool.start()
        yield pool


@pytest.fixture(params=["one worker", "not started", "two processes"])
def pool(request: pytest.FixtureRequest) -> Iterator[WorkerPool]:
    with WorkerPool(1 if request.param == "one worker" else 2, start_after_s=3600) as made:
        if request.param == "two processes":
            made.start()
        yield made


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


def _same_table(first: dict[str, int], second: dict[str, int]) -> tuple[bool, int]:
    return first is second, first["answer"]


def _thread_names() -> list[str]:
    return sorted(thread.name for thread in threading.enumerate())


def test_results_come_in_order_and_are_counted(pool: WorkerPool) -> None:
    told: list[int] = []
    results = pool.run([partial(_late, k) for k in range(5)], told.append)
    assert [int(r[0]) for r in results] == [0, 1, 2, 3, 4]
    assert told == [1, 2, 3, 4, 5]
    assert pool.run([]) == []


def test_the_first_mistake_in_order_is_raised(pool: WorkerPool) -> None:
    with pytest.raises(UserError, match="here: 3; expected less"):
        pool.run([partial(_fails, k) for k in range(6)])


def test_jobs_run_here_until_the_processes_are_ready(processes: WorkerPool) -> None:
    found = processes.run([os.getpid] * 6)
    assert os.getpid() not in found and 1 <= len(set(found)) <= 2
    with WorkerPool(2, start_after_s=3600) as early:
        assert set(early.run([os.getpid] * 6)) == {os.getpid()}


def test_processes_do_not_depend_on_the_threads_of_this_one(processes: WorkerPool) -> None:
    """They are not copies of it. Each has one thread beside its own, which waits for the end of its parent."""
    assert processes.run([_thread_names] * 2) == [["MainThread", "parent of holoview"]] * 2


def test_what_is_shared_is_one_object_in_each_process(processes: WorkerPool) -> None:
    separate = dict(TABLE)
    assert processes.run([partial(_same_table, TABLE, TABLE)] * 3) == [(True, 42)] * 3
    assert processes.run([partial(_same_table, TABLE, separate)] * 2) == [(False, 42)] * 2


def test_processes_that_rest_are_gone_and_others_take_their_place(processes: WorkerPool) -> None:
    (first, *_) = processes.run([os.getpid] * 4)
    processes.rest()
    processes.rest()
    assert not psutil.pid_exists(first)
    assert processes.run([os.getpid] * 2)[0] == os.getpid(), "until others are ready, this process works"
    processes.start()
    assert {first, os.getpid()}.isdisjoint(processes.run([os.getpid] * 4))
    assert processes.run([partial(_same_table, TABLE, TABLE)] * 2) == [(True, 42)] * 2


def test_objects_that_cannot_be_sent_keep_the_jobs_here() -> None:
    with WorkerPool(2) as pool:
        pool.share({"function": lambda: None})
        pool.start()
        assert set(pool.run([os.getpid] * 2)) == {os.getpid()}


def test_processes_share_the_memory_and_are_no_more_than_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    limit = psutil.Process().memory_info().rss + 6 * WORKER_BYTES
    monkeypatch.setenv(VARIABLE, str(limit))
    with WorkerPool(8) as pool:
        pool.share({}, needed=WORKER_BYTES)
        assert pool.workers in (2, 3)
        pool.start()
        shares = pool.run([partial(os.getenv, VARIABLE)] * 4)
        (share,) = {parse_size(str(stated), "share") for stated in shares}
        assert 5 * WORKER_BYTES < pool.workers * share <= 6 * WORKER_BYTES


HAZE = """
from holoview.light.effects import Effect, Parameter

class Haze(Effect):
    id, cause, finding, acts_on = "haze", "Haze.", "Haze of {share}.", ("camera",)
    parameters = (Parameter("share", "Of the mean.", low=0.0, prior=0.05),)

    def image(self, image, context, v):
        return image + v["share"] * image.mean()
"""


def _identifier(effect: Effect) -> tuple[str, str]:
    """The id of an effect that was sent, and of the one that this process knows by it."""
    return effect.id, registry.get_effect(effect.id).id


@pytest.mark.usefixtures("no_user_effects")
def test_effects_of_a_users_file_are_known_in_every_process(tmp_path: Path) -> None:
    (tmp_path / "haze.py").write_text(HAZE, encoding="utf-8")
    (effect,) = registry.load_user_effects(tmp_path / "haze.py")
    with WorkerPool(2) as pool:
        pool.share({"haze": effect}, partial(registry.load_user_effects, str(tmp_path / "haze.py")))
        pool.start()
        assert pool.run([partial(_identifier, effect)] * 2) == [("haze", "haze")] * 2


def test_an_exception_that_cant_be_sent_is_told_in_words(processes: WorkerPool) -> None:
    with pytest.raises(RuntimeError, match="Odd: very odd"):
        processes.run([_odd, _odd])


def test_workers_that_died_are_told(processes: WorkerPool) -> None:
    with pytest.raises(UserError, match=r"one died.*--workers 1"):
        processes.run([partial(os._exit, 3)] * 4)


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
@pytest.mark.parametrize("number", [0, 1])
def test_a_pool_ends_though_a_process_died_while_it_waited_for_a_job(number: int) -> None:
    """One of the waiting processes holds the lock of their queue, which then stays locked."""
    before = {*multiprocessing.active_children()}
    pool = WorkerPool(2)
    pool.start()
    victim = [*({*multiprocessing.active_children()} - before)][number]
    assert victim.pid is not None
    os.kill(victim.pid, signal.SIGKILL)
    end = threading.Thread(target=pool.close, daemon=True)
    end.start()
    end.join(PATIENCE_S)
    assert not end.is_alive() and {*multiprocessing.active_children()} <= before


def test_an_interrupt_ends_the_workers() -> None:
    def interrupted(done: int) -> None:
        raise KeyboardInterrupt

    before = {*multiprocessing.active_children()}
    with pytest.raises(KeyboardInterrupt), WorkerPool(2) as pool:
        pool.start()
        pool.run([partial(time.sleep, 0.01), *[partial(time.sleep, 3600)] * 3], interrupted)
    assert {*multiprocessing.active_children()} <= before


def test_workers_dont_hear_ctrl_c(processes: WorkerPool) -> None:
    """The parent does, and ends them."""
    assert processes.run([partial(signal.getsignal, signal.SIGINT)] * 2) == [signal.SIG_IGN] * 2


KILLED = """
import os, time
from holoview.bench.diagnose.worker_pool import WorkerPool

if __name__ == "__main__":
    with WorkerPool(2) as pool:
        pool.start()
        print(*{process.pid for process in pool._executor._processes.values()}, flush=True)
        time.sleep(600)
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_workers_end_when_their_program_is_killed(tmp_path: Path) -> None:
    (tmp_path / "killed.py").write_text(KILLED, encoding="utf-8")
    with child_process([sys.executable, tmp_path / "killed.py"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        workers = [psutil.Process(int(word)) for word in process.stdout.readline().split()]
        assert len(workers) == 2
        process.kill()
    _, alive = psutil.wait_procs(workers, timeout=PATIENCE_S)
    assert not alive
