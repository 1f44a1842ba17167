"""Places where jobs run beside this process: processes of this machine, or the workers of a Dask cluster.

A place takes functions and gives futures. A future that fails, fails for its own job: each process of this machine has
a pool of its own, so that one that is killed takes no other job with it, and a Dask scheduler moves the jobs of a
worker that is lost by itself.
"""

from __future__ import annotations

import os
import platform
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any, Protocol

from holoview.util.cpu_count import process_cpu_count
from holoview.util.errors import UserError
from holoview.util.version import __version__

_CONNECT_TIMEOUT_S = 10.0
"""For how long a scheduler may not answer."""


@dataclass(frozen=True)
class WorkerResources:
    """A worker's share of its machine: CPU threads, and its number among those beside it, which chooses its GPU."""

    threads: int = 1
    index: int = 0

    def apply(self) -> None:
        """Keeps torch, where it has been imported, to this share."""
        torch = sys.modules.get("torch")
        if torch is None:
            return
        torch.set_num_threads(self.threads)
        if torch.cuda.is_available():
            torch.cuda.set_device(self.index % torch.cuda.device_count())


class JobExecutor(Protocol):
    """Where functions run."""

    @property
    def has_free_slot(self) -> bool:
        """Whether another one would begin at once, or at least be queued elsewhere."""
        ...

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Runs work(share, *arguments), share being the `Share` of whoever runs it, or a table of them."""
        ...


class ProcessExecutor:
    """Processes of this machine, one job at a time in each, and an equal share of the cores."""

    def __init__(self, workers: int) -> None:
        threads = max(process_cpu_count() // workers, 1)
        self._idle_pools = [(WorkerResources(threads, number), _single_process_pool()) for number in range(workers)]
        self._idle_pools.reverse()
        self._busy: dict[Future[Any], tuple[WorkerResources, ProcessPoolExecutor]] = {}

    @property
    def has_free_slot(self) -> bool:
        """Whether a process is idle; one that was killed is replaced."""
        for future in [future for future in self._busy if future.done()]:
            share, process = self._busy.pop(future)
            broke = not future.cancelled() and isinstance(future.exception(), BrokenExecutor)
            if broke:
                process.shutdown()
            self._idle_pools.append((share, _single_process_pool() if broke else process))
        return bool(self._idle_pools)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Runs work(share, *arguments) in an idle process."""
        share, process = self._idle_pools.pop()
        with _sigint_blocked():  # the process is started here and now, and inherits that
            future = process.submit(function, share, *arguments)
        self._busy[future] = share, process
        return future

    def shutdown(self, kill: bool) -> None:
        """Ends all processes, in the middle of their work if so told."""
        pools = [process for _, process in (*self._idle_pools, *self._busy.values())]
        for pool in pools if kill else []:
            for process in list((pool._processes or {}).values()):
                process.terminate()
        for pool in pools:
            pool.shutdown(cancel_futures=True)


class DaskExecutor:
    """The workers of a Dask scheduler, which has the queue."""

    has_free_slot = True

    def __init__(self, executor: Executor, shares: dict[str, WorkerResources]) -> None:
        self._executor = executor
        self._shares = shares

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Runs work(shares, *arguments) on a worker; shares: by the worker's address."""
        return self._executor.submit(function, self._shares, *arguments)


@contextmanager
def process_executor(workers: int) -> Iterator[JobExecutor]:
    """Processes of this machine, killed when the block fails or is interrupted."""
    place = ProcessExecutor(workers)
    try:
        yield place
    except BaseException:
        place.shutdown(kill=True)
        raise
    place.shutdown(kill=False)


@contextmanager
def dask_executor(address: str) -> Iterator[JobExecutor]:
    """The workers of the Dask scheduler at an address, once all that are there have this version of holoview.

    Raises UserError when the scheduler doesn't answer, or a worker has another version or none.
    """
    try:
        from distributed import Client
    except ImportError as error:
        remedy = 'pip install "holoview[cluster]"'
        raise UserError("--scheduler", "dask.distributed isn't installed", remedy=remedy) from error
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        expected = "the address of a Dask scheduler that runs, such as tcp://host:8786"
        raise UserError(f"--scheduler {address}", f"no answer: {error}", expected=expected) from error
    with client:
        shares = _assign_resources(client)
        with client.get_executor(pure=False) as executor:
            yield DaskExecutor(executor, shares)


def resources_of_worker(shares: WorkerResources | dict[str, WorkerResources]) -> WorkerResources:
    """This worker's share; one that joined a cluster later takes a thread, and a GPU by its process's number."""
    if isinstance(shares, WorkerResources):
        return shares
    from distributed import get_worker

    return shares.get(get_worker().address, WorkerResources(1, os.getpid()))


def check_version(version: str, worker: str) -> None:
    """Raises UserError unless a worker's holoview is this one."""
    if version != __version__:
        expected, remedy = f"holoview {__version__}, as here", "install the same version on every worker"
        raise UserError(worker, f"has holoview {version}", expected=expected, remedy=remedy)


@dataclass(frozen=True)
class _WorkerInfo:
    """What a Dask worker says of itself; workers of one place fight for the same cores and GPUs."""

    version: str
    host: tuple[str, tuple[int, ...]]


def _worker_info() -> _WorkerInfo:
    mine = (
        tuple(sorted(os.sched_getaffinity(0)))
        if hasattr(os, "sched_getaffinity")
        else tuple(range(process_cpu_count()))
    )
    return _WorkerInfo(__version__, (platform.node(), mine))


def _assign_resources(client: Any) -> dict[str, WorkerResources]:
    """Each worker's share of its machine, by address: cores by the jobs that workers there do at a time."""
    told = client.run(_worker_info, on_error="return")
    for address, machine in told.items():
        if not isinstance(machine, _WorkerInfo):
            remedy = "install the same version on every worker"
            raise UserError(f"worker {address}", f"can't run holoview: {machine}", remedy=remedy)
        check_version(machine.version, f"worker {address}")
    at_a_time: Counter[Any] = Counter()
    workers = client.scheduler_info(n_workers=-1)["workers"]
    for address, machine in told.items():
        at_a_time[machine.host] += workers[address]["nthreads"] if address in workers else 1
    shares, beside = {}, Counter[Any]()
    for address, machine in sorted(told.items()):
        threads = max(len(machine.host[1]) // at_a_time[machine.host], 1)
        shares[address] = WorkerResources(threads, beside[machine.host])
        beside[machine.host] += 1
    return shares


def _single_process_pool() -> ProcessPoolExecutor:
    """A process, not yet started, that leaves Ctrl-C to this one."""
    return ProcessPoolExecutor(1, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN))


@contextmanager
def _sigint_blocked() -> Iterator[None]:
    """Holds back Ctrl-C, here until the block ends, in processes that are started in it for good.

    Where there are no signal masks these are protected only once they run.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
