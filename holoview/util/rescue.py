"""Another place for a result that can't be written where it was wanted."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from holoview.util.file_writer import WriteError, make_folder

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
