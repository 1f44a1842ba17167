"""Messages and progress bars on stderr, and Ctrl-C that ends a loop between two steps.

Everything here goes to stderr: stdout holds results only, so that `--json` can be piped.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from holoview.util.progress import ProgressCallback

LINE_INTERVAL_S = 10.0
"""Least time between two progress lines where stderr isn't a terminal."""


def print_stderr(text: str) -> None:
    """Prints a line to stderr at once."""
    print(text, file=sys.stderr, flush=True)


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
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=1, note="")

        def update(done: int, total: int, note: str = "") -> None:
            bar.update(task, completed=done, total=total, note=note)

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
def deferred_interrupt(step: str = "iteration") -> Iterator[Callable[[], bool]]:
    """Defers Ctrl-C in the block; yields a function that tells whether it was pressed. A second Ctrl-C interrupts.

    A loop that asks after each step can end with a complete result. step: what a step is called in the message.
    """
    is_asked = False

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal is_asked
        if is_asked:
            raise KeyboardInterrupt
        is_asked = True
        print_stderr(f"stopping after this {step}; press Ctrl-C again to stop at once")

    previous = signal.signal(signal.SIGINT, handle)
    try:
        yield lambda: is_asked
    finally:
        signal.signal(signal.SIGINT, previous)
