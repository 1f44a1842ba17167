"""Runs jobs in this process, in processes of this machine, or on a Dask cluster, with retries.

A job that fails or whose process dies is repeated at once. Results are stored as they come, and a repeated run computes
only those that its store lacks.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

from holoview.study.executors import (
    JobExecutor,
    WorkerResources,
    check_version,
    dask_executor,
    process_executor,
    resources_of_worker,
)
from holoview.study.store import ResultStore
from holoview.study.study import JobResult, StatusCallback, Study, StudyJob
from holoview.util.errors import UserError
from holoview.util.memory import memory_setting
from holoview.util.packages import __version__
from holoview.util.progress import ProgressCallback

RETRIES = 2


@dataclass(frozen=True)
class ExecutionTarget:
    """Where jobs run: in this process (one worker), in `workers` processes, or on a Dask scheduler, by its address."""

    workers: int = 1
    scheduler: str | None = None

    @property
    def is_local(self) -> bool:
        """Whether jobs run in this process."""
        return self.workers == 1 and self.scheduler is None


def run_jobs(
    study: Study,
    jobs: Sequence[StudyJob],
    store: ResultStore,
    target: ExecutionTarget = ExecutionTarget(),
    progress: ProgressCallback = lambda done, total, note: None,
    retries: int = RETRIES,
) -> list[tuple[StudyJob, JobResult]]:
    """Every job with its result, in order; jobs whose results are stored aren't run.

    progress: called after each job. retries: how often a failing job is repeated. Raises UserError that names a job
    which keeps failing, after all others have been run; at once when a job raises UserError itself, or when a worker
    has another version of holoview.
    """
    waiting = [job for job in _unique_jobs(jobs) if store.load(job) is None]
    done = len(jobs) - len(waiting)
    progress(done, len(jobs), "kept from before" if done else "")

    def save(job: StudyJob, result: JobResult) -> None:
        nonlocal done
        store.save(job, result)
        done += 1
        progress(done, len(jobs), job.label)

    policy = _RetryPolicy(retries)
    if target.is_local:
        _run_locally(study, waiting, save, lambda text: progress(done, len(jobs), text), policy)
    elif waiting:
        with _open_executor(target) as executor:
            _run_on_executor(study, waiting, save, executor, policy)
    for job, error in policy.failed.items():
        raise UserError(
            f"job {job.label}",
            f"failed {retries + 1} times: {error}",
            remedy=f"{done} of {len(jobs)} jobs are done and kept; run it again for the rest",
        )
    return _load_results(jobs, store)


def run_in_worker(
    resources: WorkerResources | dict[str, WorkerResources], study: Study, settings: Mapping[str, Any], version: str
) -> JobResult:
    """Runs a job in a worker, with what its executor passes as `resources`.

    version: of holoview in the process that submitted the job. The study's module, and torch with it, has been imported
    when the arguments were unpickled, so that torch can be limited to the worker's resources.
    """
    if version != __version__:
        check_version(version, "the run that this worker serves")
    own = resources_of_worker(resources)
    own.apply()
    with memory_setting(own.memory):
        return study.run_job(settings, lambda text: None)


class _RetryPolicy:
    """Counts the failures of each job. failed: the last error of jobs that have failed too often."""

    def __init__(self, retries: int) -> None:
        self._retries = retries
        self._failure_counts: dict[StudyJob, int] = {}
        self.failed: dict[StudyJob, BaseException] = {}

    def should_retry(self, job: StudyJob, error: BaseException) -> bool:
        """Whether a job that failed with this error is repeated. Raises UserErrors, which would only occur again."""
        if isinstance(error, UserError):
            raise error
        self._failure_counts[job] = self._failure_counts.get(job, 0) + 1
        if self._failure_counts[job] <= self._retries:
            return True
        self.failed[job] = RuntimeError("its process was killed") if isinstance(error, BrokenExecutor) else error
        return False


def _unique_jobs(jobs: Sequence[StudyJob]) -> list[StudyJob]:
    """One job for each key."""
    return list({job.key: job for job in jobs}.values())


def _open_executor(target: ExecutionTarget) -> AbstractContextManager[JobExecutor]:
    return process_executor(target.workers) if target.scheduler is None else dask_executor(target.scheduler)


def _load_results(jobs: Sequence[StudyJob], store: ResultStore) -> list[tuple[StudyJob, JobResult]]:
    results = []
    for job in jobs:
        result = store.load(job)
        if result is None:
            raise UserError(str(store.folder), f"lost the result of {job.label}", remedy="run it again")
        results.append((job, result))
    return results


def _run_locally(
    study: Study,
    jobs: Sequence[StudyJob],
    save: Callable[[StudyJob, JobResult], None],
    status: StatusCallback,
    policy: _RetryPolicy,
) -> None:
    queue = deque(jobs)
    while queue:
        job = queue.popleft()
        try:
            result = study.run_job(job.settings, partial(_report_with_label, status, job.label))
        except Exception as error:
            if policy.should_retry(job, error):
                queue.appendleft(job)
            continue
        save(job, result)


def _report_with_label(status: StatusCallback, label: str, text: str) -> None:
    status(f"{label}: {text}")


def _run_on_executor(
    study: Study,
    jobs: Sequence[StudyJob],
    save: Callable[[StudyJob, JobResult], None],
    executor: JobExecutor,
    policy: _RetryPolicy,
) -> None:
    """Runs as many jobs at a time as the executor has free slots."""
    queue, running = deque(jobs), dict[Future[JobResult], StudyJob]()
    try:
        while queue or running:
            while queue and executor.has_free_slot:
                job = queue.popleft()
                running[executor.submit(run_in_worker, study, dict(job.settings), __version__)] = job
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                job, error = running.pop(future), future.exception()
                if error is None:
                    save(job, future.result())
                elif policy.should_retry(job, error):
                    queue.appendleft(job)
    finally:
        for future in running:
            future.cancel()
