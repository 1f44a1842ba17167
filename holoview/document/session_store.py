"""The folder of saved sessions: finds the last session and those that a crash left, and restores them.

sessions/<time>-<pid>-<n>/lock.json      names the process that writes; deleted when the session is closed normally
sessions/<time>-<pid>-<n>/session.json   and objects/: see `holoview.document.archive`
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from holoview.document.archive import SESSION_FILE, SessionData, is_of_other_version, read_metadata, read_session
from holoview.document.autosave import Autosave
from holoview.document.damaged_state import is_aside, set_aside
from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.history import History
from holoview.document.preferences import Preferences, state_folder
from holoview.document.unfinished_optimisation import UnfinishedOptimisation, continue_optimisation
from holoview.document.view_settings_table import finite, text
from holoview.util.errors import UserError
from holoview.util.file_writer import WriteError, make_folder, write_file
from holoview.util.processes import process_start

_LOCK = "lock.json"
_MAX_FOLDERS_A_SECOND = 10_000
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError)  # of a damaged lock


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
        session, _ = self.restore_with_unfinished(wake)
        return session

    def restore_with_unfinished(
        self, wake: Callable[[], None] = lambda: None
    ) -> tuple[EditingSession, UnfinishedOptimisation | None]:
        """As `restore`, with the optimisation that was running."""
        data, history, snapshots, unreadable = self._read()
        session = EditingSession.from_history(history, snapshots, wake)
        session.choose_optimisation(data.choices)
        return _report_unreadable(session, unreadable), data.unfinished

    def restore_into(self, session: EditingSession) -> None:
        """As `restore`, into an open session. Raises UserError; then that session is unchanged."""
        data, history, snapshots, unreadable = self._read()
        session.load_history(history, snapshots)
        session.choose_optimisation(data.choices)
        _report_unreadable(session, unreadable)

    def _read(self) -> tuple[SessionData, History, dict[str, Document], list[str]]:
        """What is saved; its history; its snapshots, with an unfinished optimisation; and what can't be read."""
        data, unreadable = read_session(self.folder)
        snapshots = dict(data.snapshots)
        if data.unfinished is not None:
            snapshots["Unfinished optimisation"] = data.unfinished.best
        return data, History.from_steps(list(data.steps), data.position), snapshots, unreadable


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
        found = map(self._saved_session, self._folders())
        return sorted((saved for saved in found if saved is not None), key=lambda saved: -saved.when)

    def crashed_sessions(self) -> list[SavedSession]:
        """Sessions whose process ended without closing them, newest first."""
        return [s for s in self.saved_sessions() if _is_locked(s.folder) and not _is_owner_alive(s.folder)]

    def last_session(self) -> SavedSession | None:
        """The session that was closed last."""
        return next((saved for saved in self.saved_sessions() if not _is_locked(saved.folder)), None)

    def take_over(self, pid: int) -> EditingSession | None:
        """The session of a process that crashed, which is this process's from now on; None if it saved none.

        It stays saved until the session that continues it is closed. An optimisation that was running goes on. Raises
        UserError when nothing can be read.
        """
        saved = next((saved for saved in self.crashed_sessions() if _owner_pid(saved.folder) == pid), None)
        if saved is None:
            return None
        session, unfinished = saved.restore_with_unfinished()
        with suppress(WriteError):  # on a full disk; it is offered again if this process crashes too
            _lock(saved.folder)
        self._taken_over.append(saved)
        session.messages.post(f"The viewer crashed. This is your work, with {len(session.history) - 1} edits to undo.")
        if unfinished is not None:  # once the window can be told of its progress
            session.call_on_owner(partial(continue_optimisation, session, unfinished))
        return session

    def set_damaged_aside(self) -> list[str]:
        """Renames sessions whose description can't be read, of programs that have ended; a line about each."""
        lines = []
        for folder in self._folders():
            is_damaged = (folder / SESSION_FILE).exists() and not is_of_other_version(folder)
            if is_damaged and self._saved_session(folder) is None and not _is_owner_alive(folder):
                lines.append(self.set_aside(folder))
        return lines

    def set_aside(self, folder: Path) -> str:
        """Renames the folder of a session that can't be restored, so that it is kept and not offered; says so."""
        return f"saved session: {set_aside(folder)}"

    def discard(self, saved: SavedSession) -> None:
        """Deletes a saved session."""
        shutil.rmtree(saved.folder, ignore_errors=True)

    def start_autosave(self, session: EditingSession) -> Autosave:
        """Saves the session whenever it changes, until the autosave is closed."""
        folder = self._new_folder()
        return Autosave(session, folder, partial(_open_folder, folder), partial(self._on_closed, folder))

    def _new_folder(self) -> Path:
        """A name for a folder; another session of this process may have got it within this second."""
        name = f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
        numbers = range(_MAX_FOLDERS_A_SECOND)
        folder = next(path for n in numbers if not (path := self._sessions / f"{name}-{n}").exists())
        with suppress(OSError):  # each save tries again
            folder.mkdir(parents=True)
        return folder

    def _folders(self) -> list[Path]:
        try:
            return [folder for folder in self._sessions.iterdir() if folder.is_dir() and not is_aside(folder)]
        except OSError:  # there are none, or it can't be looked into
            return []

    def _saved_session(self, folder: Path) -> SavedSession | None:
        """The session in a folder; None where there is none that can be offered."""
        try:
            table = read_metadata(folder)
            title, when, steps = text(table["title"]), finite(table["when"]), table["steps"]
            time.localtime(when)
            return SavedSession(folder, title, when, len(steps))
        except (UserError, KeyError, TypeError, ValueError, OverflowError, OSError):
            return None

    def _on_closed(self, folder: Path, has_edits: bool) -> None:
        """Unlocks the folder of a session that was closed, and deletes sessions that were closed earlier.

        A session without edits is deleted itself, and the earlier ones stay.
        """
        if not has_edits:
            shutil.rmtree(folder, ignore_errors=True)
            return
        with suppress(OSError):
            (folder / _LOCK).unlink(missing_ok=True)
        for saved in self.saved_sessions():
            if saved.folder != folder and (saved in self._taken_over or not _is_locked(saved.folder)):
                self.discard(saved)


def _open_folder(folder: Path) -> None:
    """Makes the folder of a session and locks it. Raises WriteError."""
    make_folder(folder)
    if not _is_locked(folder):
        _lock(folder)


def _is_locked(folder: Path) -> bool:
    return (folder / _LOCK).exists()


def _lock(folder: Path) -> None:
    """Notes that this process writes to a folder. Raises WriteError."""
    write_file(folder / _LOCK, json.dumps({"pid": os.getpid(), "since": process_start(os.getpid())}))


def _owner(folder: Path) -> dict[str, Any]:
    """The process that locked a folder. Raises OSError and ValueError where that can't be read."""
    owner = json.loads((folder / _LOCK).read_text(encoding="utf-8"))
    if not isinstance(owner, dict):
        raise ValueError("not a table")
    return owner


def _owner_pid(folder: Path) -> Any:
    """The id of that process; None where it can't be read."""
    try:
        return _owner(folder).get("pid")
    except _UNREADABLE:
        return None


def _is_owner_alive(folder: Path) -> bool:
    """Whether the process that locked a folder still runs; the start time tells apart a later process with its id."""
    try:
        owner = _owner(folder)
        return bool(process_start(int(owner["pid"])) == owner["since"])
    except (*_UNREADABLE, psutil.Error):
        return False
