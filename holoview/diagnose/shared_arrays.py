"""Objects for several processes whose large arrays all of them read from the same memory.

A session of 32 captures with two million camera pixels holds half a gigabyte, of which each process would get a copy.
Pickle hands out the arrays' memory beside its own bytes (protocol 5, PEP 574). It is written to a file once, which
processes map: pages that none of them writes exist once. Where there are files without a name (Linux), nothing stays
behind however the program ends.
"""

from __future__ import annotations

import mmap
import os
import pickle
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

_MIN_BYTES = 1 << 20  # smaller arrays are copied
_ALIGNMENT = 64  # of an array in the file, bytes


@dataclass(frozen=True)
class SharedObjects:
    """Pickled objects by name, as another process gets them.

    pickled: all but the large arrays. path: of the file that holds these, with the (first byte, bytes) of each in
    `spans`; None where there are none.
    """

    pickled: bytes
    path: str | None
    spans: tuple[tuple[int, int], ...]

    def load(self) -> dict[str, Any]:
        """The objects. Their large arrays lie in pages that are common until they are written to."""
        if self.path is None:
            return dict(pickle.loads(self.pickled))
        with Path(self.path).open("rb") as file:
            pages = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY))
        return dict(pickle.loads(self.pickled, buffers=[pages[first : first + n] for first, n in self.spans]))


class ArrayStore:
    """Holds the file of shared objects until it is closed."""

    def __init__(self) -> None:
        self._file: BinaryIO | None = None
        self._name: str | None = None

    def store(self, objects: Mapping[str, Any]) -> SharedObjects:
        """The objects, to be sent to other processes; what was stored before is dropped.

        Raises what pickle raises for objects that can't be pickled.
        """
        large: list[memoryview] = []

        def stays_in_pickle(buffer: pickle.PickleBuffer) -> bool:
            raw = buffer.raw()
            if raw.nbytes >= _MIN_BYTES:
                large.append(raw)
            return raw.nbytes < _MIN_BYTES

        pickled = pickle.dumps(dict(objects), protocol=5, buffer_callback=stays_in_pickle)
        self.close()
        if not large:
            return SharedObjects(pickled, None, ())
        self._file, path = self._new_file()
        spans = [self._write(buffer) for buffer in large]
        self._file.flush()
        return SharedObjects(pickled, path, tuple(spans))

    def close(self) -> None:
        """Frees the file; processes that have loaded the objects keep them."""
        if self._file is not None:
            self._file.close()
        if self._name is not None:
            Path(self._name).unlink(missing_ok=True)
        self._file = self._name = None

    def _new_file(self) -> tuple[BinaryIO, str]:
        if sys.platform != "linux":
            number, self._name = tempfile.mkstemp(prefix="holoview-")
            return os.fdopen(number, "wb"), self._name
        file = os.fdopen(os.memfd_create("holoview"), "wb")
        return file, f"/proc/{os.getpid()}/fd/{file.fileno()}"

    def _write(self, buffer: memoryview) -> tuple[int, int]:
        assert self._file is not None
        self._file.write(b"\0" * (-self._file.tell() % _ALIGNMENT))
        first = self._file.tell()
        self._file.write(buffer)
        return first, buffer.nbytes
