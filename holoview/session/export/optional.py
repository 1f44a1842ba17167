"""Imports optional libraries and checks file suffixes, with errors that say what to do."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from holoview.util.errors import UserError


def import_optional(module: str, purpose: str) -> Any:
    """A module that an optional library provides. Raises UserError if it isn't installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        remedy = 'install it with `pip install "holoview[export]"`'
        raise UserError(purpose, f"{error.name} isn't installed", remedy=remedy) from error


def check_suffix(path: Path, suffixes: Sequence[str]) -> Path:
    """The path. Raises UserError if it has another suffix than these, in lower or upper case."""
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise UserError(str(path), f'the suffix "{path.suffix}"', expected=" or ".join(suffixes))
    return path
