"""The user's preferences and recent files, stored between starts of the viewer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import platformdirs

from holoview.util.errors import UserError
from holoview.util.files import atomic_write

MAX_RECENT_FILES = 20


def state_folder() -> Path:
    """The platform's folder for the state of applications; it need not exist."""
    return Path(platformdirs.user_state_path("holoview", appauthor=False))


class Preferences:
    """JSON values by name in one file, such as the theme and the recent files. A damaged file counts as empty."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._values: dict[str, Any] = {}
        try:
            read = json.loads(path.read_text(encoding="utf-8"))
            self._values = dict(read)
        except (OSError, ValueError, TypeError):
            pass

    def get(self, key: str, default: Any = None) -> Any:
        """The value of a name, or the default."""
        return self._values.get(key, default)

    def set(self, key: str, value: Any) -> None:
        """Stores a value that JSON can represent, immediately.

        Raises UserError when the file can't be written; the value is kept for this process then.
        """
        if self._values.get(key) == value and key in self._values:
            return
        text = json.dumps(self._values | {key: value}, indent=1)
        self._values[key] = value
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:  # a home folder that is missing or read-only
            where, found = str(self._path.parent), f"can't be made: {error.strerror}"
            raise UserError(where, found, remedy="preferences are kept until the viewer is closed") from error
        with atomic_write(self._path) as temporary:
            temporary.write_text(text, encoding="utf-8")

    @property
    def recent_files(self) -> tuple[Path, ...]:
        """The files that were opened last and still exist, newest first."""
        return tuple(path for path in map(Path, self.get("recent", [])) if path.exists())

    def add_recent_file(self, path: Path) -> None:
        """Puts a file first in the list of recent files."""
        name = str(path.resolve())
        others = [other for other in self.get("recent", []) if other != name]
        self.set("recent", [name, *others][:MAX_RECENT_FILES])
