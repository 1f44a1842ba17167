"""Pictures and modulator patterns as files.

PNG         views with metadata in text chunks, patterns of modulators, pictures of 16 bits with their colour space
animations  APNG and GIF, which need no further library, and MP4 with the extra "export"
cells       the bits in the memory cells of a phase light modulator for a picture of levels
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from holoview.holograms.files.image_reader import file_format, read_raster
from holoview.light.colour import ColourSpace
from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import write_file
from holoview.util.files import opened_file
from holoview.util.packages import __version__, import_optional


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


PATH_PATTERN = "0…max is 0…stroke"
"""What a PNG says of a pattern whose grey levels stand for optical paths."""


def pattern_pixels(drive: NDArray[np.floating], bits: int) -> NDArray[np.uint8 | np.uint16]:
    """The grey levels (y, x), 0…maximum, of a drive (y, x) in 0…1 of the stroke. bits: 8 or 16 a pixel.

    Raises UserError for other numbers of bits and for values outside 0…1.
    """
    if bits not in (8, 16):
        raise UserError("bits", str(bits), expected="8 or 16")
    if not (drive.ndim == 2 and np.all((drive >= 0) & (drive <= 1))):
        raise UserError("drive", "values outside 0…1, or not (y, x)", expected="fractions of the modulator's stroke")
    levels = np.rint(drive.astype(np.float64) * (2**bits - 1))
    return levels.astype(np.uint8) if bits == 8 else levels.astype(np.uint16)


def write_bmp(path: str | os.PathLike[str], pixels: NDArray[np.uint8]) -> None:
    """Writes grey pixels (y, x) of 8 bits as BMP, atomically. Raises UserError when the file can't be written."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="BMP")
    write_file(path, buffer.getbuffer())


def read_pattern(path: str | os.PathLike[str], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Reads the pattern of one modulator: drive (y, x) float32 in 0…1 of the stroke.

    path: a greyscale PNG of 8 or 16 bits, or a colour PNG whose channels are equal.
    shape: (rows, columns) that it must have.

    Raises UserError for a file that is missing, isn't a PNG, is coloured or transparent, or has another shape.
    """
    file = Path(path)
    if file_format(file) != "PNG":
        raise UserError(str(path), "isn't a PNG", expected="a pattern as greyscale PNG of 8 or 16 bits")
    raster = read_raster(file, white=65535)  # its levels are shares of the stroke, of which few may be used
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
        with opened_file(path, "a picture") as file, Image.open(file, formats=("PNG",)) as image:
            texts = {str(key): str(value) for key, value in image.info.items() if isinstance(value, str)}
    except (OSError, ValueError, SyntaxError):
        return {}
    return texts if texts.get("Software", "").startswith("holoview") else {}


def path_with_suffix(path: Path, suffix: str) -> Path:
    """The path of one of several files: "out.png" with the suffix "10mm" is "out-10mm.png"."""
    return path.with_name(f"{path.stem}-{suffix}{path.suffix}")


# --- animations -------------------------------------------------------------------------------------------------------


SUFFIXES = (".png", ".gif", ".mp4")
MAX_FRAMES = 1200
Pixels = NDArray[np.uint8]
Encoder = Callable[[Sequence[Pixels], Mapping[str, str]], None]
_Encode = Callable[[list[Pixels], float, Mapping[str, str]], bytes]


def open_encoder(path: Path, frames: int, seconds: float) -> Encoder:
    """A function that writes frames, 8-bit sRGB (y, x, 3), as an animation by the suffix of `path`, atomically.

    frames, seconds: how many there will be, and how long all of them together are shown. Its second argument are texts
    {keyword: text} that a PNG keeps. GIF has 256 colours; MP4 loses the last row or column of an odd number.

    Raises UserError for another suffix than those of SUFFIXES, for numbers out of range, and for MP4 without the
    libraries of the extra "export"; the function does when the file can't be written.
    """
    if not (1 <= frames <= MAX_FRAMES and 0.1 <= seconds <= 600):
        expected = f"1 to {MAX_FRAMES} frames, 0.1 to 600 s"
        raise UserError("animation", f"{frames} frames in {seconds:g} s", expected=expected)
    encode = _encoder(path.suffix.lower())

    def write(pixels: Sequence[Pixels], texts: Mapping[str, str]) -> None:
        write_file(path, encode(list(pixels), seconds, texts))

    return write


def _encoder(suffix: str) -> _Encode:
    if suffix == ".png":
        return lambda frames, s, texts: _encode_by_pillow("PNG", frames, s, pnginfo=png_chunks(texts))
    if suffix == ".gif":
        return lambda frames, s, texts: _encode_by_pillow("GIF", frames, s)
    if suffix == ".mp4":
        return _mp4_encoder()
    raise UserError("animation", f'the suffix "{suffix}"', expected=" or ".join(SUFFIXES))


def _encode_by_pillow(name: str, frames: list[Pixels], seconds: float, **options: Any) -> bytes:
    first, *others = map(Image.fromarray, frames)
    buffer, each_ms = io.BytesIO(), 1000.0 * seconds / len(frames)
    first.save(buffer, format=name, save_all=True, append_images=others, duration=each_ms, loop=0, **options)
    return buffer.getvalue()


def _mp4_encoder() -> _Encode:
    """A function that writes MP4 by imageio and PyAV, which imageio loads. Raises UserError if one isn't installed."""
    import_optional("av", "an .mp4 file")
    writer = import_optional("imageio.v3", "an .mp4 file")

    def encode(frames: list[Pixels], seconds: float, texts: Mapping[str, str]) -> bytes:
        stack = np.stack([_crop_to_even(frame) for frame in frames])
        rate = len(frames) / seconds
        encoded: bytes = writer.imwrite("<bytes>", stack, extension=".mp4", plugin="pyav", codec="libx264", fps=rate)
        return encoded

    return encode


def _crop_to_even(pixels: Pixels) -> Pixels:
    """Crops to an even number of rows and columns, which video codecs require."""
    rows, columns = pixels.shape[:2]
    return pixels[: rows - rows % 2, : columns - columns % 2]


# --- memory cells -----------------------------------------------------------------------------------------------------

# A pixel of a TI phase light modulator lies over 2 × 2 binary memory cells. A level, counted in rising order of optical
# path, has a 4-bit code. One bit of it goes to each cell of the pixel, and some devices mirror the picture of cells
# left to right. The tables of "p67" (the 0.67-inch device, DLP6750) are those that TI publishes with its MIT-licensed
# Python package ti_plm 1.1.


@dataclass(frozen=True)
class CellMap:
    """How a device stores levels.

    level_codes: code of each level, in rising order of optical path.
    bit_of_cell: which bit of the code the cell in each row and column of a pixel holds.
    mirrored: whether the picture of cells is mirrored left to right.
    """

    level_codes: tuple[int, ...]
    bit_of_cell: tuple[tuple[int, ...], ...]
    mirrored: bool


CELL_MAPS = {
    "p67": CellMap(
        level_codes=(3, 2, 1, 7, 0, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12), bit_of_cell=((1, 3), (0, 2)), mirrored=True
    )
}


def memory_cells(levels: NDArray[np.integer], device: str) -> NDArray[np.uint8]:
    """The bits, 0 or 1, of all memory cells, (2·rows, 2·columns).

    levels: (rows, columns) level of each pixel, counted from 0.
    device: a key of `CELL_MAPS`.

    Raises UserError for an unknown device and for levels that it doesn't have.
    """
    if device not in CELL_MAPS:
        raise UserError(
            "cells", f'"{device}"', expected=", ".join(CELL_MAPS), remedy=suggest_matches(device, CELL_MAPS)
        )
    cell_map = CELL_MAPS[device]
    highest = len(cell_map.level_codes) - 1
    if levels.min() < 0 or levels.max() > highest:
        found = f"levels from {levels.min()} to {levels.max()}"
        raise UserError("cells", found, expected=f"0 to {highest}, the levels of {device}")
    codes = np.array(cell_map.level_codes, dtype=np.uint8)[levels]
    shifts = np.array(cell_map.bit_of_cell, dtype=np.uint8)
    bits = (codes[:, None, :, None] >> shifts[None, :, None, :]) & 1
    cells = bits.reshape(len(levels) * shifts.shape[0], -1)
    return cells[:, ::-1] if cell_map.mirrored else cells
