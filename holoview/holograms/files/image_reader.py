"""Decodes PNG, JPEG, WebP, AVIF, HEIC, GIF, TIFF, OpenEXR and Radiance HDR files as rasters; colours stay as they are.

The format is recognised by the file's first bytes, never by its name.
"""

from __future__ import annotations

import importlib.util
import io
import logging
import lzma
import math
import re
import struct
import warnings
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray
from PIL import Image, ImageOps, features

from holoview.holograms.files.colour_profile import UNREAD_PROFILE, ColourProfile, icc_profile, png_profile
from holoview.holograms.files.light_arrays import is_npy_of_light, light_arrays
from holoview.light.numerics.sample_bits import find_bits
from holoview.util.errors import UserError
from holoview.util.files import opened_file, read_bytes
from holoview.util.memory_limit import require_memory
from holoview.util.packages import import_optional
from holoview.util.reader_process import Answer, call_in_child, in_child
from holoview.util.tables import parse_json_table

READABLE_FORMATS = "a Radiance HDR, WebP, AVIF, HEIC, GIF, PNG, JPEG, TIFF or OpenEXR picture"

EXIF_ORIENTATION = 0x0112
"""Number of the tag by which a camera says how its picture is to be turned."""

_EXIF_IFD, _EXIF_COLOUR_SPACE, _EXIF_SRGB = 0x8769, 0xA001, 1

_SIGNATURES: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"\xff\xd8\xff", "JPEG"),
    (b"II*\x00", "TIFF"),
    (b"MM\x00*", "TIFF"),
    (b"II+\x00", "TIFF"),
    (b"MM\x00+", "TIFF"),
    (b"v/1\x01", "OpenEXR"),
    (b"\x93NUMPY", "NPY"),
    (b"#?RADIANCE", "HDR"),
    (b"#?RGBE", "HDR"),
    (b"GIF87a", "GIF"),
    (b"GIF89a", "GIF"),
)
_HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_PILLOW_FORMATS = {"PNG": "PNG", "JPEG": "JPEG", "WebP": "WEBP", "AVIF": "AVIF", "HEIC": "HEIF", "GIF": "GIF"}
_PILLOW_DECODERS = {"WebP": "webp", "AVIF": "avif"}
"""Formats that Pillow reads where it was built with a decoder, by its name."""
_LIGHT_NPZ = (b"PK\x03\x04", b"about.npy")
"""How an archive of `holoview.holograms.files.light_file` begins, and the name of its first member at byte 30."""
_PNG_SAMPLES = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # a pixel, by the colour type
Image.MAX_IMAGE_PIXELS = None  # sizes are checked here, before anything is decoded
logging.getLogger("tifffile").addHandler(logging.NullHandler())  # its messages become an error here, in one line


def file_format(path: Path) -> str:
    """The format that the file's first bytes indicate, or "" for an unknown one.

    Raises UserError when the file is missing, a folder, empty or unreadable.
    """
    head = read_bytes(path, READABLE_FORMATS, most=64, missing="check the name and the folder")
    if not head:
        raise UserError(str(path), "the file is empty", expected=READABLE_FORMATS)
    if head.startswith(_LIGHT_NPZ[0]) and head[30:].startswith(_LIGHT_NPZ[1]):
        return "NPZ"
    kind = next((name for magic, name in _SIGNATURES if head.startswith(magic)), "") or _boxed_format(head)
    return "NPY of light" if kind == "NPY" and is_npy_of_light(path) else kind


def _boxed_format(head: bytes) -> str:
    """WebP, AVIF or HEIC, whose names stand behind the size of the first box; "" for other files."""
    if head.startswith(b"RIFF") and head[8:12] == b"WEBP":
        return "WebP"
    if head[4:8] != b"ftyp":
        return ""
    size = int.from_bytes(head[:4], "big")
    brands = [head[8:12], *(head[at : at + 4] for at in range(16, min(size, len(head)), 4))]
    if b"avif" in brands or b"avis" in brands:
        return "AVIF"
    return "HEIC" if any(brand in _HEIC_BRANDS for brand in brands) else ""


def picture_count(path: Path) -> int:
    """Number of pictures in a file (TIFF pages, OpenEXR parts or layers, planes of light; else 1), by its headers.

    Raises UserError as `read_raster` does, as far as the headers show.
    """
    kind = _supported_format(path)
    return call_in_child(str(path), path, partial(_count, path, kind)) if kind in _COUNTS else 1


def _count(path: Path, kind: str) -> int:
    with _naming_file(path, kind):
        return _COUNTS[kind](path)


def read_raster(path: Path, white: int | None = None) -> Raster:
    """The first picture of a PNG, JPEG, TIFF or OpenEXR file; a note says so if there are several.

    white: the number of white in a file of 16 bits, if it is known; otherwise see `unit_range`. Raises UserError when
    the file has another format, is damaged or without pixels, or has an unknown layout.
    """
    with closing(read_rasters(path, white)) as pictures:
        first = next(pictures)
    if not first.page:
        return first
    note = f"{picture_count(path)} pictures, {first.page} is used"
    return replace(first, notes=(*first.notes, note), page="")


def read_rasters(path: Path, white: int | None = None) -> Generator[Raster]:
    """Every picture of a file, decoded one after the other; `page` says which, if there are several.

    white: as of `read_raster`. Raises UserError as that does.
    """
    kind = _supported_format(path)
    with in_child(str(path), path, partial(_next_raster, path, kind, white)) as ask:
        while (raster := ask(None)) is not None:
            yield raster


ANIMATED = ("PNG", "WebP", "AVIF", "GIF")
"""Formats whose files may hold an animation."""


def animation_count(path: Path) -> int:
    """Number of pictures of an animation; 1 for other pictures. Raises UserError as `read_raster` does."""
    kind = _supported_format(path)
    return call_in_child(str(path), path, partial(_count_frames, path, kind)) if kind in ANIMATED else 1


def _count_frames(path: Path, kind: str) -> int:
    with _naming_file(path, kind), Image.open(path, formats=(_PILLOW_FORMATS[kind],)) as opened:
        return int(getattr(opened, "n_frames", 1))


def read_animation(path: Path) -> Generator[Raster]:
    """Every picture of an animation, decoded one after the other. Raises UserError as `read_raster` does."""
    kind = _supported_format(path)
    with in_child(str(path), path, partial(_next_frame, path, kind)) as ask:
        while (raster := ask(None)) is not None:
            yield raster


@contextmanager
def _next_frame(path: Path, kind: str) -> Iterator[Answer]:
    """Answers each request with the next picture, None after the last."""
    with closing(_frames(path, kind)) as frames:
        yield lambda _: next(frames, None)


def _frames(path: Path, kind: str) -> Generator[Raster]:
    with _naming_file(path, kind), Image.open(path, formats=(_PILLOW_FORMATS[kind],)) as opened:
        count = getattr(opened, "n_frames", 1)
        require_picture_memory(path, opened.width, opened.height, 4, 2 * path.stat().st_size)
        for number in range(count):
            opened.seek(number)
            pixels = integers_to_unit_range(np.asarray(opened.convert("RGBA")))
            yield split_alpha(pixels, encoded=True, page=f"picture {number + 1}")


@contextmanager
def _next_raster(path: Path, kind: str, white: int | None) -> Iterator[Answer]:
    """Answers each request with the next picture, None after the last."""
    with closing(_rasters(path, kind, white)) as rasters:
        yield lambda _: next(rasters, None)


def _rasters(path: Path, kind: str, white: int | None) -> Generator[Raster]:
    with _naming_file(path, kind):
        for raster in _READERS[kind](path, white):
            if raster.values.size == 0:
                raise UserError(str(path), f"has no pixels: {raster.values.shape[1]} × {raster.values.shape[0]}")
            yield raster


def _supported_format(path: Path) -> str:
    kind = file_format(path)
    if kind not in _READERS:
        if kind == "NPY":
            remedy = f"of a complex field, note first what it is: `holoview info {path} --pitch 8um --remember`"
            raise UserError(str(path), "is a numpy array", expected=READABLE_FORMATS, remedy=remedy)
        remedy = "save it in one of these formats"
        raise UserError(str(path), "is not a picture that can be read", expected=READABLE_FORMATS, remedy=remedy)
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


def _read_png(path: Path, white: int | None) -> Raster:
    head = read_bytes(path, READABLE_FORMATS, most=33)
    if len(head) < 33:
        raise UserError(str(path), "the PNG data is truncated", remedy="save or copy the file again")
    width, height, bits, colour_type = struct.unpack(">IIBB", head[16:26])
    require_picture_memory(path, width, height, _PNG_SAMPLES.get(colour_type, 4), 2 * path.stat().st_size)
    data = read_bytes(path, READABLE_FORMATS)
    chunks = dict(png_chunks(data))
    profile, note = png_profile(chunks.items())
    if bits != 16:
        raster = _read_with_pillow(path, "PNG")
    else:
        significant = next(iter(chunks.get(b"sBIT", b"")), 0)
        scaled = unit_range(decode_deep_png(data), white, (1 << significant) - 1, "sBIT")
        raster = replace(split_alpha(scaled.values, encoded=True, notes=scaled.notes), white=scaled.white)
    notes, is_stated = (*raster.notes, note) if note else raster.notes, raster.is_stated or b"sRGB" in chunks
    return _with_profile(replace(raster, notes=notes, is_stated=is_stated), profile)


def _with_profile(raster: Raster, profile: ColourProfile | None) -> Raster:
    """A display signal with the colour space that its file states, which a remark names unless it is sRGB."""
    if profile is None:
        return raster
    raster = replace(raster, is_stated=True)
    if profile.is_srgb:
        return raster
    return replace(raster, profile=profile, notes=(*raster.notes, f"converted from its colour space, {profile.title}"))


def _read_boxed(kind: str, path: Path, white: int | None) -> list[Raster]:
    """A WebP, AVIF or HEIC picture. Raises UserError where no decoder of it is installed."""
    if kind == "HEIC":
        if importlib.util.find_spec("pillow_heif") is None:
            remedy = "install pillow-heif, or save it as PNG or JPEG"
            raise UserError(str(path), "is a HEIC picture, of which no decoder is installed", remedy=remedy)
        importlib.import_module("pillow_heif").register_heif_opener()
    elif not features.check(_PILLOW_DECODERS[kind]):
        remedy = "install Pillow 11.3 or newer, or save it as PNG or JPEG"
        raise UserError(str(path), f"is a picture of kind {kind}, of which no decoder is installed", remedy=remedy)
    raster = _read_with_pillow(path, kind)
    bits = 8 if kind == "WebP" else coded_bits(read_bytes(path, READABLE_FORMATS))
    return [raster if bits == 8 else _with_all_bits(path, kind, raster, bits)]


def coded_bits(data: bytes) -> int:
    """Bits of a channel that an AVIF or HEIC file states: of its pixels, or of its coder; 8 where neither is stated.

    Boxes `pixi` of ISO/IEC 23008-12, `av1C` of AV1's binding to it, `hvcC` of ISO/IEC 14496-15.
    """
    at = {name: data.find(name) + 4 for name in (b"pixi", b"av1C", b"hvcC")}
    pixels = data[at[b"pixi"] + 5 :][: data[at[b"pixi"] + 4]] if 4 <= at[b"pixi"] < len(data) - 4 else b""
    if pixels:
        return max(pixels)
    if 4 <= at[b"av1C"] < len(data) - 2:
        flags = data[at[b"av1C"] + 2]
        return 12 if flags & 0x20 else 10 if flags & 0x40 else 8
    return 8 + (data[at[b"hvcC"] + 17] & 7) if 4 <= at[b"hvcC"] < len(data) - 17 else 8


def _with_all_bits(path: Path, kind: str, raster: Raster, bits: int) -> Raster:
    """A raster of 8 bits with all that the file holds, where a decoder of them is installed; else it is said."""
    part = replace(raster, notes=(*raster.notes, f"{bits} bits a channel, of which 8 are read"))
    if kind != "AVIF" or importlib.util.find_spec("imagecodecs") is None or raster.alpha is not None:
        return part
    codecs = importlib.import_module("imagecodecs")
    try:
        decoded = np.asarray(codecs.avif_decode(read_bytes(path, READABLE_FORMATS), index=0))
    except (codecs.AvifError, codecs.DelayedImportError, ValueError, IndexError):
        return part
    values = decoded.astype(np.float64) / ((1 << bits) - 1)
    is_same = values.shape == raster.values.shape and float(np.abs(values - raster.values).max()) < _MOST_BITS_OFF
    return replace(raster, values=values, white=(1 << bits) - 1) if is_same else part  # else turned, or other colours


def _read_with_pillow(path: Path, kind: str) -> Raster:
    """A picture of 8 bits: palettes and CMYK become RGB, and it is turned as its EXIF orientation says."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of metadata that are damaged or too many, which aren't used
        return _decode_with_pillow(path, kind)


def _decode_with_pillow(path: Path, kind: str) -> Raster:
    with Image.open(path, formats=(_PILLOW_FORMATS[kind],)) as opened:
        samples = max(len(opened.getbands()), 3 if opened.mode == "P" else 1)
        require_picture_memory(path, opened.width, opened.height, samples, 2 * path.stat().st_size)
        frames = getattr(opened, "n_frames", 1)
        opened.load()
        upright = ImageOps.exif_transpose(opened)
    notes: tuple[str, ...] = ()
    if opened.getexif().get(EXIF_ORIENTATION, 1) != 1:
        notes = ("turned upright as the camera's orientation flag says",)
    if frames > 1:
        notes += (f"an animation of {frames} pictures, the first is used",)
    if "transparency" in upright.info or upright.mode == "PA":
        upright = upright.convert("RGBA")
    elif upright.mode not in ("L", "LA", "RGB", "RGBA"):
        upright = upright.convert("L" if upright.mode == "1" else "RGB")
    profile = None
    if opened.format != "PNG" and (data := opened.info.get("icc_profile")):
        profile = icc_profile(data) if opened.mode in ("L", "RGB") else None
        notes += () if profile else (UNREAD_PROFILE,)
    is_stated = opened.getexif().get_ifd(_EXIF_IFD).get(_EXIF_COLOUR_SPACE) == _EXIF_SRGB
    raster = split_alpha(integers_to_unit_range(np.asarray(upright)), encoded=True, notes=notes)
    return _with_profile(replace(raster, is_stated=is_stated), profile)


# --- the decoded image, before its colours are interpreted ------------------------------------------------------------


MAX_PIXELS = 1 << 27
"""Larger pictures are refused, since a damaged header may claim any size."""

_MOST_BITS_OFF = 3 / 255  # between the decoders of 8 and of all bits
_SAMPLE_BYTES, _PIXEL_BYTES = 16, 32
"""Memory at the peak of reading a picture as light: for each stored sample, and for each pixel in three colours."""

Chromaticities = tuple[tuple[float, float], ...]
"""CIE (x, y) of red, green, blue and white."""


@dataclass(frozen=True)
class Raster:
    """Decoded samples of one picture.

    values: (y, x, 1 or 3), integers scaled to 0…1 of their full range, floats as stored. alpha: (y, x) or None.
    encoded: whether the samples were integers (a display signal) rather than floats (light).
    premultiplied: whether the colours are already multiplied by alpha. notes: changes that were made, for the user.
    page: which picture of a file with several, in words. primaries: the chromaticities that the file states.
    white: the number in the file that became 1, None for floats and samples of 8 bits. profile: the colour space of a
    display signal that the file states, None for sRGB. is_stated: whether the file states the space of a signal.
    """

    values: NDArray[np.float64]
    alpha: NDArray[np.float64] | None
    encoded: bool
    premultiplied: bool = False
    notes: tuple[str, ...] = ()
    page: str = ""
    primaries: Chromaticities | None = None
    white: int | None = None
    profile: ColourProfile | None = None
    is_stated: bool = False


def integers_to_unit_range(samples: NDArray[Any], full_scale: int | None = None) -> NDArray[np.float64]:
    """Unsigned integers divided by the full scale of their type or by `full_scale`; floats and booleans unscaled."""
    if samples.dtype.kind in "fb":
        return samples.astype(np.float64)
    if samples.dtype.kind != "u":
        raise ValueError(f"samples of type {samples.dtype} have no fixed white")
    return samples / float(full_scale if full_scale is not None else np.iinfo(samples.dtype).max)


@dataclass(frozen=True)
class UnitRange:
    """Samples from 0 to 1, the number that became 1, and remarks for the user."""

    values: NDArray[np.float64]
    white: int
    notes: tuple[str, ...]


def unit_range(samples: NDArray[np.uint16], white: int | None, stated: int = 0, statement: str = "") -> UnitRange:
    """Samples of 16 bits (y, x) or (y, x, 1 to 4) divided by the number of white.

    Cameras of 10, 12 and 14 bits write files of 16 bits whose white isn't 65535. white: this number, if the user says
    it. stated: the number that the file states, 0 for none, as its `statement`, which counts if no sample exceeds it.
    Otherwise the samples show it: their largest is 2^10 − 1, 2^12 − 1 or 2^14 − 1, or all have a factor in common. A
    remark says what was taken. The last of two or four samples is alpha, whose opaque value isn't judged.
    """
    full = (1 << 16) - 1
    has_alpha = samples.ndim == 3 and samples.shape[-1] in (2, 4)
    bits = find_bits(np.ascontiguousarray(samples[..., :-1] if has_alpha else samples))
    used = full
    notes: tuple[str, ...] = ()
    if white is not None:
        used = white
    elif 0 < stated < full and bits.top <= stated:
        used, notes = stated, (f"white is {stated}, as the file says ({statement})",)
    elif bits.is_sure and bits.full_scale != full:
        used, notes = bits.full_scale, (f"white is taken as {bits.full_scale}, as its numbers are {bits.describe()}",)
    elif bits.layout == "plain" and bits.significant < 16 and bits.top:
        least = (1 << bits.significant) - 1
        doubt = f"if it has {bits.significant} bits, white is {least}: state --space srgb{bits.significant}"
        notes = (f"its largest number is {bits.top} of {full}, which is nearly black; {doubt} of `holoview optimise`",)
    values = samples / float(used)
    if has_alpha:
        values[..., -1] = samples[..., -1] / float(full)
    return UnitRange(values, used, notes)


def split_alpha(
    values: NDArray[np.float64],
    *,
    encoded: bool,
    premultiplied: bool = False,
    notes: tuple[str, ...] = (),
    page: str = "",
) -> Raster:
    """The raster of grey, grey and alpha, RGB, or RGB and alpha (y, x, 1 to 4). Raises ValueError for other shapes."""
    samples = values[..., None] if values.ndim == 2 else values
    count = samples.shape[-1]
    if samples.ndim != 3 or count not in (1, 2, 3, 4):
        raise ValueError(f"{count} samples a pixel")
    colours = 1 if count < 3 else 3
    alpha = samples[..., colours] if count > colours else None
    return Raster(samples[..., :colours], alpha, encoded, premultiplied, notes, page)


def require_picture_memory(path: Path, width: int, height: int, samples: int, more: int = 0) -> None:
    """Raises UserError unless a picture has pixels, isn't too large, and can be read within the memory that is allowed.

    samples: numbers a pixel that are stored, `more` the bytes that its decoder takes besides.
    """
    if width * height > MAX_PIXELS:
        raise too_large_error(path, width, height)
    if width * height == 0:
        raise UserError(str(path), f"has no pixels: {width} × {height}")
    needed = width * height * (_SAMPLE_BYTES * samples + _PIXEL_BYTES) + more
    require_memory(f"{path}, {width} × {height} pixels", needed, remedy="scale it down first")


def too_large_error(path: Path, width: int = 0, height: int = 0) -> UserError:
    """The error for a picture of more than `MAX_PIXELS` pixels."""
    size = f"{width} × {height} pixels" if width else "too many pixels"
    return UserError(str(path), f"has {size}", expected=f"at most {MAX_PIXELS}", remedy="scale it down first")


def natural_sort_key(name: str) -> list[tuple[int, str]]:
    """A sort key by which plane-2 comes before plane-10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


# --- PNG of 16 bits a sample, which Pillow reduces to 8 bits unless they are grey -------------------------------------


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


def png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and contents of the chunks before the samples of a PNG file; those that are cut off are left out."""
    place = 8
    while place + 8 <= len(data):
        (size,) = struct.unpack(">I", data[place : place + 4])
        name, content = data[place + 4 : place + 8], data[place + 8 : place + 8 + size]
        if name == b"IDAT" or len(content) < size:
            return
        yield name, content
        place += 12 + size


def _colours(data: bytes, mode: str) -> NDArray[np.uint16]:
    """Samples of "RGB" or "RGBA": Pillow keeps one byte of each, the first or the second by the order it is told."""
    high, low = (_first_bytes(data, f"{mode};16{order}") for order in ("B", "L"))
    return high.astype(np.uint16) << np.uint16(8) | low


def _first_bytes(data: bytes, raw_mode: str) -> NDArray[np.uint8]:
    with Image.open(io.BytesIO(data)) as image:
        image.tile = [tile._replace(args=raw_mode) for tile in image.tile]
        return np.asarray(image)


# --- TIFF: pages, except thumbnails and masks -------------------------------------------------------------------------


_PHOTOMETRICS = (
    tifffile.PHOTOMETRIC.MINISWHITE,
    tifffile.PHOTOMETRIC.MINISBLACK,
    tifffile.PHOTOMETRIC.RGB,
    tifffile.PHOTOMETRIC.PALETTE,
    tifffile.PHOTOMETRIC.YCBCR,
)
_DIRECT = _PHOTOMETRICS[:3]  # whose samples grow or fall with light


def tiff_count(path: Path) -> int:
    """Number of pictures. Raises ValueError when the linked list of pages is truncated."""
    check_page_list(path)
    with tifffile.TiffFile(path) as file:
        return len(_pages(file))


def tiff_pictures(path: Path, white: int | None = None) -> Iterator[Raster]:
    """Every picture in the file's order; pages are decoded one by one. white: as of `read_raster`.

    Raises UserError for layouts and colours other than one flat picture, ValueError and others for damaged files.
    """
    check_page_list(path)
    with tifffile.TiffFile(path) as file:
        pages = _pages(file)
        for number, page in enumerate(pages, start=1):
            yield _tiff_raster(path, page, f"page {number}" if len(pages) > 1 else "", white)


_MOST_PAGES = 10_000
_FARTHEST = 1 << 62  # place in a file
_FREE_BYTES = 64 << 20
_UNBOUNDED: dict[int, tuple[Callable[[], Any], int]] = {
    tifffile.COMPRESSION.DEFLATE: (zlib.decompressobj, 1032),
    tifffile.COMPRESSION.ADOBE_DEFLATE: (zlib.decompressobj, 1032),
    tifffile.COMPRESSION.LZMA: (lzma.LZMADecompressor, 10_000),
}
"""Compressions whose decoders unpack all that there is, whatever the picture's size, with the highest ratio of each."""


@contextmanager
def naming_missing_codecs(path: Path) -> Iterator[None]:
    """Turns tifffile's exception in the block into a UserError if imagecodecs decodes the file and isn't installed."""
    try:
        yield
    except Exception as error:
        if "requires the 'imagecodecs' package" in str(error):  # tifffile's words, in exceptions of several types
            import_optional("imagecodecs", f"{path}, for its compression")
        raise


def require_page_memory(path: Path, page: tifffile.TiffPage) -> None:
    """Raises UserError unless a page is of an allowed size, and can be decoded within the memory that is allowed."""
    width, height, sample_bytes = page.imagewidth, page.imagelength, max(page.bitspersample // 8, 1)
    stored = width * height * page.samplesperpixel * sample_bytes
    tile = page.tilewidth * page.tilelength * page.samplesperpixel * sample_bytes if page.is_tiled else stored
    require_picture_memory(path, width, height, page.samplesperpixel, stored + 2 * tile + 2 * max(page.databytecounts))
    if page.compression in _UNBOUNDED:
        _check_segments(path, page, max(tile, stored))


def _check_segments(path: Path, page: tifffile.TiffPage, most: int) -> None:
    """Raises UserError if a compressed part holds more than the picture, found by decompression in pieces.

    Parts that are too short for much more than `_FREE_BYTES` aren't looked into.
    """
    decompressor, ratio = _UNBOUNDED[page.compression]
    handle = page.parent.filehandle
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if count * ratio < max(_FREE_BYTES, most):
            continue
        handle.seek(offset)
        unpacked, piece, stream = 0, handle.read(count), decompressor()
        while piece and not stream.eof:
            unpacked += len(stream.decompress(piece, _FREE_BYTES))
            if unpacked > most + _FREE_BYTES:
                found = f"a part unpacks to more than the {most} bytes of the picture"
                raise UserError(str(path), found, remedy="save or copy the file again")
            piece = b"" if getattr(stream, "needs_input", False) else getattr(stream, "unconsumed_tail", b"x")


def check_page_list(path: Path) -> None:
    """Raises UserError for a TIFF whose list of pages is too long or bites its own tail, which tifffile follows slowly.

    A list that breaks off is left to tifffile.
    """
    seen: set[int] = set()
    with opened_file(path, READABLE_FORMATS) as file:
        head = file.read(16)
        order = "<" if head[:2] == b"II" else ">"
        is_big = head[2:4] in (b"+\0", b"\0+")
        count, entry, offset = ("Q", 20, "Q") if is_big else ("H", 12, "I")
        count_bytes, offset_bytes = struct.calcsize(f"={count}"), struct.calcsize(f"={offset}")
        raw = head[8:16] if is_big else head[4:8]
        while len(raw) == offset_bytes and (place := struct.unpack(f"{order}{offset}", raw)[0]):
            if place in seen:
                raise UserError(str(path), "has a list of pages that leads back into itself", expected=READABLE_FORMATS)
            seen.add(place)
            if len(seen) > _MOST_PAGES:
                raise UserError(str(path), f"has more than {_MOST_PAGES} pages", expected=READABLE_FORMATS)
            file.seek(min(place, _FARTHEST))
            raw = file.read(count_bytes)
            if len(raw) == count_bytes:
                file.seek(min(struct.unpack(f"{order}{count}", raw)[0] * entry, _FARTHEST - place), io.SEEK_CUR)
                raw = file.read(offset_bytes)


def _pages(file: tifffile.TiffFile) -> list[tifffile.TiffPage]:
    """The full-size pages. Raises ValueError for a truncated list of pages, which tifffile only logs."""
    if len(file.pages) > _MOST_PAGES:
        raise ValueError(f"{len(file.pages)} pages; at most {_MOST_PAGES} are read")
    pages = [file.pages[number] for number in range(len(file.pages))]
    if _next_offset(file, pages[-1]) != 0:
        raise ValueError(f"it breaks off after page {len(pages)}")
    full = [page for page in pages if not (page.is_reduced or page.is_mask)]
    return full or pages


def _next_offset(file: tifffile.TiffFile, page: tifffile.TiffPage) -> int:
    """Offset of the next page in the file, from the page's directory; 0 after the last one."""
    layout, handle = file.tiff, file.filehandle
    handle.seek(page.offset)
    (tags,) = struct.unpack(layout.tagnoformat, handle.read(layout.tagnosize))
    handle.seek(page.offset + layout.tagnosize + tags * layout.tagsize)
    (offset,) = struct.unpack(layout.offsetformat, handle.read(layout.offsetsize))
    return int(offset)


def _tiff_raster(path: Path, page: tifffile.TiffPage, name: str, white: int | None) -> Raster:
    """One page: grey, palette or RGB, with or without alpha, samples side by side or in planes."""
    require_page_memory(path, page)
    photometric, axes = page.photometric, page.axes
    if axes not in ("YX", "YXS", "SYX"):
        remedy = "export a plain TIFF"
        raise UserError(str(path), f"has the TIFF layout {axes}", expected="one flat picture", remedy=remedy)
    if photometric not in _PHOTOMETRICS:
        colours = getattr(photometric, "name", photometric)
        raise UserError(str(path), f"has {colours} colours", expected="grey or RGB", remedy="export it as RGB")
    with naming_missing_codecs(path):
        samples = np.asarray(page.asarray())
    full = 2**page.bitspersample - 1 if samples.dtype.kind == "u" else None
    if photometric == tifffile.PHOTOMETRIC.PALETTE:
        samples, full, axes = np.asarray(page.colormap)[:, samples], None, "SYX"
    if axes == "SYX":
        samples = np.moveaxis(samples, 0, -1)
    encoded = samples.dtype.kind != "f"
    if samples.dtype == np.uint16 and page.bitspersample == 16 and photometric in _DIRECT:
        tag = page.tags.get("MaxSampleValue")
        stated = 0 if tag is None else int(np.max(tag.value))
        scaled = unit_range(samples, white, stated, "MaxSampleValue")
        raster = split_alpha(scaled.values, encoded=True, notes=scaled.notes, page=name)
        raster = replace(raster, white=scaled.white, premultiplied=_is_premultiplied(page))
        if photometric == tifffile.PHOTOMETRIC.MINISWHITE:
            raster = replace(raster, values=1 - raster.values)
        return _with_icc_of(page, raster)
    values = integers_to_unit_range(samples, full)
    if photometric == tifffile.PHOTOMETRIC.MINISWHITE and encoded:
        values = 1 - values
    return _with_icc_of(page, split_alpha(values, encoded=encoded, premultiplied=_is_premultiplied(page), page=name))


def _with_icc_of(page: tifffile.TiffPage, raster: Raster) -> Raster:
    """A display signal in the colour space of the profile that a page embeds."""
    tag = page.tags.get("InterColorProfile")
    if tag is None or not raster.encoded:
        return raster
    profile = icc_profile(bytes(tag.value))
    if profile is None:
        return replace(raster, notes=(*raster.notes, UNREAD_PROFILE))
    return _with_profile(raster, profile)


def _is_premultiplied(page: tifffile.TiffPage) -> bool:
    return tifffile.EXTRASAMPLE.ASSOCALPHA in page.extrasamples


# --- OpenEXR: parts, or numbered layers of one part -------------------------------------------------------------------

# A picture consists of the channels R, G, B and perhaps A, bare or with a layer's name ("beauty.R"), or of a single
# channel as grey. In a file of several parts, each part with R, G, B is a picture; if there is none, each part with a
# single channel. In one part without bare R, G, B, the layers are pictures if all their names contain a number ("0.R" …
# "4.B", "plane-10.R"). Other channels that a renderer stored, such as depths and normals, are ignored.


_RGB = ("R", "G", "B")
_FLOAT_BYTES = 4

_Span = tuple[int, int]  # first pixel, and one after the last
_Window = tuple[_Span, _Span]  # x, y


@dataclass(frozen=True)
class _ExrPart:
    """The header of a part."""

    name: str
    channels: tuple[str, ...]
    primaries: Chromaticities | None
    display_window: _Window
    data_window: _Window

    @property
    def data_covers_display(self) -> bool:
        """Whether the display window lies inside the data window."""
        spans = zip(self.data_window, self.display_window, strict=True)
        return all(data[0] <= display[0] and data[1] >= display[1] for data, display in spans)


@dataclass(frozen=True)
class _ImageLocation:
    """The part (by index) and the channels (by name) of a picture."""

    part: int
    colour_channels: tuple[str, ...]
    page: str = ""
    notes: tuple[str, ...] = ()

    @property
    def alpha(self) -> str:
        """Name of the alpha channel of these colours, if the part has it: "A" for "R", "0.A" for "0.R"."""
        layer, dot, _ = self.colour_channels[0].rpartition(".")
        return f"{layer}{dot}A"


def exr_count(path: Path) -> int:
    """Number of pictures, from the headers alone. Raises UserError when there are none, ValueError if damaged."""
    return len(_locate_images(path, _headers(path)))


def exr_pictures(path: Path) -> Iterator[Raster]:
    """Every picture, in the order of the numbers in their names or, without numbers, in that of the file.

    Raises UserError for channels that don't make a picture, RuntimeError and ValueError for damaged files.
    """
    parts = _headers(path)
    locations = _locate_images(path, parts)
    _require_memory(path, parts)
    with OpenEXR.File(str(path), separate_channels=True) as file:  # closing it empties its channels
        if len(file.parts) != len(parts):  # the library leaves out parts that end too early
            raise ValueError(f"{len(file.parts)} of {len(parts)} parts are whole")
        for location in locations:
            yield _exr_raster(dict(file.channels(location.part)), location, parts[location.part])


def _require_memory(path: Path, parts: Sequence[_ExrPart]) -> None:
    """Raises UserError unless all channels of all parts, which the library reads at once, fit beside a picture."""
    stored = sum(len(part.channels) * math.prod(b - a for a, b in part.data_window) for part in parts) * _FLOAT_BYTES
    for part in parts:
        (left, right), (top, bottom) = part.display_window
        require_picture_memory(path, right - left, bottom - top, 3, stored)


def _exr_raster(channels: Mapping[str, Any], location: _ImageLocation, part: _ExrPart) -> Raster:
    names, pixels = location.colour_channels, {name: channel.pixels for name, channel in channels.items()}
    values = np.stack([_in_display_window(pixels[name], part) for name in names], axis=-1)
    alpha = pixels.get(location.alpha)
    if alpha is None and not part.data_covers_display:
        alpha = np.ones_like(pixels[names[0]])
    return Raster(
        values,
        alpha=None if alpha is None else _in_display_window(alpha, part),
        encoded=False,
        premultiplied=True,
        notes=location.notes,
        page=location.page,
        primaries=part.primaries if len(names) == 3 else None,
        is_stated=True,  # without chromaticities an .exr holds the primaries of BT.709, as its format says
    )


def _in_display_window(pixels: NDArray[Any], part: _ExrPart) -> NDArray[np.float64]:
    """The display window (y, x) of a channel that is stored in the data window; 0 outside the latter."""
    overlaps = [_overlap_slices(part.data_window[axis], part.display_window[axis]) for axis in (1, 0)]
    data_slices, display_slices = zip(*overlaps, strict=True)
    image = np.zeros([last - first for first, last in reversed(part.display_window)])
    image[display_slices] = pixels[data_slices]
    return image


def _overlap_slices(data: _Span, display: _Span) -> tuple[slice, slice]:
    """The overlap of two spans, counted from the start of each."""
    first = max(data[0], display[0])
    last = max(min(data[1], display[1]), first)
    return slice(first - data[0], last - data[0]), slice(first - display[0], last - display[0])


def _headers(path: Path) -> list[_ExrPart]:
    if not OpenEXR.isOpenExrFile(str(path)):
        raise ValueError("not a readable OpenEXR file")
    with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
        return [_part(path, dict(file.header(index))) for index in range(len(file.parts))]


def _part(path: Path, header: Mapping[str, Any]) -> _ExrPart:
    channels = header["channels"]
    if any(c.xSampling != 1 or c.ySampling != 1 for c in channels):
        found = "has subsampled channels"
        raise UserError(str(path), found, expected="R, G, B at full size", remedy="export as RGB")
    display, data = _window(header["displayWindow"]), _window(header["dataWindow"])
    for (left, right), (top, bottom) in (display, data):
        if (right - left) * (bottom - top) > MAX_PIXELS:
            raise too_large_error(path, right - left, bottom - top)
    chromaticities = header.get("chromaticities")
    numbers = [] if chromaticities is None else [float(number) for number in chromaticities]
    primaries = tuple(zip(numbers[0::2], numbers[1::2], strict=True)) or None
    return _ExrPart(str(header.get("name", "")), tuple(c.name for c in channels), primaries, display, data)


def _window(corners: tuple[Sequence[int], Sequence[int]]) -> _Window:
    """The spans from the first to the last pixel, whose (x, y) are given."""
    (left, top), (right, bottom) = corners
    return (int(left), int(right) + 1), (int(top), int(bottom) + 1)


def _locate_images(path: Path, parts: Sequence[_ExrPart]) -> list[_ImageLocation]:
    """The pictures in their order. Raises UserError when there are none."""
    if len(parts) == 1:
        return _locate_layers(path, parts[0])
    coloured = [(index, _rgb_channels(part.channels)) for index, part in enumerate(parts)]
    grey = [(index, _grey_channel(part.channels)) for index, part in enumerate(parts)]
    pictures = [entry for entry in coloured if entry[1]] or [entry for entry in grey if entry[1]]
    if not pictures:
        raise _no_picture_error(path, parts[0].channels)
    if all(_has_number(parts[index].name) for index, _ in pictures):
        pictures.sort(key=lambda entry: natural_sort_key(parts[entry[0]].name))
    notes = _ignored_note([part.name for index, part in enumerate(parts) if index not in dict(pictures)])
    return [
        _ImageLocation(index, colours, f'part "{parts[index].name}"' if len(pictures) > 1 else "", notes)
        for index, colours in pictures
    ]


def _locate_layers(path: Path, part: _ExrPart) -> list[_ImageLocation]:
    """The only picture of a single part, or a picture for each of its numbered layers."""
    colours, layers = _rgb_channels(part.channels) or _grey_channel(part.channels), _rgb_layers(part.channels)
    if colours:
        return [_ImageLocation(0, colours, notes=_ignored_note(layers if colours == _RGB else ()))]
    if not layers or not all(_has_number(layer) for layer in layers):
        raise _no_picture_error(path, part.channels)
    ordered = sorted(layers, key=natural_sort_key)
    return [_ImageLocation(0, tuple(f"{layer}.{c}" for c in _RGB), f'layer "{layer}"') for layer in ordered]


def _ignored_note(names: Sequence[str]) -> tuple[str, ...]:
    return (f"left out: {', '.join(names)}",) if names else ()


def _rgb_layers(channels: Iterable[str]) -> list[str]:
    """Names of the layers that have R, G and B."""
    names = set(channels)
    prefixes = sorted({name[:-2] for name in names if name.endswith(".R")})
    return [prefix for prefix in prefixes if {f"{prefix}.G", f"{prefix}.B"} <= names]


def _rgb_channels(channels: Iterable[str]) -> tuple[str, ...]:
    """Names of R, G and B: bare, or those of the only layer that has them; empty otherwise."""
    names = tuple(channels)
    if set(_RGB) <= set(names):
        return _RGB
    layers = _rgb_layers(names)
    return tuple(f"{layers[0]}.{colour}" for colour in _RGB) if len(layers) == 1 else ()


def _grey_channel(channels: Iterable[str]) -> tuple[str, ...]:
    """The only channel beside A, as a tuple; empty when there are several."""
    colours = tuple(name for name in channels if name != "A")
    return colours if len(colours) == 1 else ()


def _has_number(name: str) -> bool:
    return any(character.isdecimal() for character in name)


def _no_picture_error(path: Path, channels: Iterable[str]) -> UserError:
    return UserError(
        str(path),
        f"has the channels {', '.join(channels) or '(none)'}",
        expected="R, G, B or a single channel, or a numbered layer for each plane (0.R, 0.G, 0.B, 1.R …)",
        remedy="export those",
    )


# --- light as numbers, in an .npz that holoview wrote ----------------------------------------------------------------


def light_count(path: Path) -> int:
    """Number of planes."""
    return len(_light_rgb(path)[0])


def light_pictures(path: Path) -> Iterator[Raster]:
    """The linear RGB of each plane of light in a .npz or .npy file.

    Raises UserError for other files, ValueError and others for damaged ones.
    """
    rgb, primaries = _light_rgb(path)
    for number, values in enumerate(rgb, start=1):
        page = f"plane {number}" if len(rgb) > 1 else ""
        yield Raster(values.astype(np.float64), None, encoded=False, page=page, primaries=primaries)


def _light_rgb(path: Path) -> tuple[NDArray[Any], Chromaticities]:
    arrays = light_arrays(path)
    rgb, about = arrays["rgb"], arrays["about"]
    if rgb.ndim != 4 or rgb.shape[3] != 3 or rgb.dtype.kind != "f" or 0 in rgb.shape:
        raise UserError(str(path), f"holds colours of shape {rgb.shape}", expected="(plane, y, x, 3)")
    require_picture_memory(path, rgb.shape[2], rgb.shape[1], 3, rgb.nbytes)
    stated = parse_json_table(about.tobytes().decode("utf-8"), str(path), READABLE_FORMATS)
    return rgb, tuple((float(x), float(y)) for x, y in stated["chromaticities"])


# --- Radiance HDR: red, green and blue with a common exponent ---------------------------------------------------------


_HDR_HEAD_BYTES = 1 << 16
_HDR_SIZE = re.compile(rb"\n\n-Y (\d{1,6}) \+X (\d{1,6})\n")
_HDR_RUNS = (8, 1 << 15)  # columns of pictures whose lines are packed by runs


def _read_hdr(path: Path) -> Raster:
    """Linear light, in the primaries that the file states or else those of sRGB.

    Greg Ward, "Real Pixels", Graphics Gems II (1991): light = (mantissa + 0.5)/256·2^(exponent − 128), here without the
    half, so that 0 is black. EXPOSURE is divided out; a pixel of exponent 0 is black.
    """
    data = read_bytes(path, READABLE_FORMATS)
    found = _HDR_SIZE.search(data, 0, _HDR_HEAD_BYTES)
    if found is None:
        expected = "lines from the top and columns from the left (-Y rows +X columns)"
        raise UserError(str(path), "is a Radiance picture of another layout", expected=expected)
    rows, columns = int(found[1]), int(found[2])
    require_picture_memory(path, columns, rows, 3, 4 * rows * columns + len(data))
    head = data[: found.start()].decode("latin-1").splitlines()
    stated = [line.partition("=") for line in head if "=" in line]
    if any(key == "FORMAT" and value.strip() != "32-bit_rle_rgbe" for key, _, value in stated):
        raise UserError(
            str(path), "holds XYZE numbers", expected="32-bit_rle_rgbe", remedy="convert it by `ra_xyze -r`"
        )
    samples = _hdr_samples(data, found.end(), rows, columns)
    exposure = math.prod(float(value) for key, _, value in stated if key == "EXPOSURE")
    if not (math.isfinite(exposure) and exposure > 0):
        raise ValueError(f"an exposure of {exposure:g}")
    scale = np.where(samples[..., 3] > 0, np.exp2(samples[..., 3].astype(np.float64) - 136), 0.0) / exposure
    numbers = next((value.split() for key, _, value in stated if key == "PRIMARIES"), [])
    primaries = tuple(zip(map(float, numbers[0::2]), map(float, numbers[1::2]), strict=True)) or None
    notes = () if primaries else ("states no primaries: taken as those of sRGB",)
    return Raster(samples[..., :3] * scale[..., None], None, encoded=False, notes=notes, primaries=primaries)


def _hdr_samples(data: bytes, place: int, rows: int, columns: int) -> NDArray[np.uint8]:
    """Mantissas and exponents (y, x, 4). Raises ValueError where the data end too early or a run is too long."""
    is_packed = _HDR_RUNS[0] <= columns < _HDR_RUNS[1] and data[place : place + 2] == b"\2\2"
    if not is_packed:
        flat = np.frombuffer(data, np.uint8, 4 * rows * columns, place).reshape(rows, columns, 4)
        if (flat[..., :3] == 1).all(axis=-1).any():
            raise ValueError("runs of the old kind")
        return flat
    samples = np.empty((rows, 4, columns), np.uint8)
    for line in samples.reshape(rows, -1):
        if data[place : place + 4] != bytes([2, 2, columns >> 8, columns & 255]):
            raise ValueError("a line begins wrongly")
        place = _unpack_runs(data, place + 4, line)
    return samples.transpose(0, 2, 1)


def _unpack_runs(data: bytes, place: int, line: NDArray[np.uint8]) -> int:
    """Fills a line from runs and single numbers; returns the place behind them."""
    filled = 0
    while filled < len(line):
        if place + 2 > len(data):
            raise ValueError("it breaks off")
        count = data[place]
        is_run = count > 128
        count -= 128 * is_run
        values = data[place + 1 : place + 2] if is_run else data[place + 1 : place + 1 + count]
        if count == 0 or filled + count > len(line) or len(values) < (1 if is_run else count):
            raise ValueError("a run is too long")
        line[filled : filled + count] = values[0] if is_run else np.frombuffer(values, np.uint8)
        filled += count
        place += 1 + len(values)
    return place


_READERS: dict[str, Callable[[Path, int | None], Iterable[Raster]]] = {
    "PNG": lambda path, white: [_read_png(path, white)],
    "JPEG": lambda path, white: [_read_with_pillow(path, "JPEG")],
    "GIF": lambda path, white: [_read_with_pillow(path, "GIF")],
    **{kind: partial(_read_boxed, kind) for kind in ("WebP", "AVIF", "HEIC")},
    "TIFF": tiff_pictures,
    "OpenEXR": lambda path, white: exr_pictures(path),
    "NPZ": lambda path, white: light_pictures(path),
    "NPY of light": lambda path, white: light_pictures(path),
    "HDR": lambda path, white: [_read_hdr(path)],
}

_COUNTS: dict[str, Callable[[Path], int]] = {
    "TIFF": tiff_count,
    "OpenEXR": exr_count,
    **dict.fromkeys(("NPZ", "NPY of light"), light_count),
}
"""What counts the pictures of formats that may hold several."""
