"""The user's preferences and recent files, stored between starts of the viewer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

import platformdirs

from holoview.document.damaged_state import set_aside
from holoview.util.file_writer import WriteError, make_folder, write_file

MAX_RECENT_FILES = 20
_REMEDY = "preferences are kept until the viewer is closed"

T = TypeVar("T")


def state_folder() -> Path:
    """The platform's folder for the state of applications; it need not exist."""
    return Path(platformdirs.user_state_path("holoview", appauthor=False))


class Preferences:
    """JSON values by name in one file, such as the theme and the recent files.

    A file that can't be read counts as empty; a damaged one is kept aside. problem: a line about that, or "".
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._values: dict[str, Any] = {}
        self.problem = ""
        try:
            self._values = dict(json.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            pass
        except OSError as error:
            self.problem = f"preferences: {path} can't be read: {error.strerror}; the usual ones are used"
        except (ValueError, TypeError, RecursionError):
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
        text = json.dumps(self._values | {key: value}, indent=1)
        self._values[key] = value
        try:
            make_folder(self._path.parent)
            write_file(self._path, text, is_durable=False)
        except WriteError as error:  # a home folder that is missing or read-only, a full disk
            raise WriteError(error.where, error.found, expected=error.expected, remedy=_REMEDY) from error

    @property
    def recent_files(self) -> tuple[Path, ...]:
        """The files that were opened last and still exist, newest first."""
        return tuple(path for path in map(Path, self._recent_names()) if _exists(path))

    def add_recent_file(self, path: Path) -> None:
        """Puts a file first in the list of recent files."""
        name = str(path.resolve())
        others = [other for other in self._recent_names() if other != name]
        self.set("recent", [name, *others][:MAX_RECENT_FILES])

    def _recent_names(self) -> list[str]:
        stored: list[Any] = self.get("recent", [])
        return [name for name in stored if isinstance(name, str)]


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name that is too long, a folder that can't be looked into
        return False
