"""Functions as machine code of this processor, compiled by numba when they are first called, and kept on disk."""

from __future__ import annotations

from typing import Any

from holoview.util.files import cache_dir
from holoview.util.packages import import_optional

REORDERED = ("contract", "reassoc", "nsz")
"""What rounding may depend on, as LLVM calls it; infinities and NaN stay what they are."""


def compiled(function: Any) -> Any:
    """A function as machine code that holds no lock of Python, kept in the user's cache folder.

    It is compiled when first called with numbers of some precision. Raises UserError where numba can't be loaded.
    """
    numba = import_optional("numba", "compiled kernels")
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_dir() / "numba")  # read where a function is decorated
    try:
        return numba.njit(nogil=True, cache=True, error_model="numpy", fastmath=set(REORDERED))(function)
    finally:
        numba.config.CACHE_DIR = before
