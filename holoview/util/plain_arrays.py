"""Arrays that stand in a file as plain numbers: numpy's .npy header, .npz archives, windows read from their file.

What a header declares is compared with the size of the file before anything is allocated. Windows are read, never
mapped into memory: a program that maps a file is ended by the system (SIGBUS) when the file shrinks.
"""

from __future__ import annotations

import math
import os
import struct
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, BinaryIO, Literal

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.files import opened_file
from holoview.util.memory_limit import format_size, require_memory

_EXPECTED = "an array of numbers"
_MOST_HEADER_BYTES = 10_000
_MOST_AXES = 32
_MOST_ARRAYS = 16  # in a .npy file
_MOST_MEMBERS = 1000
_MOST_DIRECTORY_BYTES = 1 << 20  # of so many members with long names
_END_BYTES = 22 + 65_535 + 76  # the last records of an archive with the longest comment, those of ZIP64 among them
_PIECE_BYTES = 16 << 20  # that are read at a time where only parts of them are wanted


@dataclass(frozen=True)
class NpyHeader:
    """The header of a .npy file. offset: of its numbers, bytes. is_fortran: whether the first axis is the fastest."""

    shape: tuple[int, ...]
    is_fortran: bool
    dtype: np.dtype[Any]
    offset: int

    @property
    def nbytes(self) -> int:
        """Size of all numbers."""
        return math.prod(self.shape) * self.dtype.itemsize

    def array(self, data: bytes | memoryview) -> NDArray[Any]:
        """The array of these numbers (bytes)."""
        values = np.frombuffer(data, self.dtype, math.prod(self.shape))
        return values.reshape(self.shape, order="F" if self.is_fortran else "C")


def read_npy_header(file: IO[bytes], size: int, where: str) -> NpyHeader:
    """The header at the place where a file is being read, which is then the place of its numbers.

    size: bytes from the start of the .npy file to its end. Raises UserError, with the place `where`, for a damaged
    header, for other types than numbers, and for more numbers than the file holds.
    """
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
    if len(shape) > _MOST_AXES or any(size < 0 for size in shape):
        raise UserError(where, f"an array of shape {shape[:_MOST_AXES]}", expected="sizes from 0")
    header = NpyHeader(shape, is_fortran, dtype, file.tell())
    if header.nbytes > size - header.offset:
        found = f"is truncated or damaged: {size - header.offset} bytes of numbers"
        raise UserError(where, found, expected=f"{header.nbytes} bytes for an array of shape {shape}")
    return header


def read_npy_arrays(path: Path, file: BinaryIO) -> list[NDArray[Any]]:
    """The arrays that stand one after the other in a .npy file, as `np.save` writes them into an open file.

    Raises UserError as `read_npy_header` does, for more than 16 arrays, and where they are too large for the memory.
    """
    size, arrays = os.fstat(file.fileno()).st_size, list[NDArray[Any]]()
    while file.tell() < size:
        if len(arrays) == _MOST_ARRAYS:
            raise UserError(str(path), f"more than {_MOST_ARRAYS} arrays", expected=_EXPECTED)
        header = read_npy_header(file, size, f"{path}, array {len(arrays) + 1}")
        require_memory(str(path), 2 * header.nbytes)
        arrays.append(header.array(file.read(header.nbytes)))
    return arrays


def open_npz(path: Path, file: BinaryIO) -> zipfile.ZipFile:
    """The archive in a .npz file. Its directory, which the library reads at once, is short, or UserError is raised."""
    end = os.fstat(file.fileno()).st_size
    file.seek(max(end - _END_BYTES, 0))
    last = file.read()
    place, place64 = last.rfind(b"PK\5\6"), last.rfind(b"PK\6\6")
    size = struct.unpack_from("<I", last, place + 12)[0] if 0 <= place <= len(last) - 22 else 0
    if 0 <= place64 <= len(last) - 56:
        size = max(size if size < 0xFFFFFFFF else 0, struct.unpack_from("<Q", last, place64 + 40)[0])
    if size > _MOST_DIRECTORY_BYTES:
        found = f"has a list of members of {format_size(size)}"
        raise UserError(str(path), found, expected=f"at most {_MOST_MEMBERS} arrays")
    archive = zipfile.ZipFile(file)
    if len(archive.infolist()) > _MOST_MEMBERS:
        raise UserError(str(path), f"has {len(archive.infolist())} members", expected=f"at most {_MOST_MEMBERS}")
    return archive


def read_npz_array(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of a .npz file. Raises UserError as `read_npy_header` does, and where it is too large for the memory."""
    where = f"{path}: {member.filename.removesuffix('.npy')}"
    with archive.open(member) as file:
        header = read_npy_header(file, member.file_size, where)
        require_memory(where, 2 * header.nbytes)
        return header.array(file.read(header.nbytes))


def read_window(
    path: Path,
    dtype: np.dtype[Any],
    shape: Sequence[int],
    offset: int,
    window: Sequence[slice],
    order: Literal["C", "F"] = "C",
) -> NDArray[Any]:
    """The window of an array whose numbers begin at byte `offset` of a file; a slice without steps for each axis.

    Raises UserError where the file ends before them, as one does that another program writes anew.
    """
    if order == "F":
        return read_window(path, dtype, shape[::-1], offset, window[::-1]).T
    out = np.empty([part.stop - part.start for part in window], dtype)
    with opened_file(path, _EXPECTED) as file:
        _fill(file, out, tuple(shape), offset, tuple(window), str(path))
    return out


def _fill(
    file: BinaryIO, out: NDArray[Any], shape: tuple[int, ...], offset: int, window: tuple[slice, ...], where: str
) -> None:
    """Reads a window into `out`: in one piece, by rows that are cut afterwards, or, of a small part, row by row."""
    if out.size == 0:
        return
    row_bytes = math.prod(shape[1:]) * out.itemsize
    start = offset + (window[0].start * row_bytes if window else 0)
    inner = window[1:]
    if all(part == slice(0, size) for part, size in zip(inner, shape[1:], strict=True)):
        _read_into(file, start, out, where)
    elif 4 * _span(shape[1:], inner) * out.itemsize < row_bytes or row_bytes > _PIECE_BYTES:
        for index in range(len(out)):
            _fill(file, out[index], shape[1:], start + index * row_bytes, inner, where)
    else:
        count = max(_PIECE_BYTES // row_bytes, 1)
        for first in range(0, len(out), count):
            rows = np.empty((min(count, len(out) - first), *shape[1:]), out.dtype)
            _read_into(file, start + first * row_bytes, rows, where)
            out[first : first + len(rows)] = rows[(slice(None), *inner)]


def _span(shape: tuple[int, ...], window: tuple[slice, ...]) -> int:
    """How many numbers stand from the first to the last one of a window."""
    strides = [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
    return 1 + sum((part.stop - part.start - 1) * stride for part, stride in zip(window, strides, strict=True))


def _read_into(file: BinaryIO, place: int, out: NDArray[Any], where: str) -> None:
    """Fills an array, contiguous in memory, with the bytes from a place of the file."""
    file.seek(place)
    got = file.readinto(out.reshape(-1).view(np.uint8).data)  # type: ignore[attr-defined]
    if got != out.nbytes:
        now = format_size(os.fstat(file.fileno()).st_size)
        found = f"became shorter while it was read: {now}"
        raise UserError(where, found, expected=f"{out.nbytes} bytes at byte {place}", remedy="read it again")
