"""Jobs done one after the other here, in processes of this machine, or by a Dask cluster; results kept as they come.

A job that fails is tried again, elsewhere where there is an elsewhere; so is one whose process died. What is done
stays done: a run that is repeated begins with what its store holds.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import torch

from holoview.errors import UserError
from holoview.study.store import Store
from holoview.study.study import Job, Outcome, Study

Progress = Callable[[int, int, str], None]
"""Called with jobs done, jobs in all, and a few words."""

RETRIES = 2


@dataclass(frozen=True)
class Where:
    """Where jobs run: here (one worker), in `workers` processes, or on the Dask scheduler of an address."""

    workers: int = 1
    scheduler: str | None = None

    @property
    def words(self) -> str:
        """In words."""
        if self.scheduler is not None:
            return f"the cluster at {self.scheduler}"
        return f"{self.workers} processes" if self.workers > 1 else "one process"


def run_jobs(
    study: Study,
    jobs: Sequence[Job],
    store: Store,
    where: Where = Where(),
    progress: Progress = lambda done, total, note: None,
    retries: int = RETRIES,
) -> list[tuple[Job, Outcome]]:
    """Every job with its result, in order; those that the store holds aren't done again.

    Raises UserError when a job keeps failing, naming it, after all others are done and kept.
    """
    waiting = [job for job in _different(jobs) if store.find(job) is None]
    done = len(jobs) - len(waiting)
    progress(done, len(jobs), "kept from before" if done else "")

    def keep(job: Job, outcome: Outcome) -> None:
        nonlocal done
        store.keep(job, outcome)
        done += 1
        progress(done, len(jobs), job.label)

    if where.workers == 1 and where.scheduler is None:
        failed = _here(study, waiting, keep, lambda note: progress(done, len(jobs), note), retries)
    else:
        failed = _elsewhere(study, waiting, keep, where, retries)
    if failed:
        job, error = next(iter(failed.items()))
        raise UserError(
            f"job {job.label}",
            f"failed {retries + 1} times: {error}",
            remedy=f"{done} of {len(jobs)} jobs are done and kept; run it again for the rest",
        )
    found = [(job, store.find(job)) for job in jobs]
    missing = [job.label for job, outcome in found if outcome is None]
    if missing:
        raise UserError(str(store.folder), f"lost the result of {missing[0]}", remedy="run it again")
    return [(job, outcome) for job, outcome in found if outcome is not None]


def do_job(study: Study, settings: Mapping[str, Any]) -> Outcome:
    """Does a job in this process: what is sent to other ones, which import the study's module."""
    return study.work(settings, lambda note: None)


Failed = dict[Job, BaseException]


def _different(jobs: Sequence[Job]) -> list[Job]:
    """Jobs without those whose result another one gives."""
    return list({job.key: job for job in jobs}.values())


def _here(
    study: Study, jobs: Sequence[Job], keep: Callable[[Job, Outcome], None], note: Callable[[str], None], retries: int
) -> Failed:
    failed: Failed = {}
    for job in jobs:
        for left in range(retries, -1, -1):
            try:
                outcome = study.work(job.settings, partial(_noted, note, job.label))
            except UserError:
                raise  # another try would meet it again
            except Exception as error:
                if left == 0:
                    failed[job] = error
                continue
            keep(job, outcome)
            break
    return failed


def _noted(note: Callable[[str], None], label: str, text: str) -> None:
    note(f"{label}: {text}")


def _elsewhere(
    study: Study, jobs: Sequence[Job], keep: Callable[[Job, Outcome], None], where: Where, retries: int
) -> Failed:
    """Jobs in a pool; where the pool itself broke (a process was killed), a new one takes what is left."""
    left = dict.fromkeys(jobs, retries)
    failed: Failed = {}
    while left:
        with _pool(where) as pool:
            futures = {pool.submit(do_job, study, job.settings): job for job in left}
            try:
                _collect(futures, left, failed, keep)
            except BaseException:
                for future in futures:
                    future.cancel()
                raise
    return failed


def _collect(
    futures: dict[Future[Outcome], Job],
    left: dict[Job, int],
    failed: Failed,
    keep: Callable[[Job, Outcome], None],
) -> None:
    """Keeps results as they come, until all have; what is to be tried again stays in `left`."""
    waiting = set(futures)
    while waiting:
        ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        for future in ended:
            job, error = futures[future], future.exception()
            if error is None:
                del left[job]
                keep(job, future.result())
            elif isinstance(error, UserError) or left[job] == 0:
                del left[job]
                failed[job] = error
            else:
                left[job] -= 1


@contextmanager
def _pool(where: Where) -> Iterator[Executor]:
    if where.scheduler is not None:
        with _cluster(where.scheduler) as executor:
            yield executor
        return
    threads = max((os.cpu_count() or 1) // where.workers, 1)
    pool = ProcessPoolExecutor(where.workers, get_context("spawn"), torch.set_num_threads, (threads,))
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        remedy = 'pip install "holoview[cluster]"'
        raise UserError("--scheduler", "dask.distributed isn't installed", remedy=remedy) from error
    try:
        client = Client(address, timeout="10s", set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        expected = "the address of a Dask scheduler that runs, such as tcp://host:8786"
        raise UserError(f"--scheduler {address}", f"no answer: {error}", expected=expected) from error
    with client, client.get_executor(pure=False) as executor:
        yield executor
