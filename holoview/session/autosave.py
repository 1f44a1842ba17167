"""A session saved as it changes, and found again when the program died: no edit, pattern or undo step is lost.

sessions/<when-pid>/lock.json      who is writing; gone once the session was closed in good order
sessions/<when-pid>/session.json   and objects/: see archive.py
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Condition, Thread
from typing import Any

import psutil

from holoview.session.archive import SessionArchive, SessionData, read_metadata, read_session
from holoview.session.changes import Change
from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.history import History
from holoview.session.preferences import Preferences, state_folder
from holoview.util.errors import UserError

SAVE_DELAY_S = 0.4
"""From an edit to its being saved, so that a drag isn't written at every step."""
_LOCK = "lock.json"
_SAVED = frozenset({"system", "drive", "look", "target", "snapshots", "history"})


@dataclass(frozen=True)
class SavedSession:
    """A saved session: its folder, a line about it, when it was saved (as `time.time`), the number of its steps."""

    folder: Path
    title: str
    when: float
    steps: int

    def restore(self, wake: Callable[[], None] = lambda: None) -> EditingSession:
        """The session with its undo history; what couldn't be read is told in its messages.

        An optimisation that was running is pinned as a snapshot. Raises UserError when nothing can be read.
        """
        history, snapshots, lost = self._read()
        return _report_unreadable(EditingSession.from_history(history, snapshots, wake), lost)

    def restore_into(self, session: EditingSession) -> None:
        """As `restore`, but an open session becomes the saved one. Raises UserError; then it is as it was."""
        history, snapshots, lost = self._read()
        session.load_history(history, snapshots)
        _report_unreadable(session, lost)

    def _read(self) -> tuple[History, dict[str, Document], list[str]]:
        document, lost = read_session(self.folder)
        snapshots = dict(document.snapshots)
        if document.unfinished is not None:
            snapshots["Unfinished optimisation"] = document.unfinished
        return History.from_steps(list(document.steps), document.position), snapshots, lost


def _report_unreadable(session: EditingSession, lost: list[str]) -> EditingSession:
    for line in lost:
        session.messages.post(f"not restored: {line}", "warning")
    return session


class SessionStore:
    """The user's folder: saved sessions and preferences. folder: where, the platform's state folder when None."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = state_folder() if folder is None else folder
        self.preferences = Preferences(self.folder / "preferences.json")
        self._sessions = self.folder / "sessions"

    def crashed_sessions(self) -> list[SavedSession]:
        """Sessions whose program ended without closing them, newest first."""
        return [
            saved
            for saved in self.saved_sessions()
            if (saved.folder / _LOCK).exists() and not _is_owner_alive(saved.folder)
        ]

    def last_session(self) -> SavedSession | None:
        """The session that was closed last."""
        return next((saved for saved in self.saved_sessions() if not (saved.folder / _LOCK).exists()), None)

    def discard(self, saved: SavedSession) -> None:
        """Deletes a saved session."""
        shutil.rmtree(saved.folder, ignore_errors=True)

    def start_autosave(self, session: EditingSession) -> Autosave:
        """Saves the session as it changes from now on, until the autosave is closed. Raises UserError if it can't."""
        name = f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
        folder = next(path for n in range(10_000) if not (path := self._sessions / f"{name}-{n}").exists())
        try:
            folder.mkdir(parents=True)
            owner = {"pid": os.getpid(), "since": psutil.Process().create_time()}
            (folder / _LOCK).write_text(json.dumps(owner), encoding="utf-8")
        except OSError as error:
            raise UserError(str(folder), f"can't be made: {error.strerror}", remedy="free space there") from error
        return Autosave(session, folder, self._keep_only)

    def _keep_only(self, folder: Path) -> None:
        """Of sessions that were closed, only the one closed last is kept."""
        for saved in self.saved_sessions():
            if saved.folder != folder and not (saved.folder / _LOCK).exists():
                self.discard(saved)

    def saved_sessions(self) -> list[SavedSession]:
        found = []
        for folder in self._sessions.glob("*/"):
            try:
                facts = read_metadata(folder)
                found.append(SavedSession(folder, str(facts["title"]), float(facts["when"]), len(facts["steps"])))
            except (UserError, KeyError, TypeError, ValueError):
                continue  # begun and never saved, or from another version: nothing that can be offered
        return sorted(found, key=lambda saved: -saved.when)


class Autosave:
    """Saves a session on a thread, a moment after it changed. A save that fails is told once, and tried again."""

    def __init__(self, session: EditingSession, folder: Path, closed: Callable[[Path], None]) -> None:
        self.folder = folder
        self._session, self._on_closed = session, closed
        self._archive = SessionArchive(folder)
        self._condition = Condition()
        self._waiting: SessionData | None = None
        self._busy = self._ends = self._failed = False
        self._remove_listener = session.add_listener(self._queue_save)
        self._thread = Thread(target=self._run, name="holoview: autosave", daemon=True)
        self._thread.start()
        self._queue_save(Change(_SAVED))

    def flush(self, timeout_s: float = 30.0) -> bool:
        """Waits until all is saved; whether that was so in time."""
        with self._condition:
            return self._condition.wait_for(lambda: self._waiting is None and not self._busy, timeout_s)

    def close(self) -> None:
        """Saves for the last time and gives the folder up in good order; an unedited session isn't kept."""
        self._remove_listener()
        with self._condition:
            self._ends = True
            self._condition.notify_all()
        self._thread.join(30.0)
        if len(self._session.history) < 2:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        (self.folder / _LOCK).unlink(missing_ok=True)
        self._on_closed(self.folder)

    def _queue_save(self, change: Change) -> None:
        """On the owner's thread: keeps references to what is to be saved, all of it frozen."""
        if not change.kinds & _SAVED:
            return
        session = self._session
        shown = session.preview_document
        document = SessionData(session.history, session.history_position, session.snapshots, shown)
        with self._condition:
            self._waiting = document
            self._condition.notify_all()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._waiting is not None or self._ends)
                if self._waiting is None:
                    return
                self._condition.wait_for(lambda: self._ends, SAVE_DELAY_S)
                document, self._waiting, self._busy = self._waiting, None, True
            self._save(document)
            with self._condition:
                self._busy = False
                self._condition.notify_all()

    def _save(self, document: SessionData) -> None:
        try:
            self._archive.write(document, _metadata(document))
            self._failed = False
        except (UserError, OSError) as error:
            if not self._failed:
                self._session.call_on_owner(lambda error=error: self._session.messages.post_error(error, "autosave"))  # type: ignore[misc]
            self._failed = True


def _metadata(document: SessionData) -> dict[str, Any]:
    state = document.present
    return {"title": f"{state.system.name or 'bench'}: {state.origin}", "when": time.time(), "pid": os.getpid()}


def _is_owner_alive(folder: Path) -> bool:
    """Whether the process that locked a folder is still alive; a process that got its number later isn't it."""
    try:
        owner = json.loads((folder / _LOCK).read_text(encoding="utf-8"))
        return bool(abs(psutil.Process(owner["pid"]).create_time() - owner["since"]) < 1.0)
    except (OSError, ValueError, KeyError, TypeError, psutil.Error):
        return False
