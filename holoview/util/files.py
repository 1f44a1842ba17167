"""Folders of files that holoview ships (shaders, presets, assets) and of its caches; atomic writing of result files."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Context manager that yields a temporary file in the folder of `path` and renames it to `path` at the end.

    A reader therefore sees the old file or the whole new one. If the block raises, the temporary file is removed and
    `path` stays unchanged. The temporary file has the suffix of `path`, by which some libraries choose the format.

    Raises UserError when `path` is a folder, when its folder is missing or can't be written to, and when the write
    fails.
    """
    target = Path(path)
    if target.is_dir():
        raise UserError(str(target), "is a folder", expected="the name of a file to write")
    if not target.parent.is_dir():
        raise UserError(str(target), f"the folder {target.parent} doesn't exist", remedy="create it or choose another")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise UserError(str(target), f"can't be written: {error.strerror}", remedy="choose another folder") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(target)
    except OSError as error:
        raise UserError(
            str(target), f"writing failed: {error}", remedy="free space or choose another folder"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def fsync(path: Path) -> None:
    """Flushes a file's content, or a folder's entries, to the storage device; does nothing where that isn't supported.

    Folders can't be opened on Windows, and some network file systems have no fsync.
    """
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:  # folders on Windows
        return
    try:
        os.fsync(handle)
    except OSError:  # some network file systems
        pass
    finally:
        os.close(handle)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
