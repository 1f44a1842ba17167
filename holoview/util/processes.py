"""The end of this program, and the beginning of others.

Signals (Ctrl-C, SIGTERM, SIGHUP) ask the program to end; workers end with their parent; threads may still be at work
when the program ends. The time at which a process began tells it apart from a later process with the same id.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from pathlib import Path
from types import FrameType
from typing import NoReturn

import psutil

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, what `kill` and batch systems send, and what a closed terminal sends."""


class Interrupted(KeyboardInterrupt):
    """Raised in the main thread by one of the signals `ENDING`; `signal` is its number."""

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__(signal.Signals(number).name)
        self.signal = number


def exit_code_of(error: KeyboardInterrupt) -> int:
    """128 + the number of the signal, as shells report it; that of SIGINT for Python's own KeyboardInterrupt."""
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

    Such a process is ended by `kill`. Where there are no signal masks (Windows) it does nothing; such a process can
    ignore signals only once it runs.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
    if parent is not None:  # the thread isn't named as one with work to wait for (`util.threads`)
        threading.Thread(target=_exit_after, args=(parent.sentinel,), name="parent of holoview", daemon=True).start()


def _exit_after(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


# --- the end beside threads that work ---------------------------------------------------------------------------------


_AT_THE_END_S, _BEFORE_LEAVING_S = 10.0, 1.0
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
    """Whether this process ends by `leave`: one that another process supervises."""
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
