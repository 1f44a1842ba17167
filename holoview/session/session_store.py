"""The folder of saved sessions: finds the last session and those that a crash left, and restores them.

sessions/<time>-<pid>-<n>/lock.json      names the process that writes; deleted when the session is closed normally
sessions/<time>-<pid>-<n>/session.json   and objects/: see `holoview.session.archive`
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from holoview.session.archive import read_metadata, read_session
from holoview.session.autosave import Autosave
from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.history import History
from holoview.session.preferences import Preferences, state_folder
from holoview.util.errors import UserError

_LOCK = "lock.json"
_MAX_FOLDERS_A_SECOND = 10_000


@dataclass(frozen=True)
class SavedSession:
    """A saved session: its folder, a title, when it was saved (as `time.time`), and the number of its history steps."""

    folder: Path
    title: str
    when: float
    steps: int

    def restore(self, wake: Callable[[], None] = lambda: None) -> EditingSession:
        """Reads the session with its undo history; what can't be read is reported in its messages.

        The result of an unfinished optimisation becomes a snapshot. Raises UserError when nothing can be read.
        """
        history, snapshots, unreadable = self._read()
        return _report_unreadable(EditingSession.from_history(history, snapshots, wake), unreadable)

    def restore_into(self, session: EditingSession) -> None:
        """As `restore`, into an open session. Raises UserError; then that session is unchanged."""
        history, snapshots, unreadable = self._read()
        session.load_history(history, snapshots)
        _report_unreadable(session, unreadable)

    def _read(self) -> tuple[History, dict[str, Document], list[str]]:
        data, unreadable = read_session(self.folder)
        snapshots = dict(data.snapshots)
        if data.unfinished is not None:
            snapshots["Unfinished optimisation"] = data.unfinished
        return History.from_steps(list(data.steps), data.position), snapshots, unreadable


def _report_unreadable(session: EditingSession, unreadable: list[str]) -> EditingSession:
    for line in unreadable:
        session.messages.post(f"not restored: {line}", "warning")
    return session


class SessionStore:
    """Saved sessions and preferences of the user, in `folder`; None is the platform's folder for state."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = state_folder() if folder is None else folder
        self.preferences = Preferences(self.folder / "preferences.json")
        self._sessions = self.folder / "sessions"
        self._taken_over: list[SavedSession] = []

    def saved_sessions(self) -> list[SavedSession]:
        """All sessions that were saved at least once, newest first."""
        sessions = []
        for folder in self._sessions.glob("*/"):
            try:
                table = read_metadata(folder)
                sessions.append(SavedSession(folder, str(table["title"]), float(table["when"]), len(table["steps"])))
            except (UserError, KeyError, TypeError, ValueError):
                continue  # never saved, or written by another version: can't be offered
        return sorted(sessions, key=lambda saved: -saved.when)

    def crashed_sessions(self) -> list[SavedSession]:
        """Sessions whose process ended without closing them, newest first."""
        return [s for s in self.saved_sessions() if _is_locked(s.folder) and not _is_owner_alive(s.folder)]

    def last_session(self) -> SavedSession | None:
        """The session that was closed last."""
        return next((saved for saved in self.saved_sessions() if not _is_locked(saved.folder)), None)

    def take_over(self, pid: int) -> EditingSession | None:
        """The session of a process that crashed, which is this process's from now on; None if it saved none.

        It stays saved until the session that continues it is closed. Raises UserError when nothing can be read.
        """
        saved = next((saved for saved in self.crashed_sessions() if _owner(saved.folder)["pid"] == pid), None)
        if saved is None:
            return None
        session = saved.restore()
        _lock(saved.folder)
        self._taken_over.append(saved)
        session.messages.post(f"The viewer crashed. This is your work, with {len(session.history) - 1} edits to undo.")
        return session

    def discard(self, saved: SavedSession) -> None:
        """Deletes a saved session."""
        shutil.rmtree(saved.folder, ignore_errors=True)

    def start_autosave(self, session: EditingSession) -> Autosave:
        """Saves the session whenever it changes, until the autosave is closed. Raises UserError if it can't."""
        name = f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
        numbers = range(_MAX_FOLDERS_A_SECOND)
        folder = next(path for n in numbers if not (path := self._sessions / f"{name}-{n}").exists())
        try:
            folder.mkdir(parents=True)
            _lock(folder)
        except OSError as error:
            raise UserError(str(folder), f"can't be made: {error.strerror}", remedy="free space there") from error
        return Autosave(session, folder, self._on_closed)

    def _on_closed(self, folder: Path) -> None:
        """Unlocks the folder of a session that was closed, and deletes sessions that were closed earlier."""
        (folder / _LOCK).unlink(missing_ok=True)
        for saved in self.saved_sessions():
            if saved.folder != folder and (saved in self._taken_over or not _is_locked(saved.folder)):
                self.discard(saved)


def _is_locked(folder: Path) -> bool:
    return (folder / _LOCK).exists()


def _lock(folder: Path) -> None:
    """Notes that this process writes to a folder."""
    owner = {"pid": os.getpid(), "since": psutil.Process().create_time()}
    (folder / _LOCK).write_text(json.dumps(owner), encoding="utf-8")


def _owner(folder: Path) -> dict[str, Any]:
    """The process that locked a folder. Raises OSError and ValueError where that can't be read."""
    owner = json.loads((folder / _LOCK).read_text(encoding="utf-8"))
    if not isinstance(owner, dict):
        raise ValueError("not a table")
    return owner


def _is_owner_alive(folder: Path) -> bool:
    """Whether the process that locked a folder still runs; the start time tells apart a later process with its id."""
    try:
        owner = _owner(folder)
        return bool(abs(psutil.Process(owner["pid"]).create_time() - owner["since"]) < 1.0)
    except (OSError, ValueError, KeyError, TypeError, psutil.Error):
        return False
