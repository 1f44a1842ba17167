"""Jobs side by side: in copies of this process where the system can make them, else in threads.

A field of a bench is small: computing it is many short calls, for which Python lets one thread at a time. Two threads
are as fast as one; two processes nearly twice. A forked copy has all that a job needs, and only results are sent back.
"""

from __future__ import annotations

import multiprocessing
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from typing import Any, TypeVar

from holoview.util.errors import UserError

T = TypeVar("T")
FinishedCallback = Callable[[int], None]

_SPELL_S = 0.2  # in which Ctrl-C is noticed


class WorkerPool:
    """So many workers. forks: whether they are processes; None: where that is safe, which is on Linux."""

    def __init__(self, workers: int, use_processes: bool | None = None) -> None:
        self.workers = max(1, workers)
        self.use_processes = (sys.platform == "linux" if use_processes is None else use_processes) and workers > 1

    def run(self, jobs: Sequence[Callable[[], T]], on_finished: FinishedCallback | None = None) -> list[T]:
        """Results of jobs, in their order; what one raises, in the order of jobs too. finished: told how many are."""
        told = on_finished or (lambda done: None)
        if self.workers < 2 or len(jobs) < 2:
            return [_run_inline(job, done, told) for done, job in enumerate(jobs, 1)]
        return (
            _run_in_processes(jobs, min(self.workers, len(jobs)), told)
            if self.use_processes
            else self.run_in_threads(jobs, told)
        )

    def run_in_threads(self, jobs: Sequence[Callable[[], T]], on_finished: FinishedCallback | None = None) -> list[T]:
        """The same in threads, for jobs that may not be forked."""
        with ThreadPoolExecutor(self.workers) as pool:
            futures = [pool.submit(job) for job in jobs]
            try:
                for done, future in enumerate(futures, 1):
                    while not future.done():
                        wait([future], timeout=_SPELL_S)
                    future.result()
                    if on_finished:
                        on_finished(done)
            except BaseException:
                for future in futures:
                    future.cancel()
                raise
        return [future.result() for future in futures]


def _run_inline(job: Callable[[], T], done: int, finished: FinishedCallback) -> T:
    result = job()
    finished(done)
    return result


def _run_in_processes(jobs: Sequence[Callable[[], T]], workers: int, finished: FinishedCallback) -> list[T]:
    """Each worker takes the next job that nobody has taken, and sends (number, whether it went well, result)."""
    context = multiprocessing.get_context("fork")
    following = context.Value("l", 0)
    team, pipes = [], []
    for _ in range(workers):
        ours, theirs = context.Pipe(duplex=False)
        worker = context.Process(target=_worker_loop, args=(jobs, following, theirs), daemon=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads that live here: copies don't touch them
            worker.start()
        theirs.close()
        team.append(worker)
        pipes.append(ours)
    try:
        results = _collect_results(pipes, len(jobs), finished)
    except BaseException:
        for worker in team:
            worker.terminate()
        raise
    finally:
        for worker, pipe in zip(team, pipes, strict=True):
            worker.join()
            pipe.close()
    for number in range(len(jobs)):
        went_well, result = results[number]
        if not went_well:
            raise result
    return [results[number][1] for number in range(len(jobs))]


def _collect_results(pipes: Sequence[Connection], jobs: int, finished: FinishedCallback) -> dict[int, tuple[bool, Any]]:
    results: dict[int, tuple[bool, Any]] = {}
    live = list(pipes)
    while len(results) < jobs:
        if not live:
            raise UserError("workers", "one died, perhaps of too little memory", remedy="--workers 1 works without any")
        for pipe in wait_for(live, timeout=_SPELL_S):
            assert isinstance(pipe, Connection)
            try:
                number, went_well, result = pipe.recv()
            except EOFError:
                live.remove(pipe)
                continue
            results[number] = went_well, result
            finished(len(results))
    return results


def _worker_loop(jobs: Sequence[Callable[[], Any]], next_job: Any, pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent hears it and ends us
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    while True:
        with next_job.get_lock():
            number = next_job.value
            next_job.value += 1
        if number >= len(jobs):
            return
        try:
            pipe.send((number, True, jobs[number]()))
        except Exception as error:
            pipe.send((number, False, _picklable(error)))


def _picklable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
