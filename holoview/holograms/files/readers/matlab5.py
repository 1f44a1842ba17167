"""MATLAB's files of versions 5 to 7.2, read by scipy; variables are unpacked here, within their stated sizes.

Layout: MathWorks, "MAT-File Format", level 5: 128 bytes of text and version, then tagged elements, each a matrix or a
compressed matrix. scipy unpacks without a limit, follows structures of any depth, and makes cells and structures of
any size that is declared, so that it only gets elements that have been walked through before: whose parts end where
they say, aren't too deep, and are as many as there are bytes for.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

_HEADER_BYTES = 128
_CHAR, _MOST_TEXT_BYTES = 4, 1000  # of a text that is looked at
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 5, 16, 17
_NUMBERS = {
    6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"
}  # fmt: skip
_COMPLEX_FLAG = 0x0800
_UNREADABLE = {3: "an object", 5: "a sparse matrix", 16: "a function", 17: "an object"}
_MOST_DEPTH = 8
_MOST_VARIABLES = 1000
_MOST_MATRICES = 100_000  # cells and fields of a variable
_HEAD_OF_VARIABLE = 4096  # bytes in which flags, sizes and name stand


@dataclass(frozen=True)
class _Variable:
    """The place of a variable and what its header states. size: of the element without compression, with its tag."""

    name: str
    kind: int
    is_complex: bool
    shape: tuple[int, ...]
    offset: int
    stored: int
    size: int
    is_compressed: bool


class Matlab5Reader:
    """Variables of a MATLAB file, of structures their fields."""

    name = "MATLAB 5"
    suffixes = (".mat",)

    def recognises(self, head: bytes) -> bool:
        """Whether version and byte order stand at the end of the header's text."""
        return len(head) >= _HEADER_BYTES and head[124:128] in (b"\x00\x01IM", b"\x01\x00MI")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """Numerical variables by name, read when they are loaded; structures are read at once."""
        with path.open("rb") as file:
            order = "<" if file.read(_HEADER_BYTES)[126:] == b"IM" else ">"
            arrays: list[StoredArray] = []
            notes: list[str] = []
            for variable in _list_variables(path, file, order):
                if variable.kind in _NUMBERS:
                    arrays.append(_stored(path, variable, order))
                elif variable.kind in (_STRUCT, _CELL) or (
                    variable.kind == _CHAR and variable.size <= _MOST_TEXT_BYTES
                ):
                    arrays += _flatten(variable.name, _load(path, variable, order), 0)
                elif variable.kind in _UNREADABLE:
                    notes.append(f'the variable "{variable.name}" is {_UNREADABLE[variable.kind]} of MATLAB: not read')
            contents = Contents.of(arrays, notes=tuple(notes))
            if not contents.arrays and notes:
                remedy = "save its array of numbers as a variable of its own"
                raise UserError(str(path), notes[0], expected="an array of numbers", remedy=remedy)
            yield contents


def _list_variables(path: Path, file: io.BufferedReader, order: str) -> Iterator[_Variable]:
    end = path.stat().st_size
    offset, count = _HEADER_BYTES, 0
    while offset + 8 <= end:
        file.seek(offset)
        kind, size = struct.unpack(f"{order}II", file.read(8))
        if offset + 8 + size > end:
            found = f"is truncated: a variable of {size} bytes begins at byte {offset} of {end}"
            raise UserError(str(path), found, expected="a whole MATLAB file")
        if (count := count + 1) > _MOST_VARIABLES:
            raise UserError(str(path), f"more than {_MOST_VARIABLES} variables", expected="a hologram's file")
        head = file.read(min(size, _HEAD_OF_VARIABLE))
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(head, _HEAD_OF_VARIABLE)
            inner, length = struct.unpack(f"{order}II", unpacked[:8])
            if inner == _MATRIX:
                yield _variable(unpacked[8:], order, offset + 8, size, length + 8, True)
        elif kind == _MATRIX:
            yield _variable(head, order, offset, size + 8, size + 8, False)
        offset += 8 + size


def _variable(head: bytes, order: str, offset: int, stored: int, size: int, is_compressed: bool) -> _Variable:
    """The variable whose header begins with these bytes. Raises ValueError and struct.error for damaged ones."""
    (flags,) = struct.unpack(f"{order}I", head[8:12])
    kind, place = flags & 0xFF, 16
    if kind == 17:  # an opaque object has no sizes; its name follows
        name, _ = _element(head, place, order)
        return _Variable(_text(name), kind, False, (), offset, stored, size, is_compressed)
    sizes, place = _element(head, place, order)
    name, _ = _element(head, place, order)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes[: len(sizes) // 4 * 4])
    if min(shape, default=0) < 0:
        raise ValueError(f"an array of shape {shape}")
    return _Variable(_text(name), kind, bool(flags & _COMPLEX_FLAG), shape, offset, stored, size, is_compressed)


def _text(data: bytes) -> str:
    return data.decode("latin-1").rstrip("\x00")


def _element(data: bytes, place: int, order: str) -> tuple[bytes, int]:
    """The content of the element at a place, and the place of the next one; short ones stand in their tag."""
    kind, size = struct.unpack(f"{order}II", data[place : place + 8])
    if kind >> 16:
        size = kind >> 16
        return data[place + 4 : place + 4 + size], place + 8
    return data[place + 8 : place + 8 + size], place + 8 + (size + 7) // 8 * 8


def _stored(path: Path, variable: _Variable, order: str) -> StoredArray:
    dtype = np.dtype(_NUMBERS[variable.kind])
    if variable.is_complex:
        dtype = np.dtype("c8") if variable.kind == 7 else np.dtype("c16")
    wanted = int(np.prod(variable.shape, dtype=object))
    if wanted > variable.size:  # each number takes a byte at least
        found = f"an array of shape {variable.shape} in {variable.size} bytes"
        raise UserError(f"{path}: {variable.name}", found, expected="all of its numbers")

    loaded: list[NDArray[Any]] = []

    def load(window: Window) -> NDArray[Any]:
        if not loaded:
            values = _load(path, variable, order)
            if not isinstance(values, np.ndarray) or values.shape != variable.shape or values.dtype.kind not in "biufc":
                raise ValueError(f"the variable {variable.name} isn't the array that its header states")
            loaded.append(values)
        return loaded[0][window]

    whole = variable.size + 2 * wanted * dtype.itemsize
    return StoredArray(variable.name, variable.shape, dtype, load, whole_bytes=whole)


def _load(path: Path, variable: _Variable, order: str) -> Any:
    """The variable as scipy reads it, from a file in memory that holds nothing else."""
    where = f"{path}: {variable.name}"
    require_memory(where, 4 * variable.size)
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
        file.seek(variable.offset)
        data = file.read(variable.stored)
    if variable.is_compressed:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(data, variable.size)
        if len(data) < variable.size or unpacker.decompress(unpacker.unconsumed_tail, 1):
            found = (
                f"unpacks to {'more' if len(data) == variable.size else 'less'} than the stated {variable.size} bytes"
            )
            raise UserError(where, found, expected="a whole MATLAB file")
    _Elements(where, data, order).check()
    from scipy.io import loadmat  # slow start: other files do without

    read = loadmat(io.BytesIO(head + data), chars_as_strings=False)
    return read.get(variable.name)


class _Elements:
    """The element of a variable, in which scipy would follow what is declared; `check` follows it in the same order."""

    def __init__(self, where: str, data: bytes, order: str) -> None:
        self._where, self._data, self._order = where, data, order
        self._matrices = 0

    def check(self) -> None:
        """Raises UserError for matrices that are too deep or many, or that hold more than their bytes can."""
        self._matrix(0, len(self._data), 0)

    def _matrix(self, place: int, end: int, depth: int) -> int:
        """Checks the matrix at a place; returns where it ends."""
        if depth > _MOST_DEPTH:
            raise self._error(f"structures more than {_MOST_DEPTH} deep inside each other")
        self._matrices += 1
        if self._matrices > _MOST_MATRICES:
            raise self._error(f"more than {_MOST_MATRICES} cells and fields")
        kind, size = self._unpack("II", place)
        stop = place + 8 + size
        if kind != _MATRIX or stop > end:
            raise self._error(f"an element of type {kind} and {size} bytes at byte {place} of {end}")
        if size == 0:
            return stop
        kind = self._unpack("I", place + 16)[0] & 0xFF
        count, place = 1, place + 24
        if kind != _OPAQUE:
            (first, last), place = self._part(place, stop)
            sizes = self._unpack(f"{(last - first) // 4}i", first)
            count = int(np.prod(sizes, dtype=object))
            if min(sizes, default=0) < 0 or (count > size and kind != _SPARSE):
                raise self._error(f"an array of shape {sizes} in {size} bytes")
        _, place = self._part(place, stop)  # the name
        place = self._content(kind, count, place, stop, depth)
        if place > stop or (depth and stop - place >= 8):
            raise self._error(f"a matrix that ends at byte {place} and says {stop}")
        return stop

    def _content(self, kind: int, count: int, place: int, stop: int, depth: int) -> int:
        """Checks what follows a matrix's name; returns the place behind it."""
        texts = {_OBJECT: 1, _OPAQUE: 2}.get(kind, 0)  # names of classes
        for _ in range(texts):
            _, place = self._part(place, stop)
        if kind in (_STRUCT, _OBJECT):
            (first, _), place = self._part(place, stop)
            (length,) = self._unpack("i", first)
            (first, last), place = self._part(place, stop)
            fields = (last - first) // length if length > 0 else 0
            count = count * fields
        if kind in (_CELL, _STRUCT, _OBJECT, _FUNCTION, _OPAQUE):
            if 8 * count > stop - place:
                raise self._error(f"{count} cells or fields in {stop - place} bytes")
            for _ in range(1 if kind in (_FUNCTION, _OPAQUE) else count):
                place = self._matrix(place, stop, depth + 1)
            return place
        held = 0
        while place + 8 <= stop:
            (first, last), place = self._part(place, stop)
            held = max(held, last - first)
        if kind != _SPARSE and count > held:  # each number takes a byte at least
            raise self._error(f"{count} numbers in {held} bytes")
        return place

    def _part(self, place: int, stop: int) -> tuple[tuple[int, int], int]:
        """First and last byte of the content of the element at a place, and the place of the next one."""
        kind, size = self._unpack("II", place)
        if kind >> 16:
            first, last, after = place + 4, place + 4 + (kind >> 16), place + 8
        else:
            first, last, after = place + 8, place + 8 + size, place + 8 + (size + 7) // 8 * 8
        if last > stop or (kind >> 16) > 4:
            raise self._error(f"an element of {last - first} bytes at byte {place} of {stop}")
        return (first, last), min(after, stop)

    def _unpack(self, form: str, place: int) -> tuple[int, ...]:
        return struct.unpack_from(f"{self._order}{form}", self._data, place)

    def _error(self, found: str) -> UserError:
        return UserError(self._where, f"declares {found}", expected="a whole MATLAB file", remedy="save it again")


def _flatten(name: str, value: Any, depth: int) -> Iterator[StoredArray]:
    """The arrays in a structure or a cell by their names with dots, such as CGH.setup.pp."""
    if not isinstance(value, np.ndarray) or depth > _MOST_DEPTH:
        return
    if value.dtype.names:
        for index, record in enumerate(value.ravel()[:_MOST_VARIABLES]):
            prefix = name if value.size == 1 else f"{name}({index + 1})"
            for key in value.dtype.names:
                yield from _flatten(f"{prefix}.{key}", record[key], depth + 1)
    elif value.dtype.kind == "O":
        for index, inner in enumerate(value.ravel()[:_MOST_VARIABLES]):
            yield from _flatten(f"{name}{{{index + 1}}}", inner, depth + 1)
    elif value.dtype.kind in "biufcU":
        yield StoredArray.of(name, value)
