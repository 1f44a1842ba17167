"""Folders of shaders, presets, assets and caches, and the files that a user names to be read.

Every file that somebody names or that is found in a folder is opened here, or checked here before a library opens it.
Only regular files are: pipes and devices would be waited for, or never end. No more is read than the size that the
file has when it is opened, within the memory that is allowed, so that neither a file of the kernel without end nor one
that grows is read for ever. Files aren't mapped into memory: a mapped file that shrinks ends the process.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from holoview.util.errors import UserError
from holoview.util.memory_limit import format_size, require_memory

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


def refuse_special_file(path: str | os.PathLike[str], expected: str = "a file or a folder") -> None:
    """Raises UserError for a pipe, a socket or a device; not for a folder, nor for a name without a file."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError):
        return
    if not stat.S_ISDIR(mode):
        _require_regular(Path(path), mode, expected)


@contextmanager
def opened_file(path: str | os.PathLike[str], expected: str, missing: str = "") -> Iterator[BinaryIO]:
    """A regular file that is open to be read; what is checked is the open file, not its name.

    Raises UserError as `require_file` does, and in the block for the errors of the disk.
    """
    file = require_file(path, expected, missing)
    try:
        handle = os.open(file, os.O_RDONLY | _NON_BLOCKING)  # a pipe that took the file's place isn't waited for
        with os.fdopen(handle, "rb") as opened:
            _require_regular(file, os.fstat(handle).st_mode, expected)
            yield opened
    except OSError as error:
        raise _unreadable(file, error, expected, missing) from error


def read_bytes(path: str | os.PathLike[str], expected: str, most: int | None = None, missing: str = "") -> bytes:
    """The content of a regular file, or its first `most` bytes; no more than its size when it is opened.

    Raises UserError as `require_file` does, and for a content that needs more memory than is allowed.
    """
    with opened_file(path, expected, missing) as opened:
        size = os.fstat(opened.fileno()).st_size
        wanted = size if most is None else min(most, size)
        if wanted > TEXT_LIMIT:
            require_memory(str(path), wanted, remedy="read a part of it")
        return opened.read(wanted)


def read_limited(path: str | os.PathLike[str], expected: str, most: int) -> bytes:
    """The content of a regular file. Raises UserError as `read_bytes` does, and for more than `most` bytes."""
    with opened_file(path, expected) as opened:
        size = os.fstat(opened.fileno()).st_size
        if size > most:
            found = f"has {format_size(size)}, more than {most / (1 << 20):.3g} MiB"
            raise UserError(str(path), found, expected=expected)
        return opened.read(size)


def read_text(path: str | os.PathLike[str], expected: str, most: int = TEXT_LIMIT) -> str:
    """The content of a text file in UTF-8, with or without a byte order mark; lines end with \\n.

    Raises UserError as `require_file` does, for other text, and for more than `most` bytes.
    """
    data = read_limited(path, expected, most)
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
