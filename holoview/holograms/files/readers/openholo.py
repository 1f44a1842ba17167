"""OpenHolo's .ohc files: fields of any number of wavelengths with pitch and wavelengths in stated units.

The layout is that of OpenHolo's public headers (ImgCodecDefine.h): packed little-endian numbers. Three kinds of files
are in use: codes that count from 1, older ones that count from 0, and text files of version 0.2, whose numbers stand in
lines with CRLF. The samples follow each other as OpenHolo's generators hold them, row by row; programs that fill its
matrices by x first write column by column, which is what `ReadRequest.transposed` reads.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, Facts, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.memory_limit import require_memory

_FILE = struct.Struct("<2sQBBIII")
_FIELD = struct.Struct("<IIIddBIBBBBBBBddQB")
_UNITS = (1.0, 1e-2, 1e-3, 1e-6, 1e-9)
_TYPES = ("<i1", "<i2", "<i4", "<i8", "<u1", "<u2", "<u4", "<u8", "<f4", "<f8")
_COMPRESSED = len(_TYPES)
_CODES = (("amplitude", "phase"), ("real", "imaginary"), ("amplitude",), ("phase",))
_MOST_WAVELENGTHS = 256
_MOST_SIDE = 1 << 20
_TEXT_BYTES_A_NUMBER = 100
_EXPECTED = "an OpenHolo field"


@dataclass(frozen=True)
class _Header:
    """The header, with codes that count from 0. offset: where the data begins."""

    columns: int
    rows: int
    pitch_m: tuple[float, float]
    wavelengths_m: tuple[float, ...]
    is_planar: bool
    kind: int
    is_linked: bool
    roles: tuple[str, ...]
    is_phase_encoded: bool
    phase_range: tuple[float, float]
    offset: int

    @property
    def count(self) -> int:
        """Count of numbers in each part."""
        return self.rows * self.columns * len(self.wavelengths_m)

    @property
    def axes(self) -> str:
        """Axes of one part: whole planes one after another, or all wavelengths of each sample together."""
        return "cyx" if self.is_planar else "yxc"

    def shape(self, is_transposed: bool) -> tuple[int, ...]:
        """Sizes of one part, with y and x exchanged if it is transposed."""
        plane = (self.columns, self.rows) if is_transposed else (self.rows, self.columns)
        return (len(self.wavelengths_m), *plane) if self.is_planar else (*plane, len(self.wavelengths_m))


class OpenHoloReader:
    """The parts of an OpenHolo field, named by their quantities."""

    name = "OpenHolo .ohc"
    suffixes = (".ohc",)

    def recognises(self, head: bytes) -> bool:
        """Whether the signature is followed by a plausible size, as a number or as a line of text."""
        return head.startswith((b"OH\r\n", b"OH\n")) or (head.startswith(b"OH") and head[8:10] == b"\0\0")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The parts; of binary files a window is read when it is loaded."""
        head = read_bytes(path, _EXPECTED, most=1 << 16)
        is_text = head.startswith((b"OH\r\n", b"OH\n"))
        header = _read_text_header(path, head) if is_text else _read_header(path, head)
        if header.is_linked or header.kind == _COMPRESSED:
            found = "holds the names of other files, which aren't followed" if header.is_linked else "holds pictures"
            remedy = "open those files themselves as parts"
            raise UserError(str(path), found, expected="numbers in the file itself", remedy=remedy)
        shape = header.shape(bool(request.transposed))
        facts = Facts(header.pitch_m, header.wavelengths_m, phase_levels=2 * math.pi)
        if is_text:
            values = _text_values(path, header).reshape(-1, *shape)
            parts = [StoredArray.of(role, values[n], role, header.axes) for n, role in enumerate(header.roles)]
        else:
            parts = [_part(path, n, shape, header) for n in range(len(header.roles))]
        yield Contents.of(parts, facts)


def _part(path: Path, number: int, shape: tuple[int, ...], header: _Header) -> StoredArray:
    """One part of a binary file, with phases in radians."""
    role, dtype = header.roles[number], np.dtype(_TYPES[header.kind])
    offset = header.offset + number * header.count * dtype.itemsize
    stored = StoredArray.mapped(path, dtype, shape, offset, name=role, role=role, axes=header.axes)
    if role != "phase" or dtype.kind == "f" or not header.is_phase_encoded:
        return stored
    limits = np.iinfo(dtype)
    low, high = header.phase_range

    def load(window: Window) -> NDArray[Any]:
        share = (stored.load(window).astype(np.float64) - limits.min) / (float(limits.max) - limits.min)
        return np.pi * (low + share * (high - low))

    return replace(stored, dtype=np.dtype(np.float64), load=load)


def _text_values(path: Path, header: _Header) -> NDArray[Any]:
    count = len(header.roles) * header.count
    require_memory(str(path), path.stat().st_size + _TEXT_BYTES_A_NUMBER * count)
    words = read_bytes(path, _EXPECTED)[header.offset :].split(maxsplit=count)
    if len(words) < count:
        raise UserError(str(path), f"is truncated: {len(words)} numbers", expected=f"{count}")
    return np.array(words[:count], dtype=np.float64)


def _read_header(path: Path, head: bytes) -> _Header:
    if len(head) < _FILE.size + _FIELD.size:
        raise UserError(str(path), f"is truncated: {len(head)} bytes", expected=_EXPECTED)
    offset = _FILE.unpack_from(head)[-1]
    fields = _FIELD.unpack_from(head, _FILE.size)
    count = fields[6]
    end = _FILE.size + _FIELD.size + 8 * count
    if not 1 <= count <= _MOST_WAVELENGTHS or end > len(head):
        raise UserError(str(path), f"states {count} wavelengths", expected=f"1 to {_MOST_WAVELENGTHS}")
    wavelengths = struct.unpack_from(f"<{count}d", head, _FILE.size + _FIELD.size)
    return _checked(path, fields, wavelengths, offset if end <= offset <= path.stat().st_size else end, True)


def _read_text_header(path: Path, head: bytes) -> _Header:
    lines = head.split(b"\n", 7 + 18 + _MOST_WAVELENGTHS)
    texts = [line.strip(b"\r ") for line in lines]
    if len(texts) < 7 + 18 + 1:
        raise UserError(str(path), f"is truncated: {len(texts)} lines", expected=_EXPECTED)
    fields = [float(text) if number in (3, 4, 14, 15) else int(text) for number, text in enumerate(texts[7:25])]
    count = int(fields[6])
    if not 1 <= count <= _MOST_WAVELENGTHS or len(texts) < 25 + count:
        raise UserError(str(path), f"states {count} wavelengths", expected=f"1 to {_MOST_WAVELENGTHS}")
    wavelengths = tuple(float(text) for text in texts[25 : 25 + count])
    offset = sum(len(line) + 1 for line in lines[: 25 + count])
    return _checked(path, fields, wavelengths, offset, False)


def _checked(path: Path, fields: Sequence[Any], wavelengths: Sequence[float], offset: int, is_binary: bool) -> _Header:
    """The header, from codes that count from 1, or from 0 where only that fits the number of bytes."""
    columns, rows = fields[1:3]
    if not (0 < columns <= _MOST_SIDE and 0 < rows <= _MOST_SIDE):
        raise UserError(
            str(path), f"states {columns} × {rows} samples", expected=f"1 to {_MOST_SIDE} in each direction"
        )
    left = path.stat().st_size - offset
    headers = [h for base in (1, 0) if (h := _with_base(fields, wavelengths, offset, base)) is not None]
    for header in headers:
        needed = _needed(header)
        if not is_binary or header.is_linked or needed is None or needed == left:
            return header
    if not headers:
        raise UserError(str(path), "has unknown codes in its header", expected=_EXPECTED)
    needed = _needed(headers[0]) or 0
    if needed < left:
        return headers[0]
    raise UserError(str(path), f"is truncated: {left} bytes of numbers", expected=f"{needed} bytes")


def _needed(header: _Header) -> int | None:
    """Bytes of the numbers, None for pictures."""
    if header.kind == _COMPRESSED:
        return None
    return len(header.roles) * header.count * np.dtype(_TYPES[header.kind]).itemsize


def _with_base(fields: Sequence[Any], wavelengths: Sequence[float], offset: int, base: int) -> _Header | None:
    """The header if its codes count from `base`, None where one is out of range."""
    unit, colour, arrangement, wave_unit, kind, store, code = (
        int(fields[number]) - base for number in (5, 7, 8, 9, 10, 11, 12)
    )
    in_range = 0 <= unit < len(_UNITS) and 0 <= wave_unit < len(_UNITS) and 0 <= colour <= 1 and 0 <= arrangement <= 1
    if not in_range or not (0 <= kind <= _COMPRESSED and 0 <= store <= 1 and 0 <= code < len(_CODES)):
        return None
    return _Header(
        int(fields[1]),
        int(fields[2]),
        (fields[4] * _UNITS[unit], fields[3] * _UNITS[unit]),
        tuple(wavelength * _UNITS[wave_unit] for wavelength in wavelengths),
        arrangement == 1,
        kind,
        store == 1,
        _CODES[code],
        bool(fields[13]),
        (float(fields[14]), float(fields[15])),
        offset,
    )
