"""Processes and threads: the end of this program, the beginning of others, the processors that they may use.

Signals (Ctrl-C, SIGTERM, SIGHUP) ask the program to end; workers end with their parent; threads may still be at work
when the program ends. The time at which a process began tells it apart from a later process with the same id.

process_cpu_count   processors of the affinity mask, fewer where a container grants less of their time
group_folders       Linux's control groups, which limit the resources of a process
share_the_machine   how torch's threads wait for each other: to be set before torch is loaded
"""

from __future__ import annotations

import gc
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from pathlib import Path
from types import FrameType
from typing import NoReturn

import psutil

_SWITCH_S = 0.0005
_waits_s: list[float] = []  # what held before each of the blocks of `lock_passed_on` that run
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, what `kill` and batch systems send, and what a closed terminal sends."""


class Interrupted(KeyboardInterrupt):
    """Raised in the main thread by one of the signals `ENDING`; `signal` is its number."""

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__(signal.Signals(number).name)
        self.signal = number


def exit_code_of(error: KeyboardInterrupt) -> int:
    """128 + the number of the signal, as shells report it; SIGINT's number for Python's own KeyboardInterrupt."""
    return 128 + (error.signal if isinstance(error, Interrupted) else signal.SIGINT)


class Interruption:
    """Whether a signal has asked a loop to end; calling it tells. signal: its number, 0 if none has."""

    def __init__(self) -> None:
        self.signal = 0

    def __call__(self) -> bool:
        return self.signal != 0

    def ask(self, number: int = signal.SIGINT) -> None:
        """Asks the loop to end, as the signal of that number does. The first one counts."""
        self.signal = self.signal or number

    @property
    def exit_code(self) -> int:
        """The exit code of a program that ended so: 128 + the signal, or 0."""
        return 128 + self.signal if self.signal else 0


@contextmanager
def handled_signals(handle: Callable[[int], None]) -> Iterator[Callable[[], None]]:
    """Calls `handle(number)` in the main thread for each of the signals `ENDING` while the block runs.

    A signal that is ignored (by `nohup`, or in the background of a shell) stays so. Yields a function that installs the
    handlers again, for where a library has replaced them. In another thread than the main one it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    before = {number: signal.getsignal(number) for number in ENDING}
    numbers = [number for number, handler in before.items() if handler not in (signal.SIG_IGN, None)]

    def on_signal(number: int, frame: FrameType | None) -> None:
        handle(number)

    def install() -> None:
        for number in numbers:
            signal.signal(number, on_signal)

    install()
    try:
        yield install
    finally:
        for number in numbers:
            signal.signal(number, before[number])


def raise_interrupted(number: int) -> None:
    """A handler for `handled_signals`: all signals end the program as Ctrl-C does."""
    raise Interrupted(number)


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Holds the signals `ENDING` back in this thread until the block ends, and for good in processes that it starts.

    A process with these signals blocked is ended by `kill`. Where there are no signal masks (Windows) it does nothing;
    such a process can ignore signals only once it runs.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def garbage_kept() -> Iterator[None]:
    """Collects no garbage inside the block."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@contextmanager
def lock_passed_on() -> Iterator[None]:
    """Lets threads that want Python's lock wait for half a millisecond in place of five while the block runs.

    For long work of Python's own beside a window, whose thread gives the lock away and wants it again a hundred times
    in a frame.
    """
    _waits_s.append(sys.getswitchinterval())
    sys.setswitchinterval(_SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(_waits_s.pop())  # of blocks in several threads, the last to end restores the first value


def leave_signals_to_parent() -> None:
    """The first step of a worker process: it ignores signals that its parent handles, and ends with its parent."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    end_with_parent()


def end_with_parent() -> None:
    """Ends this process, one of `multiprocessing`, when the process that started it is gone, even if that was killed.

    Without it, workers of a killed program wait for work for ever, with all their memory.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:  # its name has no `PREFIX`: nobody waits for it
        threading.Thread(target=_exit_after, args=(parent.sentinel,), name="parent of holoview", daemon=True).start()


def _exit_after(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


# --- the end beside threads that work ---------------------------------------------------------------------------------


_AT_THE_END_S, _BEFORE_LEAVING_S = 10.0, 0.5
PREFIX = "holoview: "
"""Names of threads that this program starts for work in the background begin with it."""


def wait_for_threads(timeout_s: float, prefix: str = PREFIX) -> bool:
    """Waits until the daemon threads whose names begin so have ended; returns whether they have.

    A program that ends while one of them is inside a library written in C++ is aborted: the interpreter ends the thread
    where that library doesn't expect it.
    """
    until = time.monotonic() + timeout_s
    threads = [t for t in threading.enumerate() if t.daemon and t.name.startswith(prefix)]
    for thread in threads:
        thread.join(max(until - time.monotonic(), 0.0))
    return not any(thread.is_alive() for thread in threads)


def is_left() -> bool:
    """Whether this process ends by `leave`, as processes do that another process supervises."""
    return multiprocessing.parent_process() is not None


def last_work_s() -> float:
    """Seconds that work which was cancelled has to end before this process does."""
    return _BEFORE_LEAVING_S if is_left() else _AT_THE_END_S


def leave(code: int) -> NoReturn:
    """Ends this process at once with an exit code, whatever its threads do; call it when all is saved and closed.

    The usual end of Python waits for the threads of pools until these have done all that they were given, and collects
    every object: seconds, and more on a busy machine, for memory that the system takes back in any case.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.flush()
    os._exit(code)


# --- when a process began ---------------------------------------------------------------------------------------------


_PROC = Path("/proc")
_AFTER_NAME = (
    19  # number of the field "starttime" of /proc/PID/stat behind the name, which may hold spaces and brackets
)


def process_start(pid: int, proc: Path = _PROC) -> str:
    """When the process with this id began. Raises psutil.Error if there is none.

    On Linux in ticks since the machine was started, with that start's name: a clock that is set while programs run
    changes neither. Elsewhere in seconds of the clock, as the system noted it. proc: the folder of the processes.
    """
    try:
        boot = (proc / "sys" / "kernel" / "random" / "boot_id").read_text(encoding="ascii").strip()
        text = (proc / str(pid) / "stat").read_text(encoding="utf-8", errors="replace")
        return f"{text.rpartition(')')[2].split()[_AFTER_NAME]} ticks of {boot}"
    except (OSError, IndexError):
        return f"{psutil.Process(pid).create_time():.2f} s"


# --- how many processors ----------------------------------------------------------------------------------------------


def process_cpu_count() -> int:
    """The number of CPUs in this process's affinity mask, or fewer where a container grants it less of their time.

    Python 3.13's `os.process_cpu_count` knows the mask alone.
    """
    quota = cpu_quota()
    return affine_cpu_count() if quota is None else min(affine_cpu_count(), max(1, math.ceil(quota)))


def affine_cpu_count() -> int:
    """The number of CPUs in this process's affinity mask, which batch systems restrict; else all of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cpu_quota(root: Path = Path("/")) -> float | None:
    """How many CPUs' time Linux grants this process's control groups, the least of all; None without a limit.

    root: of the file system. Reads cgroup 2 (`cpu.max`) and cgroup 1 (`cpu.cfs_quota_us`).
    """
    quotas = [
        quota
        for folder in group_folders(root / MOUNT, root / MEMBERSHIP, "cpu")
        if (quota := _quota_of(folder)) is not None
    ]
    return min(quotas, default=None)


def _quota_of(folder: Path) -> float | None:
    """The limit that one group states, in CPUs."""
    try:
        if (folder / "cpu.max").exists():
            quota, period = (folder / "cpu.max").read_text(encoding="utf-8").split()
        else:
            names = ("cpu.cfs_quota_us", "cpu.cfs_period_us")
            quota, period = (str(int((folder / name).read_text(encoding="utf-8"))) for name in names)
        return None if quota in ("max", "-1") else int(quota) / int(period)
    except (OSError, ValueError, ZeroDivisionError):
        return None


# --- control groups ---------------------------------------------------------------------------------------------------


MOUNT = Path("sys/fs/cgroup")
MEMBERSHIP = Path("proc/self/cgroup")


def group_folders(mount: Path, membership: Path, controller: str) -> Iterator[Path]:
    """The folders of this process's groups of a controller, versions 1 and 2, and of those that contain them.

    mount: where the groups are mounted. membership: the file that names them. controller: such as "memory". In a
    container, the folders above its own group aren't seen, and its own is the root of the mount.
    """
    for line in read_lines(membership):
        _, controllers, name = line.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        top = mount / controllers if (mount / controllers).is_dir() else mount / controller
        folder = top / name.lstrip("/")
        yield from (folder, *folder.parents[: len(folder.parts) - len(top.parts)])


def read_lines(path: Path) -> list[str]:
    """The lines of a file of the kernel; none where it can't be read."""
    try:
        return path.read_bytes().decode("ascii").splitlines()
    except (OSError, UnicodeDecodeError):
        return []


def environment_of_python() -> dict[str, str]:
    """The environment of a further Python, which finds this package as this one does."""
    package = str(Path(__file__).resolve().parents[2])
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))}


# --- OpenMP -----------------------------------------------------------------------------------------------------------

# An operation of torch ends when all of its threads have done their part. GNU's OpenMP lets those that are ready spin
# for about 10 ms before they sleep, which is the fastest where each has a core of its own. Where other programs run,
# the threads that spin take the time of those that they wait for.


SPIN_COUNT = 1000
"""Turns of the waiting loop before a thread sleeps: some tens of microseconds, as long as waking it takes."""


def share_the_machine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Lets OpenMP's threads sleep early, and starts no more of them, and of Mesa's, than a container grants CPUs.

    environment: where to set this; variables that are set already stay as they are.
    """
    if "OMP_WAIT_POLICY" not in environment:
        environment.setdefault("GOMP_SPINCOUNT", str(SPIN_COUNT))
    granted = process_cpu_count()
    if granted < affine_cpu_count():
        environment.setdefault("OMP_NUM_THREADS", str(granted))
        environment.setdefault("LP_NUM_THREADS", str(granted))  # of Mesa's renderer on the processor
