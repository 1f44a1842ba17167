"""Jobs done one after the other here, in processes of this machine, or by a Dask cluster; results kept as they come.

A job that fails is tried again at once; so is one whose process died. What is done stays done: a run that is repeated
begins with what its store holds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
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
from holoview.study.study import JobResult, Study, StudyJob
from holoview.util.errors import UserError
from holoview.util.version import __version__

ProgressCallback = Callable[[int, int, str], None]
"""Called with jobs done, jobs in all, and a few words."""

RETRIES = 2


@dataclass(frozen=True)
class ExecutionTarget:
    """Where jobs run: here (one worker), in `workers` processes, or on the Dask scheduler of an address."""

    workers: int = 1
    scheduler: str | None = None

    @property
    def is_local(self) -> bool:
        """Whether this process does everything itself."""
        return self.workers == 1 and self.scheduler is None


def run_jobs(
    study: Study,
    jobs: Sequence[StudyJob],
    store: ResultStore,
    target: ExecutionTarget = ExecutionTarget(),
    progress: ProgressCallback = lambda done, total, note: None,
    retries: int = RETRIES,
) -> list[tuple[StudyJob, JobResult]]:
    """Every job with its result, in order; those that the store holds aren't done again.

    Raises UserError when a job keeps failing, naming it, after all others are done and kept; at once when a job
    refuses its settings or a worker has another version of holoview.
    """
    waiting = [job for job in _unique_jobs(jobs) if store.load(job) is None]
    done = len(jobs) - len(waiting)
    progress(done, len(jobs), "kept from before" if done else "")

    def keep(job: StudyJob, outcome: JobResult) -> None:
        nonlocal done
        store.save(job, outcome)
        done += 1
        progress(done, len(jobs), job.label)

    tries = _RetryPolicy(retries)
    if target.is_local:
        _run_locally(study, waiting, keep, lambda note: progress(done, len(jobs), note), tries)
    elif waiting:
        with (
            dask_executor(target.scheduler)
            if target.scheduler is not None
            else process_executor(target.workers) as place
        ):
            _run_on_executor(study, waiting, keep, place, tries)
    for job, error in tries.failed.items():
        raise UserError(
            f"job {job.label}",
            f"failed {retries + 1} times: {error}",
            remedy=f"{done} of {len(jobs)} jobs are done and kept; run it again for the rest",
        )
    found = [(job, store.load(job)) for job in jobs]
    missing = [job.label for job, outcome in found if outcome is None]
    if missing:
        raise UserError(str(store.folder), f"lost the result of {missing[0]}", remedy="run it again")
    return [(job, outcome) for job, outcome in found if outcome is not None]


def run_in_worker(
    shares: WorkerResources | dict[str, WorkerResources], study: Study, settings: Mapping[str, Any], version: str
) -> JobResult:
    """Does a job in a worker, which has imported the study's module, and torch with it, by now.

    version: of the holoview that wants it done.
    """
    if version != __version__:
        check_version(version, "the run that this worker serves")
    resources_of_worker(shares).apply()
    return study.run_job(settings, lambda note: None)


class _RetryPolicy:
    """How often each job may fail yet, and the last error of those that may not any more."""

    def __init__(self, retries: int) -> None:
        self._retries = retries
        self._used: dict[StudyJob, int] = {}
        self.failed: dict[StudyJob, BaseException] = {}

    def should_retry(self, job: StudyJob, error: BaseException) -> bool:
        """Whether a job that failed so is to be tried again. Raises what another try would meet again."""
        if isinstance(error, UserError):
            raise error
        self._used[job] = self._used.get(job, 0) + 1
        if self._used[job] <= self._retries:
            return True
        self.failed[job] = RuntimeError("its process was killed") if isinstance(error, BrokenExecutor) else error
        return False


def _unique_jobs(jobs: Sequence[StudyJob]) -> list[StudyJob]:
    """Jobs without those whose result another one gives."""
    return list({job.key: job for job in jobs}.values())


def _run_locally(
    study: Study,
    jobs: Sequence[StudyJob],
    keep: Callable[[StudyJob, JobResult], None],
    note: Callable[[str], None],
    tries: _RetryPolicy,
) -> None:
    queue = deque(jobs)
    while queue:
        job = queue.popleft()
        try:
            outcome = study.run_job(job.settings, partial(_report_with_label, note, job.label))
        except Exception as error:
            if tries.should_retry(job, error):
                queue.appendleft(job)
            continue
        keep(job, outcome)


def _report_with_label(note: Callable[[str], None], label: str, text: str) -> None:
    note(f"{label}: {text}")


def _run_on_executor(
    study: Study,
    jobs: Sequence[StudyJob],
    keep: Callable[[StudyJob, JobResult], None],
    place: JobExecutor,
    tries: _RetryPolicy,
) -> None:
    """Jobs in a place, as many at a time as it has room for."""
    queue, running = deque(jobs), dict[Future[JobResult], StudyJob]()
    try:
        while queue or running:
            while queue and place.has_free_slot:
                job = queue.popleft()
                running[place.submit(run_in_worker, study, dict(job.settings), __version__)] = job
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                job, error = running.pop(future), future.exception()
                if error is None:
                    keep(job, future.result())
                elif tries.should_retry(job, error):
                    queue.appendleft(job)
    finally:
        for future in running:
            future.cancel()
