"""Watching a file that another program writes again: noticed once it has stopped changing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread

POLL_INTERVAL_S = 0.4
_Mark = tuple[int, int, int] | None


class FileWatcher:
    """Calls `changed` from its thread when a file is another one than before and stays the same for an interval.

    A file that is missing for a while, since programs write beside it and rename, is waited for. The same content
    again counts as a change, because someone wrote it.
    """

    def __init__(self, path: Path, changed: Callable[[], None], interval_s: float = POLL_INTERVAL_S) -> None:
        self.path = path
        self._changed, self._interval_s = changed, interval_s
        self._end = Event()
        self._known = _mark(path)
        Thread(target=self._run, name=f"holoview: watch {path.name}", daemon=True).start()

    def close(self) -> None:
        """Ends the watch."""
        self._end.set()

    def _run(self) -> None:
        before = self._known
        while not self._end.wait(self._interval_s):
            now = _mark(self.path)
            if now is not None and now == before and now != self._known:
                self._known = now
                self._changed()
            before = now


def _mark(path: Path) -> _Mark:
    """What changes when a file is written; None while there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
