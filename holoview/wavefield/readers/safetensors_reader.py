"""Safetensors files: named tensors of plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import safe_open

from holoview.util.memory_limit import require_memory
from holoview.wavefield.readers.contents import Contents, StoredArray, Window
from holoview.wavefield.request import ReadRequest

_TYPES = {
    "BOOL": "?", "U8": "u1", "U16": "u2", "U32": "u4", "U64": "u8", "I8": "i1", "I16": "i2", "I32": "i4", "I64": "i8",
    "F16": "f2", "F32": "f4", "F64": "f8", "C64": "c8",
}  # fmt: skip


class SafetensorsReader:
    """Tensors by name; numbers in the text of the metadata are numbers of the file."""

    name = "safetensors"
    suffixes = (".safetensors",)

    def recognises(self, head: bytes) -> bool:
        """Whether a size and a JSON object are there."""
        return len(head) > 9 and head[8:9] == b"{" and head[5:8] == b"\0\0\0" and b'"' in head[9:16]

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The tensors; a window is read from the disk when it is loaded."""
        with safe_open(path, framework="numpy") as file:
            arrays, notes = [], []
            for name in list(file.keys()):
                header = file.get_slice(name)
                if header.get_dtype() in _TYPES:
                    arrays.append(_stored(str(path), file, name, tuple(header.get_shape()), header.get_dtype()))
                else:
                    notes.append(f'"{name}" has numbers of type {header.get_dtype()}: not read')
            arrays += [_number(key, text) for key, text in (file.metadata() or {}).items() if _is_number(text)]
            yield Contents.of(arrays, notes=tuple(notes))


def _stored(path: str, file: Any, name: str, shape: tuple[int, ...], kind: str) -> StoredArray:
    dtype = np.dtype(_TYPES[kind])

    def load(window: Window) -> NDArray[Any]:
        require_memory(f"{path}: {name}", 2 * math.prod(w.stop - w.start for w in window) * dtype.itemsize)
        if not shape:
            return np.asarray(file.get_tensor(name))
        return np.asarray(file.get_slice(name)[window])

    return StoredArray(name, shape, dtype, load)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(key: str, text: str) -> StoredArray:
    return StoredArray.of(key, np.array([float(text)]))
