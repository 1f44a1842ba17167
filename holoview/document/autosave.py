"""Saves a session on a worker thread whenever it changes, so that a crash loses nothing."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Condition, Lock, Thread
from typing import Any

from holoview.document.archive import SessionArchive, SessionData
from holoview.document.changes import Change
from holoview.document.editing_session import EditingSession
from holoview.document.unfinished_optimisation import unfinished_optimisation
from holoview.util.errors import UserError

SAVE_DELAY_S = 0.4
"""From an edit until it is saved, so that a drag isn't written at each of its steps."""
RETRY_S = 2.0
"""From a save that failed until it is tried again."""
_CLOSE_TIMEOUT_S = 30.0
_SAVED_KINDS = frozenset({"system", "drive", "look", "target", "snapshots", "history", "choices"})


class Autosave:
    """Saves a session into a folder shortly after each change.

    A save that fails is told to the user, in a message and as the session's `save_problem`, and tried again until it
    succeeds; then all edits made meanwhile are saved too. open_folder: makes the folder, before each save; it raises
    WriteError. on_closed: called when the session was closed normally, with whether it has edits to keep.
    """

    def __init__(
        self,
        session: EditingSession,
        folder: Path,
        open_folder: Callable[[], None],
        on_closed: Callable[[bool], None],
    ) -> None:
        self.folder = folder
        self._session, self._open_folder, self._on_closed = session, open_folder, on_closed
        self._archive = SessionArchive(folder)
        self._condition, self._closing = Condition(), Lock()
        self._is_closed = False
        self._unsaved: Exception | None = None
        self._pending: SessionData | None = None
        self._failure: Exception | None = None
        self._attempts = 0
        self._is_urgent = self._is_saving = self._is_closing = False
        self._remove_listener = session.add_listener(self._queue_save)
        self._thread = Thread(target=self._run, name="holoview: autosave", daemon=True)
        self._thread.start()
        self._queue_save(Change(_SAVED_KINDS))

    def flush(self, timeout_s: float = 30.0) -> bool:
        """Saves now and waits for it; returns whether all is saved."""
        with self._condition:
            self._is_urgent = True
            self._condition.notify_all()
            enough = self._attempts + (2 if self._is_saving else 1)  # the present one may be of what was there before
            self._condition.wait_for(lambda: self._pending is None or self._attempts >= enough, timeout_s)
            return self._pending is None

    def close(self) -> Exception | None:
        """Saves for the last time; returns why that failed, None if all is saved.

        The folder of a session without edits is deleted. What was saved before a failure is kept as after a crash. May
        be called on any thread, and again, which says the same.
        """
        with self._closing:
            if not self._is_closed:
                self._unsaved, self._is_closed = self._close(), True
            return self._unsaved

    def _close(self) -> Exception | None:
        self._remove_listener()
        with self._condition:
            self._is_closing = True
            self._condition.notify_all()
        self._thread.join(_CLOSE_TIMEOUT_S)
        has_edits = len(self._session.history) > 1
        if has_edits and self._pending is not None:
            return self._failure or TimeoutError(f"the disk took more than {_CLOSE_TIMEOUT_S:g} s")
        self._on_closed(has_edits)
        return None

    def _queue_save(self, change: Change) -> None:
        """Called on the owner's thread: takes references to the data to save, all of which are immutable."""
        if not change.kinds & _SAVED_KINDS:
            return
        session = self._session
        data = SessionData(
            session.history,
            session.history_position,
            session.snapshots,
            unfinished_optimisation(session),
            session.optimisation_choices,
        )
        with self._condition:
            self._pending = data
            self._condition.notify_all()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._pending is not None or self._is_closing)
                if self._pending is None:
                    return
                delay_s = SAVE_DELAY_S if self._failure is None else RETRY_S
                self._condition.wait_for(lambda: self._is_closing or self._is_urgent, delay_s)
                data, is_last = self._pending, self._is_closing
                self._is_urgent, self._is_saving = False, True
            failure = self._try_to_save(data)
            with self._condition:
                self._tell(failure)
                self._failure, self._is_saving = failure, False
                self._attempts += 1
                if failure is None and self._pending is data:
                    self._pending = None
                self._condition.notify_all()
                if is_last and failure is not None:
                    return

    def _try_to_save(self, data: SessionData) -> Exception | None:
        """Saves; returns the exception of a save that failed, whatever it is, since the next one may succeed."""
        try:
            self._open_folder()
            self._archive.write(data, _metadata(data))
        except Exception as error:
            return error
        return None

    def _tell(self, failure: Exception | None) -> None:
        """Has the owner tell the user about the first failure of several, and about its end."""
        if (failure is None) != (self._failure is None):
            self._session.call_on_owner(partial(_tell_user, self._session, failure))


def _tell_user(session: EditingSession, failure: Exception | None) -> None:
    session.save_problem = "" if failure is None else str(failure)
    if failure is None:
        session.messages.post("autosave: your work is saved again")
    elif isinstance(failure, UserError):
        session.messages.post(f"autosave: your work isn't saved, which is tried again and again: {failure}", "error")
    else:
        session.messages.post_error(failure, "autosave: your work isn't saved")


def _metadata(data: SessionData) -> dict[str, Any]:
    document = data.present
    return {"title": f"{document.system.name or 'bench'}: {document.origin}", "when": time.time(), "pid": os.getpid()}
