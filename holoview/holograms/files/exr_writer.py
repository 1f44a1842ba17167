"""OpenEXR files in memory: channels of 32-bit floats in scan lines, one part or several, compressed without loss.

The layout is that of "OpenEXR File Layout" (openexr.com). OpenEXR's own library writes to named files only.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_MAGIC, _VERSION, _LONG_NAMES, _MULTIPART = 20000630, 2, 0x400, 0x1000
_FLOAT, _ZIP, _INCREASING_Y = 2, 3, 0
_LINES = 16  # of a block of ZIP compression
_SHORT_NAME = 31


@dataclass(frozen=True, eq=False)
class ExrPart:
    """channels: (y, x) of equal shapes, by name. texts: attributes by name. chromaticities: (x, y) of red, green, blue
    and white."""

    name: str
    channels: Mapping[str, NDArray[np.floating]]
    texts: Mapping[str, str] = field(default_factory=dict)
    chromaticities: Sequence[tuple[float, float]] = ()


def exr_bytes(parts: Sequence[ExrPart]) -> bytes:
    """The content of a file with these parts."""
    is_multipart = len(parts) > 1
    blocks = [list(_blocks(part)) for part in parts]
    headers = b"".join(_header(part, len(chunks), is_multipart) for part, chunks in zip(parts, blocks, strict=True))
    names = [name for part in parts for name in (*part.channels, *part.texts)]
    flags = _MULTIPART * is_multipart | _LONG_NAMES * any(len(name.encode()) > _SHORT_NAME for name in names)
    head = struct.pack("<II", _MAGIC, _VERSION | flags) + headers + b"\0" * is_multipart
    place = len(head) + 8 * sum(map(len, blocks))
    offsets, body = [], []
    for number, chunks in enumerate(blocks):
        for first_line, data in chunks:
            prefix = struct.pack("<i", number) if is_multipart else b""
            chunk = prefix + struct.pack("<ii", first_line, len(data)) + data
            offsets.append(place)
            body.append(chunk)
            place += len(chunk)
    return b"".join([head, struct.pack(f"<{len(offsets)}Q", *offsets), *body])


def _header(part: ExrPart, blocks: int, is_multipart: bool) -> bytes:
    rows, columns = next(iter(part.channels.values())).shape
    window = struct.pack("<4i", 0, 0, columns - 1, rows - 1)
    channels = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", _FLOAT, 0, 1, 1) for name in sorted(part.channels)
    )
    attributes = [
        ("channels", "chlist", channels + b"\0"),
        ("compression", "compression", bytes([_ZIP])),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", bytes([_INCREASING_Y])),
        ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
        *((name, "string", text.encode()) for name, text in part.texts.items()),
    ]
    if part.chromaticities:
        numbers = [number for xy in part.chromaticities for number in xy]
        attributes.append(("chromaticities", "chromaticities", struct.pack("<8f", *numbers)))
    if is_multipart:
        attributes += [
            ("name", "string", part.name.encode()),
            ("type", "string", b"scanlineimage"),
            ("chunkCount", "int", struct.pack("<i", blocks)),
        ]
    stated = (
        name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
        for name, kind, value in attributes
    )
    return b"".join(stated) + b"\0"


def _blocks(part: ExrPart) -> Iterator[tuple[int, bytes]]:
    """The first line and the data of each block of lines."""
    channels = [np.asarray(part.channels[name], dtype="<f4") for name in sorted(part.channels)]
    for first in range(0, channels[0].shape[0], _LINES):
        lines = np.stack([channel[first : first + _LINES] for channel in channels], axis=1)
        raw = np.ascontiguousarray(lines).view(np.uint8).ravel()
        halves = np.concatenate([raw[0::2], raw[1::2]])
        steps = halves.copy()
        steps[1:] = halves[1:] - halves[:-1] + np.uint8(128)
        packed = zlib.compress(steps.tobytes(), 4)
        yield first, packed if len(packed) < raw.size else raw.tobytes()
