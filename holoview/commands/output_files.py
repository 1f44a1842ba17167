"""Checks that files and folders can be written, before time is spent on their content."""

from __future__ import annotations

import tempfile
from pathlib import Path

from holoview.util.errors import UserError


def check_output_file(path: Path, suffix: str) -> None:
    """Raises UserError unless a file of this suffix (such as ".png") can be written at `path`."""
    if path.suffix.lower() != suffix:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=suffix)
    if path.is_dir():
        raise UserError(str(path), "is a folder", expected=f"the name of a {suffix} file to write")
    if not path.parent.is_dir():
        raise UserError(str(path), f"the folder {path.parent} doesn't exist", remedy="create it or choose another")
    try:
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise UserError(str(path), f"can't be written: {error.strerror}", remedy="choose another folder") from error


def check_folder(path: Path) -> None:
    """Raises UserError if `path` is a file, where a folder is to be created."""
    if path.exists() and not path.is_dir():
        raise UserError(
            str(path), "can't be made: it is a file", expected="a folder to write to", remedy="choose another folder"
        )


def make_folder(path: Path) -> None:
    """Creates a folder and its parents unless it exists. Raises UserError when that fails."""
    check_folder(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(str(path), f"can't be made: {error.strerror}", remedy="choose another folder") from error
