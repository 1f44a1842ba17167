"""Polls a file and reports when another program has rewritten it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread

POLL_INTERVAL_S = 0.4
_Signature = tuple[int, int, int] | None


class FileWatcher:
    """Calls `on_change` on its own thread when a file was rewritten and then stayed the same for one interval.

    A file may be missing for a while, as programs replace files by renaming. Rewriting the same content counts as a
    change.
    """

    def __init__(self, path: Path, on_change: Callable[[], None], interval_s: float = POLL_INTERVAL_S) -> None:
        self.path = path
        self._on_change, self._interval_s = on_change, interval_s
        self._is_closed = Event()
        self._reported = _signature(path)
        Thread(target=self._run, name=f"holoview: watch {path.name}", daemon=True).start()

    def close(self) -> None:
        """Ends the thread."""
        self._is_closed.set()

    def _run(self) -> None:
        previous = self._reported
        while not self._is_closed.wait(self._interval_s):
            current = _signature(self.path)
            if current is not None and current == previous and current != self._reported:
                self._reported = current
                self._on_change()
            previous = current


def _signature(path: Path) -> _Signature:
    """Modification time, size and inode of a file, one of which changes when it is written; None if it is missing."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
