"""Animated pictures: PNG (APNG) and GIF, which need no further library, and MP4 with the extra "export"."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.io.png import png_chunks
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.optional_library import import_optional

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
        return _encode_png
    if suffix == ".gif":
        return _encode_gif
    if suffix == ".mp4":
        return _mp4_encoder()
    raise UserError("animation", f'the suffix "{suffix}"', expected=" or ".join(SUFFIXES))


def _encode_png(frames: list[Pixels], seconds: float, texts: Mapping[str, str]) -> bytes:
    return _encode_by_pillow("PNG", frames, seconds, pnginfo=png_chunks(texts))


def _encode_gif(frames: list[Pixels], seconds: float, texts: Mapping[str, str]) -> bytes:
    return _encode_by_pillow("GIF", frames, seconds)


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
