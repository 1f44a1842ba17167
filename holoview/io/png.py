"""PNG files: rendered views with metadata in text chunks, and patterns of modulators."""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from holoview.colour import ColourSpace
from holoview.targets.image_reader import file_format, read_raster
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.version import __version__


def write_png(path: str | os.PathLike[str], pixels: NDArray[np.uint8 | np.uint16], texts: Mapping[str, str]) -> None:
    """Writes pixels, (y, x, 3) of 8 bits or (y, x) of 8 or 16 bits, atomically.

    texts: {keyword: text} of international text chunks (iTXt), beside "Software", which names holoview's version.

    Raises UserError when the file can't be written.
    """
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", pnginfo=png_chunks(texts))
    write_file(path, buffer.getbuffer())


def write_deep_png(
    path: str | os.PathLike[str], signal: NDArray[np.floating], space: ColourSpace, texts: Mapping[str, str]
) -> None:
    """Writes a picture (y, x, 3) of 16 bits a channel, atomically, whose file says its colour space.

    signal: 0 to 1, with the curve of `space`. The chunk cICP (PNG, third edition) names the space by the code points of
    ITU-T H.273; cHRM has its primaries for older readers. texts: as for `write_png`.

    Raises UserError when the file can't be written.
    """
    rows, columns = signal.shape[:2]
    codes = np.rint(np.clip(signal, 0.0, 1.0) * 65535).astype(">u2").reshape(rows, -1)
    lines = np.zeros((rows, 1 + 6 * columns), np.uint8)  # each begins with its filter, 0: none
    lines[:, 1:] = codes.view(np.uint8)
    white_and_primaries = ((0.3127, 0.3290), *space.chromaticities)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, 16, 2, 0, 0, 0)),
        (b"cICP", bytes([*space.code_points, 0, 1])),
        (b"cHRM", b"".join(struct.pack(">II", *(round(c * 100_000) for c in xy)) for xy in white_and_primaries)),
        *((name, data) for name, data, *_ in png_chunks(texts).chunks),
        (b"IDAT", zlib.compress(lines.tobytes(), 6)),
        (b"IEND", b""),
    ]
    framed = (
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    )
    write_file(path, b"\x89PNG\r\n\x1a\n" + b"".join(framed))


def png_chunks(texts: Mapping[str, str]) -> PngInfo:
    """The chunks of a PNG that hold texts, beside "Software"; see `write_png`."""
    chunks = PngInfo()
    for key, value in ({"Software": f"holoview {__version__}"} | dict(texts)).items():
        chunks.add_itxt(key, value, zip=len(value) > 200)
    return chunks


def write_pattern(
    path: str | os.PathLike[str], drive: NDArray[np.floating], bits: int = 8, texts: Mapping[str, str] | None = None
) -> None:
    """Writes the pattern of one modulator as a greyscale PNG, whose 0…maximum stands for 0…stroke.

    drive: (y, x) in 0…1 of the stroke.
    bits: 8 or 16 a pixel.
    texts: further text chunks.

    Raises UserError for other numbers of bits and for values outside 0…1.
    """
    if bits not in (8, 16):
        raise UserError("bits", str(bits), expected="8 or 16")
    if not (drive.ndim == 2 and np.all((drive >= 0) & (drive <= 1))):
        raise UserError("drive", "values outside 0…1, or not (y, x)", expected="fractions of the modulator's stroke")
    levels = np.rint(drive.astype(np.float64) * (2**bits - 1))
    pixels = levels.astype(np.uint8) if bits == 8 else levels.astype(np.uint16)
    write_png(path, pixels, {"holoview.pattern": "0…max is 0…stroke"} | dict(texts or {}))


def read_pattern(path: str | os.PathLike[str], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Reads the pattern of one modulator: drive (y, x) float32 in 0…1 of the stroke.

    path: a greyscale PNG of 8 or 16 bits, or a colour PNG whose channels are equal.
    shape: (rows, columns) that it must have.

    Raises UserError for a file that is missing, isn't a PNG, is coloured or transparent, or has another shape.
    """
    file = Path(path)
    if file_format(file) != "PNG":
        raise UserError(str(path), "isn't a PNG", expected="a pattern as greyscale PNG of 8 or 16 bits")
    raster = read_raster(file)
    if np.any(raster.values != raster.values[..., :1]):
        raise UserError(str(path), "is a coloured picture", expected="a greyscale pattern, 0…max for 0…stroke")
    if raster.alpha is not None and np.any(raster.alpha != 1):
        raise UserError(str(path), "is partly transparent", expected="a greyscale pattern without alpha")
    if raster.values.shape[:2] != shape:
        found, expected = (f"{columns} x {rows} pixels" for rows, columns in (raster.values.shape[:2], shape))
        raise UserError(str(path), found, expected=f"{expected}, one a modulator pixel", remedy="or change the preset")
    return raster.values[..., 0].astype(np.float32)


def png_texts(path: str | os.PathLike[str]) -> dict[str, str]:
    """The text chunks of a PNG that holoview wrote; none for any other file."""
    try:
        with Image.open(path, formats=["PNG"]) as image:
            texts = {str(key): str(value) for key, value in image.info.items() if isinstance(value, str)}
    except (OSError, ValueError, SyntaxError):
        return {}
    return texts if texts.get("Software", "").startswith("holoview") else {}


def path_with_suffix(path: Path, suffix: str) -> Path:
    """The path of one of several files: "out.png" with the suffix "10mm" is "out-10mm.png"."""
    return path.with_name(f"{path.stem}-{suffix}{path.suffix}")
