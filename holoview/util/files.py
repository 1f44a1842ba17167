"""Folders of shaders, presets, assets and caches, and the files that a user names to be read.

Only regular files are opened: pipes and devices would be waited for, or never end.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

from holoview.util.errors import UserError

_PACKAGE = Path(__file__).resolve().parents[1]


def data_dir(kind: str) -> Path:
    """The folder named "shaders", "presets" or "assets": in the installed package, or at the root of a checkout."""
    installed = _PACKAGE / "data" / kind
    return installed if installed.is_dir() else _PACKAGE.parent / kind


def cache_dir() -> Path:
    """The folder of the user for caches of this program; it may not exist yet."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "holoview"


def expand_home(name: str | os.PathLike[str]) -> Path:
    """The path with a leading ~ or ~user replaced by that home folder; unchanged where there is no such user."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


# --- input files ------------------------------------------------------------------------------------------------------


TEXT_LIMIT = 4 << 20
"""Largest text file in bytes: a preset with two look-up tables of 65 536 levels has 2.6 million."""

_KINDS = (
    (stat.S_ISDIR, "is a folder", "name a file in it"),
    (stat.S_ISFIFO, "is a pipe", "save its content to a file first"),
    (stat.S_ISSOCK, "is a socket", "name a file"),
    (stat.S_ISCHR, "is a device", "name a file"),
    (stat.S_ISBLK, "is a device", "name a file"),
)
_NON_BLOCKING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def require_file(path: str | os.PathLike[str], expected: str, missing: str = "") -> Path:
    """The path, if it leads to a regular file.

    expected: a description of the right file. missing: the remedy where there is none.
    Raises UserError for a name without a file, and for folders, pipes, sockets and devices.
    """
    file = Path(path)
    try:
        mode = file.stat().st_mode
    except OSError as error:
        raise _unreadable(file, error, expected, missing) from error
    except ValueError as error:  # NUL in the name
        raise UserError(repr(str(path)), "isn't the name of a file", expected=expected) from error
    _require_regular(file, mode, expected)
    return file


def read_bytes(path: str | os.PathLike[str], expected: str, most: int | None = None, missing: str = "") -> bytes:
    """The content of a regular file, or its first `most` bytes. Raises UserError as `require_file` does."""
    file = require_file(path, expected, missing)
    try:
        handle = os.open(file, os.O_RDONLY | _NON_BLOCKING)  # a pipe that took the file's place isn't waited for
        with os.fdopen(handle, "rb") as opened:
            _require_regular(file, os.fstat(handle).st_mode, expected)
            return opened.read() if most is None else opened.read(most)
    except OSError as error:
        raise _unreadable(file, error, expected, missing) from error


def read_text(path: str | os.PathLike[str], expected: str, most: int = TEXT_LIMIT) -> str:
    """The content of a text file in UTF-8, with or without a byte order mark; lines end with \\n.

    Raises UserError as `require_file` does, for other text, and for more than `most` bytes.
    """
    data = read_bytes(path, expected, most + 1)
    if len(data) > most:
        raise UserError(str(path), f"has more than {most >> 20} MiB", expected=expected)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(str(path), f"can't be read: {error}", expected=expected) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _require_regular(file: Path, mode: int, expected: str) -> None:
    for is_kind, found, remedy in _KINDS:
        if is_kind(mode):
            raise UserError(str(file), found, expected=expected, remedy=remedy)


def _unreadable(file: Path, error: OSError, expected: str, missing: str) -> UserError:
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return UserError(str(file), "no such file", expected=expected, remedy=missing)
    return UserError(str(file), f"can't be read: {error.strerror}", expected=expected, remedy="check its permissions")
