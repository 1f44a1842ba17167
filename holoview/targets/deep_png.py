"""Decodes PNG files of 16 bits a sample, which Pillow alone reduces to 8 bits unless they are grey."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
from numpy.typing import NDArray
from PIL import Image

_COLOUR_TYPE = 25  # offset in the file; the bit depth stands before it
_HEADER = slice(12, 29)  # of the first chunk, IHDR: its name and content, of which its checksum is made
_GREY_ALPHA, _RGBA = 4, 6


def decode_deep_png(data: bytes) -> NDArray[np.uint16]:
    """The samples (y, x) or (y, x, 2 to 4) of a PNG file of 16 bits: grey, grey and alpha, RGB, RGB and alpha.

    A transparent colour that the file states becomes an alpha channel.
    Raises OSError, ValueError or SyntaxError for damaged data.
    """
    if data[_COLOUR_TYPE] == _GREY_ALPHA:
        # two samples of 16 bits are four bytes, like a pixel of 8-bit RGB and alpha, in compression too
        header = data[_HEADER][:12] + bytes((8, _RGBA)) + data[_HEADER][14:]
        data = data[: _HEADER.start] + header + struct.pack(">I", zlib.crc32(header)) + data[_HEADER.stop + 4 :]
        with Image.open(io.BytesIO(data)) as image:
            return np.ascontiguousarray(image).view(">u2").astype(np.uint16)
    with Image.open(io.BytesIO(data)) as image:
        mode, transparent = image.mode, image.info.get("transparency")
        samples = np.asarray(image).astype(np.uint16) if mode.startswith("I") else _colours(data, mode)
    if transparent is None:
        return samples
    colours = samples[..., None] if samples.ndim == 2 else samples
    opaque = (colours != np.asarray(transparent)).any(axis=-1, keepdims=True)
    return np.concatenate([colours, np.where(opaque, np.uint16(0xFFFF), np.uint16(0))], axis=-1)


def _colours(data: bytes, mode: str) -> NDArray[np.uint16]:
    """Samples of "RGB" or "RGBA": Pillow keeps one byte of each, the first or the second by the order it is told."""
    high, low = (_first_bytes(data, f"{mode};16{order}") for order in ("B", "L"))
    return high.astype(np.uint16) << np.uint16(8) | low


def _first_bytes(data: bytes, raw_mode: str) -> NDArray[np.uint8]:
    with Image.open(io.BytesIO(data)) as image:
        image.tile = [tile._replace(args=raw_mode) for tile in image.tile]
        return np.asarray(image)
