"""The syntax of the package's modules, parsed once for all tests that read it."""

from __future__ import annotations

import ast
import gc
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import holoview

PACKAGE = Path(holoview.__file__).resolve().parent


@cache
def source_trees() -> Mapping[Path, ast.Module]:
    """The syntax tree of every module by its file, sorted.

    Nobody looks for garbage among them, which all stay: that took longer than parsing, and as long again later.
    """
    gc.disable()
    try:
        return {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}
    finally:
        gc.freeze()
        gc.enable()
