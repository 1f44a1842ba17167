"""Decodes PNG, JPEG, TIFF and OpenEXR files as rasters, without interpreting their colours.

The format is recognised by the file's first bytes, never by its name.
"""

from __future__ import annotations

import logging
import struct
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from holoview.targets.deep_png import decode_deep_png
from holoview.targets.exr import exr_count, exr_pictures
from holoview.targets.raster import Raster, integers_to_unit_range, require_picture_memory, split_alpha
from holoview.targets.tiff import tiff_count, tiff_pictures
from holoview.util.errors import UserError
from holoview.util.input_file import read_bytes

READABLE_FORMATS = "a PNG, JPEG, TIFF or OpenEXR picture"

_EXIF_ORIENTATION = 0x0112

_SIGNATURES: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"\xff\xd8\xff", "JPEG"),
    (b"II*\x00", "TIFF"),
    (b"MM\x00*", "TIFF"),
    (b"II+\x00", "TIFF"),
    (b"MM\x00+", "TIFF"),
    (b"v/1\x01", "OpenEXR"),
    (b"\x93NUMPY", "NPY"),
)
_PNG_SAMPLES = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # a pixel, by the colour type
Image.MAX_IMAGE_PIXELS = None  # sizes are checked here, before anything is decoded
logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what it logs becomes an error here, in one line


def file_format(path: Path) -> str:
    """The format that the file's first bytes indicate, or "" for an unknown one.

    Raises UserError when the file is missing, a folder, empty or unreadable.
    """
    head = read_bytes(path, READABLE_FORMATS, most=16, missing="check the name and the folder")
    if not head:
        raise UserError(str(path), "the file is empty", expected=READABLE_FORMATS)
    return next((name for magic, name in _SIGNATURES if head.startswith(magic)), "")


def picture_count(path: Path) -> int:
    """Number of pictures in a file (TIFF pages, OpenEXR parts or layers; 1 for PNG and JPEG), from its headers alone.

    Raises UserError as `read_raster` does, as far as the headers show.
    """
    kind = _supported_format(path)
    counts: dict[str, Callable[[Path], int]] = {"TIFF": tiff_count, "OpenEXR": exr_count}
    with _naming_file(path, kind):
        return counts[kind](path) if kind in counts else 1


def read_raster(path: Path) -> Raster:
    """The first picture of a PNG, JPEG, TIFF or OpenEXR file; a note says so if there are several.

    Raises UserError when the file has another format, is damaged or without pixels, or has an unknown layout.
    """
    with closing(read_rasters(path)) as pictures:
        first = next(pictures)
    if not first.page:
        return first
    note = f"{picture_count(path)} pictures, {first.page} is used"
    return replace(first, notes=(*first.notes, note), page="")


def read_rasters(path: Path) -> Generator[Raster]:
    """Every picture of a file, decoded one after the other; `page` says which, if there are several.

    Raises UserError as `read_raster` does.
    """
    kind = _supported_format(path)
    with _naming_file(path, kind):
        for raster in _READERS[kind](path):
            if raster.values.size == 0:
                raise UserError(str(path), f"has no pixels: {raster.values.shape[1]} × {raster.values.shape[0]}")
            yield raster


def _supported_format(path: Path) -> str:
    kind = file_format(path)
    if kind not in _READERS:
        found = "is a numpy array" if kind == "NPY" else "is not a picture that can be read"
        raise UserError(str(path), found, expected=READABLE_FORMATS, remedy="save it in one of these formats")
    return kind


@contextmanager
def _naming_file(path: Path, kind: str) -> Iterator[None]:
    """Turns the exceptions of decoders into a UserError that names the file."""
    try:
        yield
    except (UserError, NameError):
        raise
    except Exception as error:  # each decoder raises exceptions of its own
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(
            str(path), f"the {kind} data is truncated or damaged ({reason})", remedy="save or copy the file again"
        ) from error


def _read_png(path: Path) -> Raster:
    head = read_bytes(path, READABLE_FORMATS, most=33)
    if len(head) < 33:
        raise UserError(str(path), "the PNG data is truncated", remedy="save or copy the file again")
    width, height, bits, colour_type = struct.unpack(">IIBB", head[16:26])
    require_picture_memory(path, width, height, _PNG_SAMPLES.get(colour_type, 4), 2 * path.stat().st_size)
    if bits != 16:
        return _read_with_pillow(path)
    data = read_bytes(path, READABLE_FORMATS)
    return split_alpha(integers_to_unit_range(decode_deep_png(data)), encoded=True)


def _read_with_pillow(path: Path) -> Raster:
    """8-bit PNG and JPEG: palettes and CMYK become RGB, and the picture is turned as its EXIF orientation says."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of metadata that are damaged or too many, which aren't used
        return _decode_with_pillow(path)


def _decode_with_pillow(path: Path) -> Raster:
    with Image.open(path, formats=("PNG", "JPEG")) as opened:
        samples = max(len(opened.getbands()), 3 if opened.mode == "P" else 1)
        require_picture_memory(path, opened.width, opened.height, samples, 2 * path.stat().st_size)
        opened.load()
        upright = ImageOps.exif_transpose(opened)
    notes: tuple[str, ...] = ()
    if opened.getexif().get(_EXIF_ORIENTATION, 1) != 1:
        notes = ("turned upright as the camera's orientation flag says",)
    if "transparency" in upright.info or upright.mode == "PA":
        upright = upright.convert("RGBA")
    elif upright.mode not in ("L", "LA", "RGB", "RGBA"):
        upright = upright.convert("L" if upright.mode == "1" else "RGB")
    if "icc_profile" in opened.info:
        notes += ("embedded colour profile ignored: taken as sRGB",)
    return split_alpha(integers_to_unit_range(np.asarray(upright)), encoded=True, notes=notes)


_READERS: dict[str, Callable[[Path], Iterable[Raster]]] = {
    "PNG": lambda path: [_read_png(path)],
    "JPEG": lambda path: [_read_with_pillow(path)],
    "TIFF": tiff_pictures,
    "OpenEXR": exr_pictures,
}
