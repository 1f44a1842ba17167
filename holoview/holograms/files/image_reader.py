"""Decodes PNG, JPEG, WebP, AVIF, HEIC, GIF, TIFF, OpenEXR and Radiance HDR files as rasters; colours stay as they are.

The format is recognised by the file's first bytes, never by its name.
"""

from __future__ import annotations

import importlib.util
import io
import math
import re
import struct
import warnings
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, features

from holoview.holograms.files.colour_profile import UNREAD_PROFILE, icc_profile, png_profile
from holoview.holograms.files.exr_picture import exr_count, exr_pictures
from holoview.holograms.files.light_arrays import is_npy_of_light, light_arrays
from holoview.holograms.files.raster import (
    READABLE_FORMATS,
    Chromaticities,
    Raster,
    integers_to_unit_range,
    require_picture_memory,
    split_alpha,
    unit_range,
    with_profile,
)
from holoview.holograms.files.tiff_picture import tiff_count, tiff_pictures
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.reader_process import Answer, call_in_child, in_child
from holoview.util.tables import parse_json_table

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
_MOST_BITS_OFF = 3 / 255  # between the decoders of 8 and of all bits
_PNG_SAMPLES = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # a pixel, by the colour type
Image.MAX_IMAGE_PIXELS = None  # sizes are checked here, before anything is decoded


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
    return with_profile(replace(raster, notes=notes, is_stated=is_stated), profile)


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
    return with_profile(replace(raster, is_stated=is_stated), profile)


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
