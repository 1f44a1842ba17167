"""Runs the viewer in a process of its own, and starts it again with the work if that process crashes.

A graphics driver that fails may end the process that uses it, which then can't do anything about it. The process that
supervises loads no driver, and nothing else that takes time to load.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from holoview.commands.console import EXIT_DEVICE_LOST
from holoview.util.processes import end_with_parent, handled_signals, leave

Program = Callable[[Sequence[str]], int]

MOST_CRASHES = 3
"""So many crashes within `CRASH_WINDOW_S` end the viewer for good."""
CRASH_WINDOW_S = 60.0
_UNSUPERVISED = ("-h", "--help", "--offscreen", "--until-image")
_CRASHES = tuple(getattr(signal, f"SIG{name}", 0) for name in ("ABRT", "BUS", "FPE", "ILL", "SEGV", "SYS", "TRAP"))
_WINDOWS_EXCEPTIONS, _WINDOWS_CTRL_C = 0xC0000000, 0xC000013A


def run_commands(words: Sequence[str]) -> int:
    """Runs the command line; returns its exit code. A `Program`, which is imported by the process that runs it."""
    from holoview.commands.cli import main

    return main(words)


def is_supervised(words: Sequence[str]) -> bool:
    """Whether the arguments of `holoview` open a viewer that a person works with."""
    return words[:1] == ["view"] and not any(word in _UNSUPERVISED for word in words)


def supervise(program: Program, words: Sequence[str]) -> int:
    """Calls a program with arguments in a process of its own, again after a crash; returns its exit code.

    program: a function of a module. After a crash it gets `--recover PID` as well, the id of the process that crashed.
    Ctrl-C, SIGTERM and SIGHUP are passed on. The program ends with this process.
    """
    given, crashes = list(words), list[float]()
    while True:
        process = multiprocessing.get_context("spawn").Process(target=_run, args=(program, given))
        with _signals_passed_on(process):
            process.start()
            process.join()
        code = process.exitcode or 0
        if not is_crash(code):
            return code if code >= 0 else 128 - code
        now = time.monotonic()
        crashes = [moment for moment in crashes if now - moment < CRASH_WINDOW_S] + [now]
        if len(crashes) >= MOST_CRASHES:
            _say(f"it crashed {MOST_CRASHES} times within {CRASH_WINDOW_S:.0f} s; the next start offers your work")
            return EXIT_DEVICE_LOST
        _say(f"{_how(code)}; it starts again with your work")
        given = [*words, "--recover", str(process.pid)]


def is_crash(code: int) -> bool:
    """Whether an exit code (negative for a signal) says that the graphics device was lost, or the process crashed."""
    is_exception = code >= _WINDOWS_EXCEPTIONS and code != _WINDOWS_CTRL_C
    return code == EXIT_DEVICE_LOST or is_exception or (code < 0 and -code in _CRASHES)


def _run(program: Program, words: Sequence[str]) -> None:
    """The work of the supervised process."""
    if hasattr(os, "setpgrp"):
        os.setpgrp()  # Ctrl-C in a terminal reaches the process that supervises alone, which passes it on
    end_with_parent()
    leave(program(words))


@contextmanager
def _signals_passed_on(process: Any) -> Iterator[None]:
    def pass_on(number: int) -> None:
        if sys.platform != "win32" and process.pid is not None:  # Windows sends Ctrl-C to both
            with suppress(ProcessLookupError):
                os.kill(process.pid, number)

    with handled_signals(pass_on):
        yield


def _how(code: int) -> str:
    if code == EXIT_DEVICE_LOST:
        return "the graphics device was lost"
    return f"it crashed ({signal.Signals(-code).name if code < 0 else hex(code)})"


def _say(text: str) -> None:
    print(f"holoview: view: {text}", file=sys.stderr, flush=True)
