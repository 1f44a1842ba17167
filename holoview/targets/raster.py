"""Picture files as plain samples: which format, how many channels, integers or floats. No colour is decided here.

The format is told by the file's first bytes, never by its name. PNG with 16 bits goes through imagecodecs, because
Pillow reduces colour PNG to 8 bits.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageOps

from holoview.errors import UserError

EXPECTED = "a PNG, JPEG, TIFF or OpenEXR picture"
MOST_PIXELS = 1 << 27

_ORIENTATION = 0x0112  # EXIF tag

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
_TIFF_COLOURS = (
    tifffile.PHOTOMETRIC.MINISWHITE,
    tifffile.PHOTOMETRIC.MINISBLACK,
    tifffile.PHOTOMETRIC.RGB,
    tifffile.PHOTOMETRIC.PALETTE,
    tifffile.PHOTOMETRIC.YCBCR,
)
_BROKEN = (OSError, ValueError, RuntimeError, SyntaxError, IndexError, KeyError, TypeError, MemoryError, struct.error)


@dataclass(frozen=True)
class Raster:
    """Decoded samples.

    `values` (y, x, 1 or 3): integers scaled to 0…1 of their full range, floats as stored. `alpha` (y, x) or
    None. `encoded`: the samples came as integers (a display signal) rather than floats (light).
    `premultiplied`: alpha is already in the colours. `notes`: what a person should know about the reading.
    `primaries`: chromaticities (x, y) of red, green, blue and white that the file states, or None.
    """

    values: NDArray[np.float64]
    alpha: NDArray[np.float64] | None
    encoded: bool
    premultiplied: bool = False
    notes: tuple[str, ...] = ()
    primaries: tuple[tuple[float, float], ...] | None = None


def signature(path: Path) -> str:
    """The format that the file's first bytes announce, or "".

    Raises UserError when the file is missing, a folder, empty or unreadable.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except IsADirectoryError as error:
        raise UserError(str(path), "is a folder", expected=EXPECTED, remedy="name a file in it") from error
    except FileNotFoundError as error:
        raise UserError(str(path), "there is no such file", remedy="check the name and the folder") from error
    except OSError as error:
        raise UserError(str(path), f"can't be read: {error.strerror}", remedy="check its permissions") from error
    if not head:
        raise UserError(str(path), "the file is empty", expected=EXPECTED)
    return next((name for magic, name in _SIGNATURES if head.startswith(magic)), "")


def page_count(path: Path) -> int:
    """How many pictures a file holds: TIFF pages, OpenEXR parts, or layers of one part; 1 for anything else."""
    kind = signature(path)
    try:
        if kind == "TIFF":
            with tifffile.TiffFile(path) as file:
                return len(file.pages)
        if kind == "OpenEXR" and OpenEXR.isOpenExrFile(str(path)):
            with OpenEXR.File(str(path), separate_channels=True) as file:
                return max(len(file.parts), len(_layers(file.channels(0))))
    except _BROKEN:
        return 1  # decode says what is wrong
    return 1


def decode(path: Path, page: int | None = None) -> Raster:
    """Samples of a PNG, JPEG, TIFF or OpenEXR file; of one of its pages, or the first, with a note, when None.

    Raises UserError when it is none of these, truncated, damaged, without pixels, or of an unknown layout.
    """
    kind = signature(path)
    readers: dict[str, Callable[[Path], Raster]] = {
        "PNG": _png,
        "JPEG": _pillow,
        "TIFF": partial(_tiff, page=page),
        "OpenEXR": partial(_exr, page=page),
    }
    if kind not in readers:
        found = "is a numpy array" if kind == "NPY" else "is not a picture that can be read"
        raise UserError(str(path), found, expected=EXPECTED, remedy="save it in one of these formats")
    try:
        raster = readers[kind](path)
    except UserError:
        raise
    except Image.DecompressionBombError as error:
        raise _too_large(path) from error
    except _BROKEN as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(
            str(path), f"the {kind} data is truncated or damaged ({why})", remedy="save or copy the file again"
        ) from error
    if raster.values.size == 0:
        raise UserError(str(path), f"has no pixels: {raster.values.shape[1]} × {raster.values.shape[0]}")
    return raster


def _png(path: Path) -> Raster:
    data = path.read_bytes()
    if len(data) < 33:
        raise UserError(str(path), "the PNG data is truncated", remedy="save or copy the file again")
    width, height, bits = struct.unpack(">IIB", data[16:25])
    if width * height > MOST_PIXELS:
        raise _too_large(path, width, height)
    if width * height == 0:
        raise UserError(str(path), f"has no pixels: {width} × {height}")
    return _split(_unit(imagecodecs.png_decode(data)), encoded=True) if bits == 16 else _pillow(path)


def _pillow(path: Path) -> Raster:
    """8-bit PNG and JPEG; palettes are looked up, CMYK is converted, a camera's rotation flag is obeyed."""
    with Image.open(io.BytesIO(path.read_bytes())) as opened:
        if opened.width * opened.height > MOST_PIXELS:
            raise _too_large(path, opened.width, opened.height)
        opened.load()
        upright = ImageOps.exif_transpose(opened)
    notes: tuple[str, ...] = ()
    if opened.getexif().get(_ORIENTATION, 1) != 1:
        notes = ("turned upright as the camera's orientation flag says",)
    if "transparency" in upright.info or upright.mode == "PA":
        upright = upright.convert("RGBA")
    elif upright.mode not in ("L", "LA", "RGB", "RGBA"):
        upright = upright.convert("L" if upright.mode == "1" else "RGB")
    if "icc_profile" in opened.info:
        notes += ("embedded colour profile ignored: taken as sRGB",)
    return _split(_unit(np.asarray(upright)), encoded=True, notes=notes)


def _tiff(path: Path, page: int | None) -> Raster:
    """One page: grey, palette or RGB, with or without alpha, samples side by side or in planes."""
    with tifffile.TiffFile(path) as file:
        sheet = file.pages[page or 0]
        if sheet.imagewidth * sheet.imagelength > MOST_PIXELS:
            raise _too_large(path, sheet.imagewidth, sheet.imagelength)
        photometric, axes = sheet.photometric, sheet.axes
        if axes not in ("YX", "YXS", "SYX"):
            remedy = "export a plain TIFF"
            raise UserError(str(path), f"has the TIFF layout {axes}", expected="one flat picture", remedy=remedy)
        if photometric not in _TIFF_COLOURS:
            name = getattr(photometric, "name", photometric)
            raise UserError(str(path), f"has {name} colours", expected="grey or RGB", remedy="export it as RGB")
        samples = np.asarray(sheet.asarray())
        notes = (f"{len(file.pages)} pages, the first is used",) if len(file.pages) > 1 and page is None else ()
        full = 2**sheet.bitspersample - 1 if samples.dtype.kind == "u" else None
        if photometric == tifffile.PHOTOMETRIC.PALETTE:
            samples, full, axes = np.asarray(sheet.colormap)[:, samples], None, "SYX"
        premultiplied = tifffile.EXTRASAMPLE.ASSOCALPHA in sheet.extrasamples
    if axes == "SYX":
        samples = np.moveaxis(samples, 0, -1)
    encoded, values = samples.dtype.kind != "f", _unit(samples, full)
    if photometric == tifffile.PHOTOMETRIC.MINISWHITE and encoded:
        values = 1 - values
    return _split(values, encoded=encoded, premultiplied=premultiplied, notes=notes)


def _exr(path: Path, page: int | None) -> Raster:
    """One part, or one layer ("name.R", "name.G", "name.B") of the only part."""
    if not OpenEXR.isOpenExrFile(str(path)):
        raise ValueError("not a readable OpenEXR file")
    with OpenEXR.File(str(path), separate_channels=True) as file:  # closing it empties its channels
        count = len(file.parts)
        part = page or 0 if count > 1 else 0
        header, channels = dict(file.header(part)), dict(file.channels(part))
        if any(c.xSampling != 1 or c.ySampling != 1 for c in channels.values()):
            found = "has subsampled channels"
            raise UserError(str(path), found, expected="R, G, B at full size", remedy="export as RGB")
        planes = {name: np.array(c.pixels, dtype=np.float64) for name, c in channels.items()}
    layers = _layers(channels)
    if count == 1 and page is not None and len(layers) > 1:
        planes = {name[-1]: planes[name] for name in (f"{layers[page]}.{c}" for c in "RGBA") if name in planes}
    names = ("R", "G", "B") if {"R", "G", "B"} <= planes.keys() else _single(path, list(planes))
    values = np.stack([planes[name] for name in names], axis=-1)
    several = max(count, len(layers))
    notes = (f"{several} pictures, the first is used",) if count > 1 and page is None else ()
    return Raster(values, planes.get("A"), False, premultiplied=True, notes=notes, primaries=_primaries(header))


def _layers(channels: Iterable[str]) -> list[str]:
    """Names of the layers that have R, G and B, in the order of the numbers in their names."""
    names = set(channels)
    prefixes = {name[:-2] for name in names if name.endswith(".R")}
    return sorted((p for p in prefixes if {f"{p}.G", f"{p}.B"} <= names), key=by_number)


def by_number(name: str) -> list[tuple[int, str]]:
    """A key that sorts plane-2 before plane-10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _primaries(header: Mapping[str, Any]) -> tuple[tuple[float, float], ...] | None:
    """Chromaticities of red, green, blue and white of an OpenEXR header, where it states them."""
    stated = header.get("chromaticities")
    if stated is None:
        return None
    numbers = [float(number) for number in np.ravel(np.asarray(stated, dtype=np.float64))]
    pairs = tuple(zip(numbers[0::2], numbers[1::2], strict=True))
    if len(pairs) != 4 or any(y == 0 for _, y in pairs):
        raise ValueError(f"chromaticities {numbers}")
    return pairs


def _single(path: Path, names: list[str]) -> tuple[str, ...]:
    """The one channel of a grey or depth file."""
    plain = [name for name in names if name != "A"]
    if len(plain) != 1:
        found = f"has the channels {', '.join(names) or '(none)'}"
        raise UserError(str(path), found, expected="R, G, B or a single channel", remedy="export those")
    return (plain[0],)


def _unit(samples: NDArray[Any], full: int | None = None) -> NDArray[np.float64]:
    """Unsigned integers over their full range, so 0…1; floats untouched."""
    if samples.dtype.kind in "fb":
        return samples.astype(np.float64)
    if samples.dtype.kind != "u":
        raise ValueError(f"samples of type {samples.dtype} have no fixed white")
    return samples / float(full if full is not None else np.iinfo(samples.dtype).max)


def _split(
    values: NDArray[np.float64], *, encoded: bool, premultiplied: bool = False, notes: tuple[str, ...] = ()
) -> Raster:
    """Colour and alpha apart: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha."""
    cube = values[..., None] if values.ndim == 2 else values
    count = cube.shape[-1]
    if cube.ndim != 3 or count not in (1, 2, 3, 4):
        raise ValueError(f"{count} samples a pixel")
    colours = 1 if count < 3 else 3
    alpha = cube[..., colours] if count > colours else None
    return Raster(cube[..., :colours], alpha, encoded, premultiplied, notes)


def _too_large(path: Path, width: int = 0, height: int = 0) -> UserError:
    size = f"{width} × {height} pixels" if width else "too many pixels"
    return UserError(str(path), f"has {size}", expected=f"at most {MOST_PIXELS}", remedy="scale it down first")
