"""Messages and progress bars on stderr, JSON on stdout, and signals that end a loop between two steps.

stdout holds results only, so that `--json` can be piped.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from holoview.commands.streams import raw_stderr
from holoview.util.processes import Interrupted, Interruption, handled_signals
from holoview.util.progress import ProgressCallback
from holoview.util.text import printable

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

    A loop that asks after each step can end with a complete result. step: what a step is called in the message.
    """
    interruption = Interruption()

    def handle(number: int) -> None:
        if interruption():
            raise Interrupted(number)
        interruption.ask(number)
        print_stderr(f"stopping after this {step}; press Ctrl-C again to stop at once")

    with handled_signals(handle):
        yield interruption
