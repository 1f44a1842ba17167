"""Runs jobs in this process, in processes of this machine, or on a Dask cluster, with retries, and keeps their results.

A job that fails or whose process dies is repeated at once. Results are stored as they come, and a repeated run computes
only those that its store lacks.

`ResultStore`                        results as JSON, PNG and hologram files in a folder
`process_executor`, `dask_executor`  workers, each with its share of the machine
`run_jobs`                           every job with its result
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from holoview.evidence.study.study import JobResult, StatusCallback, Study, StudyJob
from holoview.holograms.files.image_reader import read_raster
from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import load_hologram
from holoview.util.errors import UserError
from holoview.util.file_writer import make_folder, write_file
from holoview.util.files import read_text
from holoview.util.memory_limit import (
    WORKER_BYTES,
    allowed_bytes,
    format_size,
    memory_setting,
    worker_share,
    workers_within_memory,
)
from holoview.util.packages import __version__, import_optional
from holoview.util.processes import leave_signals_to_parent, process_cpu_count, signals_blocked
from holoview.util.progress import ProgressCallback
from holoview.util.tables import parse_json_table

_FORMAT, _WHAT = "holoview-result", "the result of a study's job"
_MOST_BYTES = 1 << 28  # of its numbers


class ResultStore:
    """The results in a folder, by the keys of their jobs. Raises WriteError when the folder can't be made.

    keeps_holograms: whether holograms are stored too; a job that was stored without is then done again.
    """

    def __init__(self, folder: Path, *, keeps_holograms: bool = False) -> None:
        self.folder, self._keeps_holograms = folder, keeps_holograms
        make_folder(folder)

    def load(self, job: StudyJob) -> JobResult | None:
        """The result of a job; None when it is missing, incomplete or damaged, so that the job is to be done again."""
        path = self._path(job)
        try:
            stored = parse_json_table(read_text(path, _WHAT, most=_MOST_BYTES), str(path), _WHAT)
            numbers, files, digest = stored.get("numbers"), stored.get("pictures"), stored.pop("digest", None)
            if stored.get("format") != _FORMAT or digest != _digest(stored):
                return None
            if not isinstance(numbers, dict) or not isinstance(files, dict):
                return None
            pictures = {name: self._read_pixels(file) for name, file in files.items()}
            if not self._keeps_holograms:
                return JobResult(numbers, pictures)
            if "hologram" not in stored:
                return None
            hologram = load_hologram(self._hologram_path(job)) if stored["hologram"] else None
            return JobResult(numbers, pictures, hologram)
        except UserError:
            return None

    def save(self, job: StudyJob, result: JobResult) -> None:
        """Writes a result, the JSON file last: where it exists, the pictures do too."""
        files: dict[str, str] = {}
        for name, pixels in result.pictures.items():
            files[name] = f"{job.key}-{name}.png"
            write_png(self.folder / files[name], pixels, {"holoview.job": job.label})
        content: dict[str, Any] = {
            "format": _FORMAT,
            "study": job.study,
            "label": job.label,
            "settings": dict(job.settings),
            "numbers": result.numbers,
            "pictures": files,
        }
        if self._keeps_holograms:
            content["hologram"] = result.hologram is not None
            if result.hologram is not None:
                result.hologram.save(self._hologram_path(job))
        write_file(self._path(job), json.dumps(content | {"digest": _digest(content)}, indent=1))

    def _read_pixels(self, name: Any) -> NDArray[np.uint8]:
        """The pixels of a picture of this folder, (y, x, 3)."""
        if not isinstance(name, str) or Path(name).name != name:
            raise UserError(str(self.folder), f"the picture {name!r}", expected="the name of a file in this folder")
        raster = read_raster(self.folder / name)
        return np.broadcast_to(np.rint(raster.values * 255).astype(np.uint8), (*raster.values.shape[:2], 3))

    def _path(self, job: StudyJob) -> Path:
        return self.folder / f"{job.key}.json"

    def _hologram_path(self, job: StudyJob) -> Path:
        return self.folder / f"{job.key}.safetensors"


def _digest(content: Mapping[str, Any]) -> str:
    """Of all that a result's file says. A file with another digest was changed or has lost a number."""
    text = json.dumps(json.loads(json.dumps(content)), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


# --- workers ---
#
# A lost worker fails only its own job: each worker process has a pool of its own, since a `ProcessPoolExecutor` breaks
# as a whole when one of its processes dies, and a Dask scheduler moves the jobs of a lost worker to others.


CONNECT_TIMEOUT_S = 10.0
"""Time within which a Dask scheduler has to answer."""


@dataclass(frozen=True)
class WorkerResources:
    """The share of its machine that a worker may use.

    threads: CPU threads. index: number among the workers of the machine, which selects its GPU. memory: as --memory
    states it; None: as the process finds out itself.
    """

    threads: int = 1
    index: int = 0
    memory: str | None = None

    def apply(self) -> None:
        """Limits torch, if it has been imported, to these resources."""
        torch = sys.modules.get("torch")
        if torch is None:
            return
        torch.set_num_threads(self.threads)
        if torch.cuda.is_available():
            torch.cuda.set_device(self.index % torch.cuda.device_count())


class JobExecutor(Protocol):
    """Runs functions in workers."""

    @property
    def has_free_slot(self) -> bool:
        """Whether another function would start at once, or be queued by a scheduler."""
        ...

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Runs function(resources, *arguments) in a worker; `resources_of_worker` gives the worker's own ones."""
        ...


class ProcessExecutor:
    """Processes of this machine, each with one job at a time and an equal share of the CPU cores and of the memory."""

    def __init__(self, workers: int) -> None:
        threads, memory = max(process_cpu_count() // workers, 1), worker_share(workers)
        resources = [WorkerResources(threads, number, memory) for number in range(workers)]
        self._idle_pools = [(own, _single_process_pool()) for own in resources]
        self._idle_pools.reverse()
        self._busy: dict[Future[Any], tuple[WorkerResources, ProcessPoolExecutor]] = {}

    @property
    def has_free_slot(self) -> bool:
        """Whether a process is idle; a process that died is replaced."""
        for future in [future for future in self._busy if future.done()]:
            resources, pool = self._busy.pop(future)
            is_broken = not future.cancelled() and isinstance(future.exception(), BrokenExecutor)
            if is_broken:
                pool.shutdown()
            self._idle_pools.append((resources, _single_process_pool() if is_broken else pool))
        return bool(self._idle_pools)

    @property
    def worker_resources(self) -> list[WorkerResources]:
        """The resources of each process."""
        return [resources for resources, _ in (*self._idle_pools, *self._busy.values())]

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Runs function(resources, *arguments) in an idle process."""
        resources, pool = self._idle_pools.pop()
        with signals_blocked():  # a process that is started now inherits the blocked signal
            future = pool.submit(function, resources, *arguments)
        self._busy[future] = resources, pool
        return future

    def shutdown(self, kill: bool) -> None:
        """Ends all processes. kill: without waiting for their jobs."""
        pools = [pool for _, pool in (*self._idle_pools, *self._busy.values())]
        for pool in pools if kill else []:
            for process in list((pool._processes or {}).values()):  # Python 3.14 has `kill_workers` for this
                process.kill()
        for pool in pools:
            pool.shutdown(cancel_futures=True)


class DaskExecutor:
    """The workers of a Dask scheduler, which queues functions itself. worker_resources: by the workers' addresses."""

    has_free_slot = True

    def __init__(self, executor: Executor, worker_resources: dict[str, WorkerResources]) -> None:
        self._executor = executor
        self.worker_resources = worker_resources

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Runs function(worker_resources, *arguments) in a worker."""
        return self._executor.submit(function, self.worker_resources, *arguments)


@contextmanager
def process_executor(workers: int) -> Iterator[JobExecutor]:
    """An executor of `workers` processes, which are killed when the block fails or is interrupted.

    Raises UserError if so many don't fit into the memory that may be taken.
    """
    if workers > (most := workers_within_memory(workers)):
        found = f"leave each process less than {format_size(WORKER_BYTES)} of memory, which it takes without a job"
        raise UserError(f"--workers {workers}", found, expected=f"at most {most}", remedy="or allow more by --memory")
    executor = ProcessExecutor(workers)
    try:
        yield executor
    except BaseException:
        executor.shutdown(kill=True)
        raise
    executor.shutdown(kill=False)


@contextmanager
def dask_executor(address: str) -> Iterator[DaskExecutor]:
    """An executor of the Dask scheduler at an address, all of whose workers have this version of holoview.

    Raises UserError when the scheduler doesn't answer, or a worker has another version or none.
    """
    distributed = import_optional("distributed", "--scheduler")
    try:
        client = distributed.Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        expected = "the address of a Dask scheduler that runs, such as tcp://host:8786"
        raise UserError(f"--scheduler {address}", f"no answer: {error}", expected=expected) from error
    with client:
        resources = _assign_resources(client)
        with client.get_executor(pure=False) as executor:
            yield DaskExecutor(executor, resources)


def resources_of_worker(resources: WorkerResources | dict[str, WorkerResources]) -> WorkerResources:
    """The resources of the worker that calls this, from what an executor passed to its function.

    A Dask worker that joined later takes one thread, and a GPU by its process id.
    """
    if isinstance(resources, WorkerResources):
        return resources
    worker = import_optional("distributed", "--scheduler").get_worker()
    return resources.get(worker.address, WorkerResources(1, os.getpid()))


def check_version(version: str, worker: str) -> None:
    """Raises UserError unless a worker's version of holoview is that of this process. worker: its name in the error."""
    if version != __version__:
        expected, remedy = f"holoview {__version__}, as here", "install the same version on every worker"
        raise UserError(worker, f"has holoview {version}", expected=expected, remedy=remedy)


@dataclass(frozen=True)
class _WorkerInfo:
    """Version and host of a Dask worker, and the bytes that it may take if it is alone there.

    host: name and CPU cores; workers with equal ones share cores, memory and GPUs.
    """

    version: str
    host: tuple[str, tuple[int, ...]]
    memory: int


def _worker_info() -> _WorkerInfo:
    has_affinity = hasattr(os, "sched_getaffinity")
    cores = tuple(sorted(os.sched_getaffinity(0))) if has_affinity else tuple(range(process_cpu_count()))
    return _WorkerInfo(__version__, (platform.node(), cores), allowed_bytes())


def _assign_resources(client: Any) -> dict[str, WorkerResources]:
    """The resources of each worker by address.

    The cores and the memory of a host are divided by the number of jobs that it does at the same time.
    """
    infos = client.run(_worker_info, on_error="return")
    for address, info in infos.items():
        if not isinstance(info, _WorkerInfo):
            remedy = "install the same version on every worker"
            raise UserError(f"worker {address}", f"can't run holoview: {info}", remedy=remedy)
        check_version(info.version, f"worker {address}")
    simultaneous_jobs: Counter[Any] = Counter()
    workers = client.scheduler_info(n_workers=-1)["workers"]
    for address, info in infos.items():
        simultaneous_jobs[info.host] += workers[address]["nthreads"] if address in workers else 1
    resources, workers_on_host = {}, Counter[Any]()
    for address, info in sorted(infos.items()):
        jobs = simultaneous_jobs[info.host]
        memory = worker_share(jobs, info.memory)
        resources[address] = WorkerResources(max(len(info.host[1]) // jobs, 1), workers_on_host[info.host], memory)
        workers_on_host[info.host] += 1
    return resources


def _single_process_pool() -> ProcessPoolExecutor:
    """A pool of one process, which starts with the first job and ignores Ctrl-C: this process handles it."""
    return ProcessPoolExecutor(1, get_context("spawn"), leave_signals_to_parent)


# --- jobs ---


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
