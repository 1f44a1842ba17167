"""Suffixes of the files that are written: a default one, and a check."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from holoview.util.errors import UserError


def with_default_suffix(path: Path, suffix: str) -> Path:
    """The path, with `suffix` added if it has none."""
    return path if path.suffix else path.with_suffix(suffix)


def check_suffix(path: Path, suffixes: Sequence[str]) -> Path:
    """The path. Raises UserError if it has another suffix than these, in lower or upper case."""
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=" or ".join(suffixes))
    return path
