"""Executors for jobs: worker processes of this machine, or the workers of a Dask cluster.

A lost worker fails only its own job: each worker process has a pool of its own, since a `ProcessPoolExecutor` breaks as
a whole when one of its processes dies, and a Dask scheduler moves the jobs of a lost worker to others.
"""

from __future__ import annotations

import os
import platform
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any, Protocol

from holoview.util.errors import UserError
from holoview.util.memory import WORKER_BYTES, allowed_bytes, format_size, worker_share, workers_within_memory
from holoview.util.packages import __version__, import_optional
from holoview.util.processes import leave_signals_to_parent, signals_blocked
from holoview.util.processors import process_cpu_count

CONNECT_TIMEOUT_S = 10.0
"""Time within which a Dask scheduler has to answer."""


@dataclass(frozen=True)
class WorkerResources:
    """What a worker may use of its machine.

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
        """Whether a process is idle; one that died is replaced."""
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
