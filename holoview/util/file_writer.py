"""Writes files whole or not at all; every failure of a disk becomes one error.

A library that writes a format makes the content in memory and never sees the disk. Its ways to fail on a full disk
(exceptions of its own, half files, crashes) can't occur then.

Names of files and folders that are being written are locked (`OutputLocks`), so that no two programs write the same
name at a time. A lock is one of the operating system on a small file in the user's cache folder. It ends with the
process that holds it, however that ends. Where the cache folder can't be written, or its disk has no locks, nothing is
locked.
"""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType

from holoview.util.errors import UserError
from holoview.util.files import cache_dir

_NOT_SUPPORTED = (errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PREFIX, _SUFFIX = ".holoview-", ".part"  # of files that aren't complete yet
Content = bytes | bytearray | memoryview | str


class WriteError(UserError):
    """A file or folder that can't be written: the disk is full, read-only or gone, or the name isn't possible."""


def write_file(
    path: str | os.PathLike[str],
    content: Content,
    *,
    is_durable: bool = True,
    is_private: bool = False,
    follows_links: bool = True,
) -> None:
    """Writes a file beside the one of that name, if any, and puts it in its place when it is complete.

    A reader sees the old file or the whole new one. When it fails, the old file stays and nothing else is left; a
    program that is killed leaves nothing either where the file system has files without a name (Linux). A link is
    followed. content: bytes, or text for UTF-8. is_durable: waits until the disk has it, so that it outlives a power
    cut. is_private: only the user may read the file. follows_links: False refuses a link in place of the file, which
    somebody else may have put there.

    Raises WriteError whatever fails.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    with _disk_errors(path, len(data)):
        target = _check_target(path) if follows_links else _check_plain_target(path)
        temporary = _write_beside(target, data, is_durable, 0o600 if is_private else 0o666)
        try:
            temporary.replace(target)
        except BaseException:
            _remove(temporary)
            raise
        if is_durable:
            _fsync_folder(target.parent)


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raises WriteError unless `write_file` could write here now: before time is spent on the content."""
    with _disk_errors(path):
        target = _check_target(path)
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, "the file is write-protected")
        tempfile.TemporaryFile(dir=target.parent).close()


def make_folder(path: str | os.PathLike[str]) -> None:
    """Creates a folder and its parents, unless it exists. Raises WriteError when it can't be made or written to."""
    with _disk_errors(path, what="made"):
        if os.path.lexists(path) and not Path(path).is_dir():
            where, remedy = str(path), "choose another folder"
            raise WriteError(where, "can't be made: it is a file", expected="a folder to write to", remedy=remedy)
        Path(path).mkdir(parents=True, exist_ok=True)
    with _disk_errors(path):
        tempfile.TemporaryFile(dir=path).close()


@contextmanager
def _disk_errors(path: str | os.PathLike[str], size: int = 0, what: str = "written") -> Iterator[None]:
    """Turns the errors of a disk into WriteError. size: of the content in bytes; 0: unknown."""
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        if isinstance(error, UserError):
            raise
        code = error.errno if isinstance(error, OSError) else None
        found = f"can't be {what}: {(error.strerror if isinstance(error, OSError) else None) or error}"
        remedy = "choose another folder"
        if code in _NO_SPACE:
            remedy = f"free {_format_size(size)} there, or choose another folder" if size else f"free space or {remedy}"
        if code == errno.ENAMETOOLONG:
            remedy = "choose a shorter name"
        raise WriteError(os.fspath(path), found, remedy=remedy) from error


def _check_target(path: str | os.PathLike[str]) -> Path:
    """The path with links followed. Raises WriteError unless it can be a file's, and OSError for impossible names."""
    with suppress(FileNotFoundError, NotADirectoryError):
        os.lstat(path)  # realpath accepts names that no file can have, such as one that is too long
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise WriteError(str(path), "is a folder", expected="the name of a file to write")
    if target.exists() and not target.is_file():
        raise WriteError(str(path), "is a device or a pipe", expected="the name of a file to write")
    if not target.parent.is_dir():
        remedy = "create it or choose another"
        raise WriteError(str(path), f"the folder {Path(path).parent} doesn't exist", remedy=remedy)
    return target


def _check_plain_target(path: str | os.PathLike[str]) -> Path:
    """The path as `_check_target`, in its folder as it is: a link that is put there later is replaced, not followed."""
    if Path(path).is_symlink():
        raise WriteError(str(path), "is a link, which isn't followed here", remedy="remove it")
    _check_target(path)
    return Path(os.path.realpath(Path(path).parent)) / Path(path).name


def _write_beside(target: Path, data: bytes | bytearray | memoryview, is_durable: bool, rights: int) -> Path:
    """Writes data to a file in the folder of `target`; where that is possible, it has no name until it is complete."""
    if hasattr(os, "O_TMPFILE"):
        with suppress(OSError):  # not on this file system; any other reason is found again below
            return _write_without_name(target, data, is_durable, rights)
    handle, name = tempfile.mkstemp(prefix=_PREFIX, suffix=_SUFFIX, dir=target.parent)
    temporary = Path(name)
    try:
        _write(handle, data, is_durable)
        temporary.chmod(rights & ~_umask())
    except BaseException:
        _remove(temporary)
        raise
    return temporary


def _write_without_name(target: Path, data: bytes | bytearray | memoryview, is_durable: bool, rights: int) -> Path:
    handle = os.open(target.parent, os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, rights)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        _write(os.dup(handle), data, is_durable)
        temporary = target.with_name(f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}")
        os.link(f"/proc/self/fd/{handle}", temporary, src_dir_fd=folder)  # so that linkat follows the link in /proc
    finally:
        os.close(folder)
        os.close(handle)
    return temporary


def _write(handle: int, data: bytes | bytearray | memoryview, is_durable: bool) -> None:
    """Writes data to an open file and closes it."""
    with os.fdopen(handle, "wb") as file:
        file.write(data)
        file.flush()
        if is_durable:
            _fsync(handle)


def _remove(temporary: Path) -> None:
    with suppress(OSError):
        temporary.unlink(missing_ok=True)


def _fsync(handle: int) -> None:
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in _NOT_SUPPORTED:  # some network file systems lack this call, which is no failure
            raise


def _fsync_folder(folder: Path) -> None:
    """Flushes a folder's entries; folders can't be opened on Windows."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _format_size(size: int) -> str:
    return f"{size / 1e6:.3g} MB" if size >= 1e5 else f"{max(size, 1000) / 1e3:.0f} kB"


# --- another place for a result ---------------------------------------------------------------------------------------


_MOST_NAMES = 1000


def save_elsewhere(path: Path, save: Callable[[Path], object]) -> Path | None:
    """Saves by `save(path)` what couldn't be written at `path`, under a free name in another folder.

    The folders are the present one, the home folder and the one for temporary files, in this order. Returns the path,
    None if no folder takes it.
    """
    for folder in _folders(path):
        with suppress(WriteError):
            make_folder(folder)
            free = _free_name(folder / path.name)
            save(free)
            return free
    return None


def _folders(path: Path) -> Iterator[Path]:
    """Folders on other disks or with other permissions than that of the path."""
    refused = os.path.realpath(path.parent)
    candidates: tuple[Callable[[], str | Path], ...] = (Path.cwd, Path.home, tempfile.gettempdir)
    for candidate in candidates:
        with suppress(OSError, RuntimeError):  # a present folder that was deleted, a user without a home
            folder = Path(candidate())
            if os.path.realpath(folder) != refused:
                yield folder


def _free_name(path: Path) -> Path:
    """The path, or one with a number behind its name, so that nothing is overwritten."""
    names = (path if n == 1 else path.with_name(f"{path.stem}-{n}{path.suffix}") for n in range(1, _MOST_NAMES))
    return next((name for name in names if not os.path.lexists(name)), path)


# --- locks on names ---------------------------------------------------------------------------------------------------


if sys.platform == "win32":
    import msvcrt

    def _try_lock(handle: int) -> None:
        """Raises BlockingIOError if another process has locked the file."""
        os.lseek(handle, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError from error
else:
    import fcntl

    def _try_lock(handle: int) -> None:
        """Raises BlockingIOError if another process has locked the file."""
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


_LOCKED_BYTE = 1 << 20  # behind the process id, which others read
_FOLDER = "locks"


class OutputLocks:
    """The locks of a command. Use it in a `with` block, which releases them."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._held: dict[str, tuple[int, Path]] = {}

    def __enter__(self) -> OutputLocks:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for handle, file in self._held.values():
            with suppress(OSError):  # Windows removes no file that is open
                file.unlink()
            os.close(handle)
        self._held = {}

    def hold(self, path: Path) -> None:
        """Locks the name of a file or folder, unless it is held already, until the block ends.

        Raises UserError if another process has locked it, by whatever name.
        """
        name = os.path.normcase(os.path.realpath(path))
        if name in self._held:
            return
        try:
            self._held[name] = self._lock(name)
        except BlockingIOError as error:
            by = f" (process {error.args[1]})" if len(error.args) > 1 and error.args[1] else ""
            remedy = "wait until it has ended, or choose another name"
            raise UserError(str(path), f"is being written by another holoview{by}", remedy=remedy) from error
        except OSError:
            return  # no place for locks

    def _lock(self, name: str) -> tuple[int, Path]:
        folder = cache_dir() / _FOLDER if self._folder is None else self._folder
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / hashlib.sha256(os.fsencode(name)).hexdigest()[:32]
        while True:
            handle = os.open(file, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
            try:
                _try_lock(handle)
                if not _is_still(handle, file):  # its owner has removed it since it was opened
                    os.close(handle)
                    continue
                os.ftruncate(handle, 0)
                os.lseek(handle, 0, os.SEEK_SET)
                os.write(handle, str(os.getpid()).encode("ascii"))
            except BlockingIOError:
                os.lseek(handle, 0, os.SEEK_SET)
                owner = os.read(handle, 20).decode("ascii", "replace")
                os.close(handle)
                raise BlockingIOError(0, owner) from None
            except BaseException:
                os.close(handle)
                raise
            return handle, file


def _is_still(handle: int, file: Path) -> bool:
    """Whether an open file is the one of this name."""
    try:
        return os.path.samestat(os.fstat(handle), file.stat())
    except OSError:
        return False
