"""Finds, saves and restores sessions, and keeps the user's preferences.

In order: the store; autosave on a worker thread; files that can't be read, kept aside; preferences and recent files.
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
from threading import Condition, Lock, Thread
from typing import Any, TypeVar

import platformdirs
import psutil

from holoview.util.errors import UserError
from holoview.util.file_writer import WriteError, make_folder, write_file
from holoview.util.files import read_text
from holoview.util.processes import process_start
from holoview.util.tables import parse_json_table, typed_value
from holoview.viewer.document.archive import (
    SESSION_FILE,
    SessionArchive,
    SessionData,
    is_of_other_version,
    read_metadata,
    read_session,
)
from holoview.viewer.document.document import Document, History
from holoview.viewer.document.editing_session import Change, EditingSession
from holoview.viewer.document.optimisation_job import (
    UnfinishedOptimisation,
    continue_optimisation,
    unfinished_optimisation,
)

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

    def restore(self) -> EditingSession:
        """Reads the session with its undo history; unreadable parts are reported in its messages.

        The result of an unfinished optimisation becomes a snapshot. Raises UserError when nothing can be read.
        """
        return self.restore_with_unfinished()[0]

    def restore_with_unfinished(
        self, wake: Callable[[], None] = lambda: None
    ) -> tuple[EditingSession, UnfinishedOptimisation | None]:
        """As `restore`, with the optimisation that was running."""
        data, history, snapshots, unreadable = self._read()
        session = EditingSession.from_history(history, snapshots, data.looks, wake)
        session.choose_optimisation(data.choices)
        return _report_unreadable(session, unreadable), data.unfinished

    def restore_into(self, session: EditingSession) -> None:
        """As `restore`, into an open session. Raises UserError; then that session is unchanged."""
        data, history, snapshots, unreadable = self._read()
        session.load_history(history, snapshots, data.looks)
        session.choose_optimisation(data.choices)
        _report_unreadable(session, unreadable)

    def _read(self) -> tuple[SessionData, History, dict[str, Document], list[str]]:
        """The saved data, history, snapshots with an unfinished optimisation, and sentences on unreadable parts."""
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
        self._own: Path | None = None

    def saved_sessions(self) -> list[SavedSession]:
        """All sessions that were saved at least once, newest first."""
        found = map(self._saved_session, self._folders())
        return sorted((saved for saved in found if saved is not None), key=lambda saved: -saved.when)

    def crashed_sessions(self) -> list[SavedSession]:
        """Sessions whose process ended without closing them, newest first."""
        return [s for s in self.saved_sessions() if _is_locked(s.folder) and not _is_owner_alive(s.folder)]

    def windows_before(self, title: str) -> int:
        """Windows that other programs opened before this one and that show a document of this title."""
        others = (folder for folder in self._folders() if self._own is None or folder.name < self._own.name)
        open_ones = (folder for folder in others if _is_owner_alive(folder) and _owner_pid(folder) != os.getpid())
        return sum(_shown_title(folder) == title for folder in open_ones)

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
        folder = self._own = self._new_folder()
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
            title, steps = typed_value(table["title"], str, "title"), table["steps"]
            when = typed_value(table["when"], float, "when")
            time.localtime(when)
            return SavedSession(folder, title, when, len(steps))
        except (UserError, KeyError, TypeError, ValueError, OverflowError, OSError):
            return None

    def _on_closed(self, folder: Path, has_edits: bool) -> None:
        """Unlocks the folder of a session that was closed, and deletes sessions that were closed earlier.

        A session without edits is deleted itself, and earlier sessions stay.
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


def _shown_title(folder: Path) -> Any:
    """The title of the document of a session; None where it can't be read."""
    try:
        return read_metadata(folder).get("document")
    except _UNREADABLE:
        return None


def _is_locked(folder: Path) -> bool:
    return (folder / _LOCK).exists()


def _lock(folder: Path) -> None:
    """Notes that this process writes to a folder. Raises WriteError."""
    write_file(folder / _LOCK, json.dumps({"pid": os.getpid(), "since": process_start(os.getpid())}))


def _owner(folder: Path) -> dict[str, Any]:
    """The process that locked a folder. Raises UserError where that can't be read."""
    return parse_json_table(read_text(folder / _LOCK, "a lock"), _LOCK, "a lock")


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


# --- Saves a session on a worker thread whenever it changes, so that a crash loses nothing ---


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
        self, session: EditingSession, folder: Path, open_folder: Callable[[], None], on_closed: Callable[[bool], None]
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
        self._is_urgent = self._is_saving = self._is_closing = self._is_unfinished = False
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

        The folder of a session without edits, in which no optimisation runs, is deleted. Work saved before a failure is
        kept as after a crash. May be called on any thread, and again, which says the same.
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
        has_edits = len(self._session.history) > 1 or self._session.can_look_back or self._is_unfinished
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
            session.looks,
        )
        self._is_unfinished = data.unfinished is not None
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
    title = f"{document.system.name or 'bench'}: {document.origin}"
    return {"title": title, "document": document.title, "when": time.time(), "pid": os.getpid()}


# Keeps stored state that can't be read: under another name, so that the program can begin anew and nothing is lost.


_MARK = ".damaged"
_MOST = 100


def set_aside(path: Path) -> str:
    """Renames a damaged file or folder; returns the outcome in words. Where the disk refuses, the name stays."""
    for number in range(1, _MOST):
        aside = path.with_name(f"{path.name}{_MARK}{'' if number == 1 else f'-{number}'}")
        if not aside.exists():
            try:
                path.rename(aside)
            except OSError as error:
                return f"{path} is damaged, and can't be renamed: {error.strerror}"
            return f"{path} is damaged, and kept as {aside.name}"
    return f"{path} is damaged"


def is_aside(path: Path) -> bool:
    """Whether a file or folder has been renamed so."""
    return _MARK in path.name


# --- The user's preferences and recent files, stored between starts of the viewer ---


MAX_RECENT_FILES = 20
_REMEDY = "preferences are kept until the viewer is closed"

T = TypeVar("T")


def state_folder() -> Path:
    """The platform's folder for the state of applications, which need not exist."""
    return Path(platformdirs.user_state_path("holoview", appauthor=False))


class Preferences:
    """JSON values by name in one file, such as the theme and the recent files.

    Viewers that are open at the same time keep what the others have stored; each sees their changes when it starts. A
    file that can't be read counts as empty; a damaged file is kept aside. problem: a line about that, or "".
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._values: dict[str, Any] = {}
        self.problem = ""
        try:
            self._values = self._stored()
        except OSError as error:
            self.problem = f"preferences: {path} can't be read: {error.strerror}; the usual ones are used"
        except ValueError:
            self.problem = f"preferences: {set_aside(path)}; the usual ones are used"

    def get(self, key: str, default: T) -> T:
        """The value of a name; the default for a name that isn't stored, or with a value of another type."""
        value = self._values.get(key, default)
        return value if isinstance(value, type(default)) else default

    def set(self, key: str, value: Any) -> None:
        """Stores a value that JSON can represent, immediately.

        Raises WriteError when the file can't be written; the value is kept for this process then.
        """
        if self._values.get(key) == value and key in self._values:
            return
        text = json.dumps(self._values | self._stored_or_none() | {key: value}, indent=1)
        self._values[key] = value
        try:
            make_folder(self._path.parent)
            write_file(self._path, text, is_durable=False)
        except WriteError as error:  # a home folder that is missing or read-only, a full disk
            raise WriteError(error.where, error.found, expected=error.expected, remedy=_REMEDY) from error

    @property
    def recent_files(self) -> tuple[Path, ...]:
        """The files that were opened last and still exist, newest first."""
        return tuple(path for path in map(Path, _names(self._values)) if _exists(path))

    def add_recent_file(self, path: Path) -> None:
        """Puts a file first in the list of recent files."""
        name = str(path.resolve())
        names = dict.fromkeys((name, *_names(self._stored_or_none()), *_names(self._values)))
        self.set("recent", list(names)[:MAX_RECENT_FILES])

    def _stored(self) -> dict[str, Any]:
        """The values in the file, none if it isn't there. Raises OSError or ValueError when it can't be read."""
        try:
            return dict(json.loads(self._path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return {}
        except (TypeError, RecursionError) as error:
            raise ValueError(str(error)) from error

    def _stored_or_none(self) -> dict[str, Any]:
        with suppress(OSError, ValueError):
            return self._stored()
        return {}


def _names(values: dict[str, Any]) -> list[str]:
    stored = values.get("recent", [])
    return [name for name in stored if isinstance(name, str)] if isinstance(stored, list) else []


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long, a folder that can't be looked into
        return False
