"""PNG files out and in: what is seen, with the setting that made it in text chunks; and modulator patterns."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from holoview.errors import UserError
from holoview.files import replacing

_LARGEST = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}


def write_png(path: str | os.PathLike[str], pixels: NDArray[np.uint8 | np.uint16], texts: Mapping[str, str]) -> None:
    """Writes (y, x, 3) 8-bit or (y, x) 8- or 16-bit pixels, whole or not at all, with `texts` as text chunks."""
    chunks = PngInfo()
    for key, value in texts.items():
        chunks.add_itxt(key, value, zip=len(value) > 200)
    with replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", pnginfo=chunks)


def write_pattern(path: str | os.PathLike[str], drive: NDArray[np.floating], bits: int = 8) -> None:
    """Writes one modulator's drive (y, x) in 0…1 as a greyscale PNG of 8 or 16 bits: 0…max stands for 0…stroke."""
    if bits not in (8, 16):
        raise UserError("bits", str(bits), expected="8 or 16")
    dtype = np.dtype(np.uint8 if bits == 8 else np.uint16)
    write_png(path, np.rint(drive * _LARGEST[dtype]).astype(dtype), {"holoview.pattern": "0…max is 0…stroke"})


def read_pattern(path: str | os.PathLike[str], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Drive (y, x) in 0…1 of a greyscale PNG of 8 or 16 bits, or of a colour one whose channels are equal.

    Raises UserError for a file that is missing, isn't a picture, is coloured, or isn't of `shape` (rows, columns).
    """
    try:
        with Image.open(path) as image:
            image.load()
            pixels = np.asarray(image.convert("RGB") if image.mode in ("P", "RGBA", "LA", "1") else image)
    except FileNotFoundError as error:
        raise UserError(str(path), "no such file", expected="a pattern as PNG") from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        raise UserError(str(path), f"isn't a picture that can be read: {error}", expected="a pattern as PNG") from error
    if pixels.ndim == 3:
        if np.any(pixels != pixels[..., :1]):
            raise UserError(str(path), "is a coloured picture", expected="a greyscale pattern, 0…max for 0…stroke")
        pixels = pixels[..., 0]
    if pixels.dtype == np.int32:  # how Pillow opens some 16-bit files
        pixels = pixels.astype(np.uint16)
    if pixels.dtype not in _LARGEST:
        raise UserError(str(path), f"has pixels of type {pixels.dtype}", expected="8 or 16 bits a pixel")
    if pixels.shape != shape:
        found, wanted = (f"{columns} x {rows} pixels" for rows, columns in (pixels.shape, shape))
        raise UserError(str(path), found, expected=f"{wanted}, one a modulator pixel", remedy="or change the preset")
    return (pixels / np.float32(_LARGEST[pixels.dtype])).astype(np.float32)


def numbered(path: Path, suffix: str) -> Path:
    """ "out.png" with "10mm" is "out-10mm.png"."""
    return path.with_name(f"{path.stem}-{suffix}{path.suffix}")
