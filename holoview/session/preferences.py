"""Where a user's sessions, preferences and recent files are kept between starts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import platformdirs

from holoview.util.files import atomic_write

MAX_RECENT_FILES = 20


def state_folder() -> Path:
    """The user's folder for state, as the platform has it; not made yet."""
    return Path(platformdirs.user_state_path("holoview", appauthor=False))


class Preferences:
    """Plain values by name in one JSON file: theme, layout, recent files. A damaged file is begun anew."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._values: dict[str, Any] = {}
        try:
            read = json.loads(path.read_text(encoding="utf-8"))
            self._values = dict(read)
        except (OSError, ValueError, TypeError):
            pass

    def get(self, key: str, default: Any = None) -> Any:
        """The value of a name."""
        return self._values.get(key, default)

    def set(self, key: str, value: Any) -> None:
        """Keeps a value that JSON can hold, at once. Raises UserError when the folder can't be written to."""
        if self._values.get(key) == value and key in self._values:
            return
        text = json.dumps(self._values | {key: value}, indent=1)
        self._values[key] = value
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(self._path) as temporary:
            temporary.write_text(text, encoding="utf-8")

    @property
    def recent_files(self) -> tuple[Path, ...]:
        """Files opened last, newest first, those that are still there."""
        return tuple(path for path in map(Path, self.get("recent", [])) if path.exists())

    def add_recent_file(self, path: Path) -> None:
        """Puts a file first among the recent ones."""
        name = str(path.resolve())
        others = [other for other in self.get("recent", []) if other != name]
        self.set("recent", [name, *others][:MAX_RECENT_FILES])
