"""Tables of numbers as text, one row a line, separated by spaces, tabs, commas or semicolons."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.memory_limit import require_memory
from holoview.wavefield.readers.contents import Contents, StoredArray
from holoview.wavefield.request import ReadRequest

_NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_ROW = re.compile(rb"\s*" + _NUMBER + rb"(?:[\s,;]+" + _NUMBER + rb"){2,}")
_BYTES_A_CHARACTER = 40  # of words as Python objects, at the peak


class TextReader:
    """A table of at least three columns; lines before the first row of numbers are left out."""

    name = "text table"
    suffixes = (".txt", ".csv", ".dat", ".asc")

    def recognises(self, head: bytes) -> bool:
        """Whether it is text with a row of numbers in one of its first lines."""
        if b"\0" in head or not head.isascii():
            return False
        return any(_ROW.match(line) for line in head.splitlines()[:10])

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The table as float64."""
        require_memory(str(path), _BYTES_A_CHARACTER * path.stat().st_size)
        lines = read_bytes(path, "a table of numbers").splitlines()
        first = next((number for number, line in enumerate(lines) if _ROW.match(line)), 0)
        rows = [re.sub(rb"[,;]", b" ", line).split() for line in lines[first:] if line.strip()]
        widths = {len(row) for row in rows}
        if len(widths) != 1:
            found = f"rows of {min(widths)} to {max(widths)} numbers"
            raise UserError(str(path), found, expected="rows of one length")
        left_out = "line is" if first == 1 else f"{first} lines are"
        notes = (f"the first {left_out} left out",) if first else ()
        yield Contents.of([StoredArray.of("", np.array(rows, dtype=np.float64))], notes=notes)
