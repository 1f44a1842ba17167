"""Pictures in TIFF files: pages, except thumbnails and masks."""

from __future__ import annotations

import io
import logging
import lzma
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from holoview.holograms.files.colour_profile import UNREAD_PROFILE, icc_profile
from holoview.holograms.files.raster import (
    READABLE_FORMATS,
    Raster,
    integers_to_unit_range,
    require_picture_memory,
    split_alpha,
    unit_range,
    with_profile,
)
from holoview.util.errors import UserError
from holoview.util.files import opened_file
from holoview.util.packages import import_optional

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # its messages become an error here, in one line

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
    return with_profile(raster, profile)


def _is_premultiplied(page: tifffile.TiffPage) -> bool:
    return tifffile.EXTRASAMPLE.ASSOCALPHA in page.extrasamples
