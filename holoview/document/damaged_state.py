"""Keeps stored state that can't be read: under another name, so that the program can begin anew and nothing is lost."""

from __future__ import annotations

from pathlib import Path

_MARK = ".damaged"
_MOST = 100


def set_aside(path: Path) -> str:
    """Renames a damaged file or folder; returns what was done with it, in words. A disk may refuse; it stays then."""
    for number in range(1, _MOST):
        aside = path.with_name(f"{path.name}{_MARK}{'' if number == 1 else f'-{number}'}")
        if not aside.exists():
            try:
                path.rename(aside)
            except OSError as error:
                return f"{path} is damaged, and can't be renamed: {error.strerror}"
            return f"{path} is damaged, and kept as {aside.name}"
    return f"{path} is damaged"


def is_aside(path: Path) -> bool:
    """Whether a file or folder has been renamed so."""
    return _MARK in path.name
