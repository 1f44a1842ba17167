"""NumPy's .npy and .npz files; pickled objects are refused."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.wavefield.readers.contents import Contents, StoredArray, Window
from holoview.wavefield.request import ReadRequest

_EXPECTED = "an array of numbers"
_MOST_HEADER_BYTES = 10_000
_MOST_MEMBERS = 1000


class NpyReader:
    """An array in a .npy file, mapped into memory."""

    name = "NumPy .npy"
    suffixes = (".npy",)

    def recognises(self, head: bytes) -> bool:
        """Whether the magic string is there."""
        return head.startswith(b"\x93NUMPY")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The array; a window is read from the disk when it is loaded."""
        with path.open("rb") as file:
            shape, is_fortran, dtype = _read_header(file, str(path))
            data_bytes = path.stat().st_size - file.tell()
            wanted = int(np.prod(shape, dtype=object)) * dtype.itemsize
            if data_bytes < wanted:
                found = f"is truncated: {data_bytes} bytes of numbers"
                raise UserError(str(path), found, expected=f"{wanted} bytes for an array of shape {shape}")
            order: Literal["F", "C"] = "F" if is_fortran else "C"
            if wanted == 0:
                raise UserError(str(path), f"an array of shape {shape}", expected="at least one number")
            array = StoredArray.mapped(path, dtype, shape, file.tell(), order)
        yield Contents.of([array])


class NpzReader:
    """The arrays of a .npz file; compressed ones are read whole, of uncompressed ones too."""

    name = "NumPy .npz"
    suffixes = (".npz",)

    def recognises(self, head: bytes) -> bool:
        """Whether it is a ZIP archive whose first member is named as an array."""
        return head.startswith(b"PK\x03\x04") and b".npy" in head[30:300]

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The arrays by their names."""
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS:
                raise UserError(str(path), f"has {len(members)} members", expected=f"at most {_MOST_MEMBERS}")
            yield Contents.of(
                [_member(path, archive, member) for member in members if member.filename.endswith(".npy")]
            )


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> StoredArray:
    name = member.filename.removesuffix(".npy")
    where = f"{path}: {name}"
    with archive.open(member) as file:
        shape, is_fortran, dtype = _read_header(file, where)
    count = int(np.prod(shape, dtype=object))
    wanted = count * dtype.itemsize
    if member.file_size < wanted:
        found = f"is truncated: {member.file_size} bytes"
        raise UserError(where, found, expected=f"{wanted} bytes for an array of shape {shape}")

    unpacked: list[NDArray[Any]] = []

    def load(window: Window) -> NDArray[Any]:
        if not unpacked:
            require_memory(where, 2 * wanted)
            with archive.open(member) as file:
                _read_header(file, where)
                data = file.read(wanted)
            values = np.frombuffer(data, dtype, count)
            unpacked.append(values.reshape(shape, order="F" if is_fortran else "C"))
        return unpacked[0][window]

    return StoredArray(name, shape, dtype, load, whole_bytes=2 * wanted)


def _read_header(file: IO[bytes], where: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether the first axis is the fastest, and type. Raises UserError for damaged headers and objects."""
    try:
        version = npy_format.read_magic(file)
        read = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
        shape, is_fortran, dtype = read(file, max_header_size=_MOST_HEADER_BYTES)
    except (ValueError, EOFError, TypeError, SyntaxError, MemoryError, RecursionError, OverflowError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(where, f"the header of the array is damaged ({reason})", expected=_EXPECTED) from error
    if dtype.hasobject:
        found = "holds pickled Python objects, which aren't opened because they can run code"
        raise UserError(where, found, expected=_EXPECTED, remedy="save the array itself with np.save")
    if dtype.kind not in "biufc":
        raise UserError(where, f"holds values of type {dtype}", expected=_EXPECTED)
    if any(size < 0 for size in shape):
        raise UserError(where, f"an array of shape {shape}", expected="sizes from 0")
    return shape, is_fortran, dtype
