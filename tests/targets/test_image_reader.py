"""PNG files of 16 bits are decoded to the last bit, whatever their colours, filters and order of pixels."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.files.image_reader import decode_deep_png, picture_count

ADAM7 = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
"""First row and column, and the steps between rows and columns, of the passes of an interlaced file (PNG, 8.2)."""
COLOUR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}


def noise(channels: int) -> NDArray[np.uint16]:
    return np.random.default_rng(channels).integers(0, 1 << 16, (11, 13, channels), dtype=np.uint16)


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def interlaced_png(samples: NDArray[np.uint16], transparent: tuple[int, ...] = ()) -> bytes:
    """An interlaced file without filters. transparent: a colour that it states to be transparent."""
    rows, columns, channels = samples.shape
    header = struct.pack(">IIBBBBB", columns, rows, 16, COLOUR_TYPES[channels], 0, 0, 1)
    passes = [samples[y::dy, x::dx] for y, x, dy, dx in ADAM7]
    lines = b"".join(b"\0" + row.astype(">u2").tobytes() for part in passes if part.size for row in part)
    stated = chunk(b"tRNS", struct.pack(f">{len(transparent)}H", *transparent)) if transparent else b""
    signature = b"\x89PNG\r\n\x1a\n"
    return signature + chunk(b"IHDR", header) + stated + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")


@pytest.mark.parametrize("channels", COLOUR_TYPES)
def test_every_bit_is_kept(channels: int) -> None:
    samples = noise(channels)
    smooth = np.sort(samples, axis=1)  # for other filters than noise
    for image in (samples, smooth):
        decoded = decode_deep_png(imagecodecs.png_encode(image[..., 0] if channels == 1 else image))
        assert decoded.dtype == np.uint16 and np.array_equal(decoded.reshape(image.shape), image)


@pytest.mark.parametrize("channels", COLOUR_TYPES)
def test_an_interlaced_file_is_the_same_picture(channels: int) -> None:
    samples = noise(channels)
    assert np.array_equal(decode_deep_png(interlaced_png(samples)).reshape(samples.shape), samples)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_transparent_colour_becomes_alpha_as_libpng_makes_it(channels: int) -> None:
    samples = noise(channels)
    data = interlaced_png(samples, tuple(int(value) for value in samples[4, 5]))
    decoded = decode_deep_png(data)
    assert decoded[4, 5, -1] == 0 and (decoded[..., -1] == 0xFFFF).sum() == 11 * 13 - 1
    assert np.array_equal(decoded, imagecodecs.png_decode(data))


@pytest.mark.parametrize("channels", COLOUR_TYPES)
def test_a_file_that_breaks_off_is_an_error(channels: int) -> None:
    data = interlaced_png(noise(channels))
    with pytest.raises((OSError, ValueError, SyntaxError)):
        decode_deep_png(data[: len(data) // 2])


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_no_process_counts_the_pictures_of_a_format_that_holds_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    Image.fromarray(np.zeros((4, 6, 3), np.uint8)).save(tmp_path / name)
    monkeypatch.delattr("os.fork", raising=False)
    assert picture_count(tmp_path / name) == 1
