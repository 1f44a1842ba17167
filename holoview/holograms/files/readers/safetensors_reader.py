"""Safetensors files: named tensors of plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.memory_limit import require_memory
from holoview.util.safetensors_file import StoredTensor, open_tensors


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
        stored = open_tensors(path, "tensors of numbers")
        arrays = [_array(str(path), tensor) for tensor in stored.tensors.values() if tensor.dtype is not None]
        unread = [tensor for tensor in stored.tensors.values() if tensor.dtype is None]
        notes = [f'"{tensor.name}" has numbers of type {tensor.kind}: not read' for tensor in unread]
        arrays += [_number(key, text) for key, text in stored.texts.items() if _is_number(text)]
        yield Contents.of(arrays, notes=tuple(notes))


def _array(path: str, tensor: StoredTensor) -> StoredArray:
    dtype = tensor.dtype
    assert dtype is not None

    def load(window: Window) -> NDArray[Any]:
        needed = 2 * math.prod(part.stop - part.start for part in window) * dtype.itemsize
        require_memory(f"{path}: {tensor.name}", needed)
        return tensor.read(window)

    return StoredArray(tensor.name, tensor.shape, dtype, load)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(key: str, text: str) -> StoredArray:
    return StoredArray.of(key, np.array([float(text)]))
