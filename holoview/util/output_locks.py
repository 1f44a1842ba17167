"""Locks on the names of files and folders that are being written, so that no two programs write one at a time.

A lock is one of the operating system on a small file in the user's cache folder. It ends with the process that holds
it, however that ends. Where the cache folder can't be written, or its disk has no locks, nothing is locked.
"""

from __future__ import annotations

import hashlib
import os
import sys
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from holoview.util.errors import UserError
from holoview.util.files import cache_dir

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
