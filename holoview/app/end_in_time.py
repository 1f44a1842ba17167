"""Ends a viewer that was asked to end while its window's thread is inside a graphics driver, which nothing interrupts.

A driver that compiles a shader or draws a large picture in software can keep a thread for many seconds; Python takes
signals only after that.
"""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from holoview.util.processes import ENDING, is_left, leave

GRACE_S = 2.0
"""Seconds from the signal that the window's thread has to close the window in good order."""


@contextmanager
def end_in_time(save: Callable[[], bool], grace_s: float = GRACE_S) -> Iterator[None]:
    """While the block runs, a signal that asks the viewer to end does so after `grace_s`, if the block still runs then.

    Only where this process may be left so (`util.threads.is_left`), and on its main thread. save: called on another
    thread, saves the work; tells whether that worked and nothing else has to be done first, such as switching lasers
    off. Otherwise the block goes on.
    """
    if not is_left():
        yield
        return
    over = Event()
    reading, writing = socket.socketpair()
    with reading, writing:
        writing.setblocking(False)
        watch = Thread(target=_watch, args=(reading, over, save, grace_s), name="end of viewer", daemon=True)
        watch.start()
        before = signal.set_wakeup_fd(writing.fileno(), warn_on_full_buffer=False)
        try:
            yield
        finally:
            over.set()
            signal.set_wakeup_fd(before)
            writing.close()  # ends the watch, if it still reads
            watch.join()


def _watch(reading: socket.socket, over: Event, save: Callable[[], bool], grace_s: float) -> None:
    """Waits for a signal, whose number the interpreter writes at once, and then for the end of the block."""
    while (number := reading.recv(1)) and number[0] not in ENDING:
        pass
    if number and not over.wait(grace_s) and save():
        leave(0 if number[0] == signal.SIGINT else 128 + number[0])
