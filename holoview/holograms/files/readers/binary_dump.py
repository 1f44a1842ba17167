"""Binary dumps: files of plain numbers, whose layout the user states."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from holoview.holograms.files.readers.contents import Contents, StoredArray
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import read_bytes

_SHOWN = 60


class BinaryReader:
    """The numbers of a file as `ReadRequest.binary` describes them; it is asked only where that is given."""

    name = "binary dump"
    suffixes = (".raw", ".bin", ".dat")

    def recognises(self, head: bytes) -> bool:
        """Never: such files say nothing of themselves."""
        return False

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The parts; a window is read from the disk when it is loaded."""
        layout = request.binary
        assert layout is not None
        dtype = _dtype(layout.dtype)
        if not 2 <= len(layout.shape) <= 4 or min(layout.shape) < 1:
            found = " × ".join(map(str, layout.shape)) or "none"
            raise UserError("shape of the dump", found, expected="two to four sizes from 1, such as 1080 × 1920")
        parts = layout.parts or (("complex",) if dtype.kind == "c" else ("",))
        shape = layout.shape if len(parts) == 1 else (len(parts), *layout.shape)
        if len(parts) > 1 and layout.interleaved:
            shape = (*layout.shape, len(parts))
        size = path.stat().st_size
        needed = math.prod(shape) * dtype.itemsize
        offset = size - needed if layout.offset is None else layout.offset
        if offset < 0 or offset + needed > size:
            found = f"has {size} bytes"
            expected = f"{needed} for {' × '.join(map(str, shape))} numbers of type {layout.dtype}"
            raise UserError(str(path), found, expected=f"{expected} after {max(offset, 0)} bytes")
        array = StoredArray.mapped(path, dtype, shape, offset, layout.order, role=parts[0].replace("complex", ""))
        arrays = [array]
        if len(parts) > 1:
            axis = len(shape) - 1 if layout.interleaved else 0
            arrays = [replace(array.at(axis, index, part), name=part) for index, part in enumerate(parts)]
        notes = (f"the first {offset} bytes are left out{_start(path, offset)}",) if offset else ()
        yield Contents.of(arrays, notes=notes)


def _dtype(name: str) -> np.dtype[Any]:
    try:
        dtype = np.dtype(name)
    except (TypeError, ValueError, SyntaxError) as error:
        raise UserError("type of the dump", f'"{name}"', expected="float32, complex64, <u2 …") from error
    if dtype.kind not in "biufc" or dtype.subdtype is not None:
        raise UserError("type of the dump", f'"{name}"', expected="float32, complex64, <u2 …")
    return dtype


def _start(path: Path, offset: int) -> str:
    """The bytes that are left out, where they are text."""
    start = read_bytes(path, "a binary dump", most=min(offset, _SHOWN))
    return f': "{start.decode("ascii")}"' if start.isascii() and b"\0" not in start else ""
