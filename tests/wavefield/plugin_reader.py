"""A reader as a laboratory would write it: 3 × 4 complex numbers after four letters."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from holoview.holograms.files.readers.contents import Contents, StoredArray
from holoview.holograms.files.request import ReadRequest


class OurReader:
    """Reads .ours files."""

    name = "ours"
    suffixes = (".ours",)

    def recognises(self, head: bytes) -> bool:
        """Whether the four letters are there."""
        return head.startswith(b"OURS")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The field."""
        values = np.frombuffer(path.read_bytes(), "<c16", offset=4).reshape(3, 4)
        yield Contents((StoredArray.of("", values),))
