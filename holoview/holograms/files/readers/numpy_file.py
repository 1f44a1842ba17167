"""NumPy's .npy and .npz files; pickled objects are refused."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import opened_file
from holoview.util.plain_arrays import open_npz, read_npy_header, read_npz_array


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
        with opened_file(path, "arrays of numbers") as opened, open_npz(path, opened) as archive:
            members = archive.infolist()
            yield Contents.of(
                [_member(path, archive, member) for member in members if member.filename.endswith(".npy")]
            )


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> StoredArray:
    name = member.filename.removesuffix(".npy")
    where = f"{path}: {name}"
    with archive.open(member) as file:
        header = read_npy_header(file, member.file_size, where)

    unpacked: list[NDArray[Any]] = []

    def load(window: Window) -> NDArray[Any]:
        if not unpacked:
            unpacked.append(read_npz_array(path, archive, member))
        return unpacked[0][window]

    return StoredArray(name, header.shape, header.dtype, load, whole_bytes=2 * header.nbytes)
