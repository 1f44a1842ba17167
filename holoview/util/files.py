"""Where product files live, and how results are written: beside first, then renamed, so none is half there."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from holoview.util.errors import UserError

_PACKAGE = Path(__file__).resolve().parents[1]


def data_dir(kind: str) -> Path:
    """The folder of `shaders`, `presets` or `assets`: inside the installed package, or at the root of a checkout."""
    installed = _PACKAGE / "data" / kind
    return installed if installed.is_dir() else _PACKAGE.parent / kind


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside `path`, renamed onto it when the block ends well and removed when it doesn't.

    The temporary keeps the suffix, so that writers which choose a format by it work unchanged.

    Raises UserError when the folder is missing or can't be written to, or when the write itself fails.
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
    """Waits until a file, or the names in a folder, would survive a loss of power; where the platform can't, no."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:  # folders of Windows
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
