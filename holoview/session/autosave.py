"""Saves a session on a worker thread whenever it changes, so that a crash loses nothing."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Condition, Thread
from typing import Any

from holoview.session.archive import SessionArchive, SessionData
from holoview.session.changes import Change
from holoview.session.editing_session import EditingSession
from holoview.util.errors import UserError

SAVE_DELAY_S = 0.4
"""From an edit until it is saved, so that a drag isn't written at each of its steps."""
_CLOSE_TIMEOUT_S = 30.0
_SAVED_KINDS = frozenset({"system", "drive", "look", "target", "snapshots", "history"})


class Autosave:
    """Saves a session into a folder shortly after each change.

    A save that fails is reported to the user once and tried again at the next change. on_closed: called with the
    folder when the session was closed normally.
    """

    def __init__(self, session: EditingSession, folder: Path, on_closed: Callable[[Path], None]) -> None:
        self.folder = folder
        self._session, self._on_closed = session, on_closed
        self._archive = SessionArchive(folder)
        self._condition = Condition()
        self._pending: SessionData | None = None
        self._is_saving = self._is_closing = self._has_failed = False
        self._remove_listener = session.add_listener(self._queue_save)
        self._thread = Thread(target=self._run, name="holoview: autosave", daemon=True)
        self._thread.start()
        self._queue_save(Change(_SAVED_KINDS))

    def flush(self, timeout_s: float = 30.0) -> bool:
        """Waits until all is saved; returns whether it was in time."""
        with self._condition:
            return self._condition.wait_for(lambda: self._pending is None and not self._is_saving, timeout_s)

    def close(self) -> None:
        """Saves for the last time. The folder of a session without edits is deleted."""
        self._remove_listener()
        with self._condition:
            self._is_closing = True
            self._condition.notify_all()
        self._thread.join(_CLOSE_TIMEOUT_S)
        if len(self._session.history) < 2:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        self._on_closed(self.folder)

    def _queue_save(self, change: Change) -> None:
        """Called on the owner's thread: takes references to the data to save, all of which are immutable."""
        if not change.kinds & _SAVED_KINDS:
            return
        session = self._session
        data = SessionData(session.history, session.history_position, session.snapshots, session.preview_document)
        with self._condition:
            self._pending = data
            self._condition.notify_all()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._pending is not None or self._is_closing)
                if self._pending is None:
                    return
                self._condition.wait_for(lambda: self._is_closing, SAVE_DELAY_S)
                data, self._pending, self._is_saving = self._pending, None, True
            self._save(data)
            with self._condition:
                self._is_saving = False
                self._condition.notify_all()

    def _save(self, data: SessionData) -> None:
        try:
            self._archive.write(data, _metadata(data))
            self._has_failed = False
        except (UserError, OSError) as error:
            if not self._has_failed:
                self._session.call_on_owner(partial(self._session.messages.post_error, error, "autosave"))
            self._has_failed = True


def _metadata(data: SessionData) -> dict[str, Any]:
    document = data.present
    return {"title": f"{document.system.name or 'bench'}: {document.origin}", "when": time.time(), "pid": os.getpid()}
