"""Runs jobs in this process, and after a while in several.

Computing a field is many short calls, for which Python lets one thread at a time run, so that threads gain nothing. The
processes are those of a `concurrent.futures.ProcessPoolExecutor`. They stay for a whole diagnosis, so that each keeps
the cache of its predictor. Large objects that jobs refer to are sent once, and all processes read their large arrays
from the same memory.

Starting the processes costs 3 s of processor time, for the import of torch. So jobs run in this process until
`start_after_s` is over, and on until the processes are ready: captures without a fault take 1 s, with a small fault 4 s
(128 × 96 modulator pixels, 32 captures). Where there is a fork server (Linux), it alone imports; this process, which
has threads, is never forked. Measured on two cores beside other programs, the median of four alternating runs with a
pair of faults: 31 s, and 39 s in two processes that are forked for each batch of jobs and lose their caches with it.
"""

from __future__ import annotations

import io
import mmap
import multiprocessing
import os
import pickle
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, TypeVar, cast

from holoview.util.errors import UserError
from holoview.util.memory_limit import VARIABLE, give_back_freed_memory, worker_share, workers_within_memory
from holoview.util.processes import leave_signals_to_parent, signals_blocked

T = TypeVar("T")
FinishedCallback = Callable[[int], None]

_LARGE_BYTES = 1 << 30  # of a process; a larger process gives freed memory back after each job
_POLL_S = 0.2  # Windows notices Ctrl-C between two waits only
_PRELOADED = "holoview.bench.diagnose.pipeline"

_shared_objects: dict[str, Any] = {}  # in a worker process: the objects that jobs refer to by name


class WorkerPool:
    """Runs jobs, picklable functions without arguments, in up to `workers` processes; one means this process.

    start_after_s: age of the pool at which it starts its processes. Use it in a `with` block, which ends them.
    """

    def __init__(self, workers: int, start_after_s: float = 0.0) -> None:
        self.workers = max(1, workers)
        self._start_at = time.monotonic() + start_after_s
        self._shared: dict[str, Any] = {}
        self._prepare: Callable[[], object] | None = None
        self._executor: ProcessPoolExecutor | None = None
        self._ready: Future[None] | None = None
        self._closing, self._is_closed = threading.Lock(), False
        self._store = ArrayStore()

    def __reduce__(self) -> tuple[Any, ...]:
        return WorkerPool, (1,)

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close(kill=kind is not None)

    def share(
        self, objects: Mapping[str, Any], prepare: Callable[[], object] | None = None, needed: float = 0.0
    ) -> None:
        """Names large objects that jobs refer to: each process gets them once.

        prepare: a process calls it first. needed: bytes that its jobs take; there will be no more processes than fit
        into the memory that may be taken.
        """
        self._shared, self._prepare = dict(objects), prepare
        self.workers = workers_within_memory(self.workers, needed)

    def run(
        self,
        jobs: Sequence[Callable[[], T]],
        on_finished: FinishedCallback | None = None,
        check: Callable[[], None] | None = None,
    ) -> list[T]:
        """Results of jobs in their order; raises the exception of the first job that fails.

        on_finished: called with the number of finished jobs. check: called now and then while other processes work; its
        exception ends the run. Raises UserError when a process died.
        """
        results: list[T] = []
        while len(results) < len(jobs) and not (len(jobs) - len(results) > 1 and self._has_processes()):
            results.append(jobs[len(results)]())
            give_back_freed_memory(_LARGE_BYTES)
            _report(on_finished, len(results))
        if len(results) < len(jobs):
            results += self._run_in_processes(jobs[len(results) :], len(results), on_finished, check)
        return results

    def start(self) -> None:
        """Starts the processes now and waits until they are ready."""
        self._start_at = 0.0
        if not self._has_processes() and self._ready is not None:
            wait([self._ready])

    def rest(self) -> None:
        """Ends the processes until several jobs are to be run again, because their caches take memory."""
        if self._ready is not None:
            wait([self._ready])
        self._end_processes(kill=False)
        self._executor = self._ready = None
        self._store.close()
        give_back_freed_memory(_LARGE_BYTES)

    def close(self, kill: bool = False) -> None:
        """Ends the processes for good; kill: in the middle of their jobs."""
        with self._closing:
            self._is_closed = True
        try:
            self._end_processes(kill)
        finally:
            self._store.close()

    def _end_processes(self, kill: bool) -> None:
        if self._executor is None or self._ready is None:
            return
        executor = self._executor
        while kill or not self._ready.done():
            _kill(executor._processes)
            kill = not wait([self._ready], timeout=_POLL_S).done
        processes, manager = executor._processes, cast("threading.Thread | None", executor._executor_manager_thread)
        executor.shutdown(wait=False, cancel_futures=True)
        while manager is not None and manager.is_alive():
            if any(process.exitcode for process in list((processes or {}).values())):
                _kill(processes)  # one that died while it waited for a job keeps the others from their end
            manager.join(_POLL_S)

    def _has_processes(self) -> bool:
        """Whether the processes are ready; starts them when it is time. A closed pool has none: this process works."""
        if self._is_closed or self.workers < 2 or time.monotonic() < self._start_at:
            return False
        if self._ready is None:
            try:
                shared = self._store.store(self._shared)
            except (pickle.PicklingError, AttributeError, TypeError):
                self.workers = 1  # an effect that only this process knows
                return False
            self._ready = Future()
            threading.Thread(target=self._start_processes, args=(shared, self._ready), daemon=True).start()
        return self._ready.done()

    def _start_processes(self, shared: SharedObjects, ready: Future[None]) -> None:
        """Starts the processes, in a thread of its own, since a fork server answers only after its imports."""
        try:
            with signals_blocked():  # this process hears Ctrl-C and ends them
                context = _process_context()
                if sys.platform == "linux":
                    first_process = context.Process(target=os.getpid)  # type: ignore[attr-defined]
                    first_process.start()  # waits until the fork server has imported
                    first_process.join()
                initial = shared, self._prepare, worker_share(self.workers)
                with self._closing:
                    if self._is_closed:
                        return
                    self._executor = ProcessPoolExecutor(
                        self.workers, context, initializer=_prepare_process, initargs=initial
                    )
                first = [self._executor.submit(os.getpid) for _ in range(self.workers)]
            for future in first:
                future.result()
            ready.set_result(None)
        except Exception as error:
            ready.set_exception(error)

    def _run_in_processes(
        self,
        jobs: Sequence[Callable[[], T]],
        finished: int,
        on_finished: FinishedCallback | None,
        check: Callable[[], None] | None,
    ) -> list[T]:
        assert self._executor is not None and self._ready is not None
        names = {id(shared): name for name, shared in self._shared.items()}
        try:
            self._ready.result()
            futures = [self._executor.submit(_run_job, _dump_job(job, names)) for job in jobs]
            pending = set(futures)
            while pending:
                done, pending = wait(pending, timeout=_POLL_S, return_when=FIRST_COMPLETED)
                if check is not None:
                    check()
                for _ in done:
                    finished += 1
                    _report(on_finished, finished)
            return [future.result() for future in futures]
        except BrokenExecutor as error:
            remedy = "--workers 1 works without any; a script that starts them needs `if __name__ == '__main__':`"
            raise UserError("workers", "one died, perhaps of too little memory", remedy=remedy) from error


def _report(on_finished: FinishedCallback | None, count: int) -> None:
    if on_finished is not None:
        on_finished(count)


def _process_context() -> BaseContext:
    if sys.platform != "linux":  # elsewhere, forking a process that has loaded system frameworks isn't safe
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([_PRELOADED])
    return context


class _JobPickler(pickle.Pickler):
    """Pickles shared objects as their names."""

    def __init__(self, file: io.BytesIO, names: Mapping[int, str]) -> None:
        super().__init__(file)
        self._names = names

    def persistent_id(self, obj: Any) -> str | None:
        return self._names.get(id(obj))


class _JobUnpickler(pickle.Unpickler):
    def persistent_load(self, pid: str) -> Any:
        return _shared_objects[pid]


def _dump_job(job: Callable[[], Any], names: Mapping[int, str]) -> bytes:
    buffer = io.BytesIO()
    _JobPickler(buffer, names).dump(job)
    return buffer.getvalue()


def _kill(processes: Mapping[int, BaseProcess] | None) -> None:
    """Ends the processes of an executor, which has None once it is shut down."""
    for process in list((processes or {}).values()):
        process.kill()


def _prepare_process(shared: SharedObjects, prepare: Callable[[], object] | None, memory: str) -> None:
    leave_signals_to_parent()
    os.environ[VARIABLE] = memory
    if prepare is not None:
        prepare()
    _shared_objects.update(shared.load())


def _run_job(job: bytes) -> Any:
    """The result of a job; an exception that can't be sent becomes a RuntimeError with its message."""
    try:
        return _JobUnpickler(io.BytesIO(job)).load()()
    except Exception as error:
        raise _picklable(error) from None
    finally:
        give_back_freed_memory(_LARGE_BYTES)


def _picklable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


_MIN_BYTES = 1 << 20  # smaller arrays are copied
_ALIGNMENT = 64  # of an array in the file, bytes


@dataclass(frozen=True)
class SharedObjects:
    """Pickled objects by name, as another process gets them.

    pickled: all but the large arrays. path: of the file that holds these, with the (first byte, bytes) of each in
    `spans`; None where there are none.
    """

    pickled: bytes
    path: str | None
    spans: tuple[tuple[int, int], ...]

    def load(self) -> dict[str, Any]:
        """The objects. Processes share the pages of their large arrays until they write to them."""
        if self.path is None:
            return dict(pickle.loads(self.pickled))
        with Path(self.path).open("rb") as file:
            pages = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        return dict(pickle.loads(self.pickled, buffers=[pages[first : first + n] for first, n in self.spans]))


class ArrayStore:
    """Holds the file of shared objects until it is closed."""

    def __init__(self) -> None:
        self._file: BinaryIO | None = None
        self._name: str | None = None

    def store(self, objects: Mapping[str, Any]) -> SharedObjects:
        """The objects, ready to be sent to other processes; objects stored before are dropped.

        Raises the exception of pickle for objects that can't be pickled.
        """
        large: list[memoryview] = []

        def stays_in_pickle(buffer: pickle.PickleBuffer) -> bool:
            raw = buffer.raw()
            if raw.nbytes >= _MIN_BYTES:
                large.append(raw)
            return raw.nbytes < _MIN_BYTES

        pickled = pickle.dumps(dict(objects), protocol=5, buffer_callback=stays_in_pickle)
        self.close()
        if not large:
            return SharedObjects(pickled, None, ())
        self._file, path = self._new_file()
        spans = [self._write(buffer) for buffer in large]
        self._file.flush()
        return SharedObjects(pickled, path, tuple(spans))

    def close(self) -> None:
        """Frees the file; processes that have loaded the objects keep them."""
        if self._file is not None:
            self._file.close()
        if self._name is not None:
            Path(self._name).unlink(missing_ok=True)
        self._file = self._name = None

    def _new_file(self) -> tuple[BinaryIO, str]:
        if sys.platform != "linux":
            number, self._name = tempfile.mkstemp(prefix="holoview-")
            return os.fdopen(number, "wb"), self._name
        file = os.fdopen(os.memfd_create("holoview"), "wb")
        return file, f"/proc/{os.getpid()}/fd/{file.fileno()}"

    def _write(self, buffer: memoryview) -> tuple[int, int]:
        assert self._file is not None
        self._file.write(b"\0" * (-self._file.tell() % _ALIGNMENT))
        first = self._file.tell()
        self._file.write(buffer)
        return first, buffer.nbytes
