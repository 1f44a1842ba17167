"""NumPy's .npy and .npz files; pickled objects are refused."""

from __future__ import annotations

import os
import struct
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Literal

from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import opened_file
from holoview.util.memory_limit import format_size, require_memory
from holoview.util.plain_arrays import read_npy_header

_MOST_MEMBERS = 1000
_MOST_DIRECTORY_BYTES = 1 << 20  # of so many members with long names
_END_BYTES = 22 + 65_535 + 76  # the last records of an archive with the longest comment, those of ZIP64 among them


class NpyReader:
    """An array in a .npy file."""

    name = "NumPy .npy"
    suffixes = (".npy",)

    def recognises(self, head: bytes) -> bool:
        """Whether the magic string is there."""
        return head.startswith(b"\x93NUMPY")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The array; a window is read from the disk when it is loaded."""
        with opened_file(path, "an array of numbers") as file:
            header = read_npy_header(file, os.fstat(file.fileno()).st_size, str(path))
        if header.nbytes == 0:
            raise UserError(str(path), f"an array of shape {header.shape}", expected="at least one number")
        order: Literal["F", "C"] = "F" if header.is_fortran else "C"
        yield Contents.of([StoredArray.mapped(path, header.dtype, header.shape, header.offset, order)])


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
        with opened_file(path, "arrays of numbers") as opened, _archive(path, opened) as archive:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS:
                raise UserError(str(path), f"has {len(members)} members", expected=f"at most {_MOST_MEMBERS}")
            yield Contents.of(
                [_member(path, archive, member) for member in members if member.filename.endswith(".npy")]
            )


def _archive(path: Path, file: BinaryIO) -> zipfile.ZipFile:
    """The archive in a file. Its directory, which the library reads at once, is short, or UserError is raised."""
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
    return zipfile.ZipFile(file)


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> StoredArray:
    name = member.filename.removesuffix(".npy")
    where = f"{path}: {name}"
    with archive.open(member) as file:
        header = read_npy_header(file, member.file_size, where)

    unpacked: list[NDArray[Any]] = []

    def load(window: Window) -> NDArray[Any]:
        if not unpacked:
            require_memory(where, 2 * header.nbytes)
            with archive.open(member) as file:
                file.seek(header.offset)
                unpacked.append(header.array(file.read(header.nbytes)))
        return unpacked[0][window]

    return StoredArray(name, header.shape, header.dtype, load, whole_bytes=2 * header.nbytes)
