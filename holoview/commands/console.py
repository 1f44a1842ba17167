"""Exit codes, standard output and error, messages, progress bars, and signals that end a loop between two steps.

stdout holds results only, so that `--json` can be piped. Nothing that is printed acts on the terminal, and no failure
to print ends the work: a text may quote a file, so it is made `printable`; a reader that has gone (`| head -1`), a
terminal that was closed or a full disk behind a redirection doesn't end a computation, and what follows is dropped.

Exit codes besides 0 are below; a program that SIGINT (Ctrl-C), SIGTERM or SIGHUP ends returns 128 + the signal's
number, as shells report it: 130, 143 or 129, see `holoview.util.processes`.
"""

from __future__ import annotations

import errno
import io
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from holoview.util.processes import Interrupted, Interruption, handled_signals
from holoview.util.progress import ProgressCallback
from holoview.util.text import printable, printable_lines

EXIT_FAILED = 1
"""The command was carried out in part: what failed is in the file that it wrote, and named on stderr."""

EXIT_USER_ERROR = 2
"""The command wasn't carried out: a mistake of the user, or no memory or disk space. One line on stderr says which."""

EXIT_DEVICE_LOST = 3
"""The graphics device was lost, or the viewer crashed again and again. Work in the viewer is saved."""


# --- streams ---


class SafeStream:
    """A text stream that never raises. error: why it took no more, None while all went well."""

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Writes a text, or drops it where that has failed."""
        self._attempt("write", text)
        return len(text)

    def flush(self) -> None:
        """Passes on what was written."""
        self._attempt("flush")

    def isatty(self) -> bool:
        """Whether it is a terminal that still takes text."""
        with suppress(OSError, ValueError):
            return self._stream is not None and self.error is None and self._stream.isatty()
        return False

    def _attempt(self, method: str, *arguments: str) -> None:
        if self._stream is None or self.error is not None:
            return
        try:
            getattr(self._stream, method)(*arguments)
        except OSError as error:
            self.error = error
            self._discard_rest()
        except ValueError as error:  # it was closed
            self.error = OSError(errno.EBADF, str(error))

    def _discard_rest(self) -> None:
        """Leads the stream to nowhere, so that Python's flush at exit doesn't fail again."""
        assert self._stream is not None
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class PrintableStream(SafeStream):
    """A `SafeStream`, `safe`, to which every line is passed as `printable`."""

    def __init__(self, safe: SafeStream) -> None:
        super().__init__(safe)  # type: ignore[arg-type]
        self.safe = safe

    def write(self, text: str) -> int:
        """Writes the text with everything but its ends of lines made printable."""
        self.safe.write(printable_lines(text))
        return len(text)


@contextmanager
def console_streams() -> Iterator[tuple[SafeStream, SafeStream]]:
    """Makes standard output and error safe and printable in the block; yields the safe streams."""
    before = sys.stdout, sys.stderr
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # "étendue" on a terminal that has no é
    safe = SafeStream(sys.stdout), SafeStream(sys.stderr)
    sys.stdout, sys.stderr = (PrintableStream(stream) for stream in safe)
    try:
        yield safe
    finally:
        for stream in safe:
            stream.flush()
        sys.stdout, sys.stderr = before


def raw_stderr() -> Any:
    """Standard error for what moves the cursor itself, such as a progress bar."""
    return sys.stderr.safe if isinstance(sys.stderr, PrintableStream) else sys.stderr


# --- messages, progress, signals ---


LINE_INTERVAL_S = 10.0
"""Least time between two progress lines where stderr isn't a terminal."""


def print_stderr(text: str) -> None:
    """Prints a line to stderr at once; lost where stderr is closed."""
    if sys.stderr is not None:  # print would take stdout instead
        print(text, file=sys.stderr, flush=True)


def print_json(value: Any) -> None:
    """Prints a result for programs to stdout, as JSON in which every character can be shown on a terminal."""
    text = json.dumps(value, indent=2, ensure_ascii=False)
    print("".join(c if c == "\n" or printable(c) == c else json.dumps(c)[1:-1] for c in text))


@contextmanager
def progress_bar(title: str) -> Iterator[ProgressCallback]:
    """Shows a progress bar on stderr while the block runs; yields the function that updates it.

    Where stderr isn't a terminal, it prints a line every LINE_INTERVAL_S and after the last step instead.
    """
    if not sys.stderr.isatty():
        yield _line_progress(title)
        return
    from rich.console import (
        Console,  # here: most commands never show a bar, and importing rich takes a tenth of a second
    )
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=30),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[note]}", markup=False),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(file=raw_stderr())) as bar:
        task = bar.add_task(printable(title), total=1, note="")

        def update(done: int, total: int, note: str = "") -> None:
            bar.update(task, completed=done, total=total, note=printable(note))

        yield update


def _line_progress(title: str) -> ProgressCallback:
    next_line = time.monotonic() + LINE_INTERVAL_S

    def update(done: int, total: int, note: str = "") -> None:
        nonlocal next_line
        if time.monotonic() >= next_line or done == total:
            print_stderr(f"{title}: {done}/{total} {note}".rstrip())
            next_line = time.monotonic() + LINE_INTERVAL_S

    return update


@contextmanager
def deferred_interrupt(step: str = "iteration") -> Iterator[Interruption]:
    """Defers Ctrl-C, SIGTERM and SIGHUP in the block; yields whether one came. A second one interrupts.

    A loop that asks after each step can end with a complete result. step: the name of a step in the message.
    """
    interruption = Interruption()

    def handle(number: int) -> None:
        if interruption():
            raise Interrupted(number)
        interruption.ask(number)
        print_stderr(f"stopping after this {step}; press Ctrl-C again to stop at once")

    with handled_signals(handle):
        yield interruption
