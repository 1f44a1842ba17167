"""Reads the pages of TIFF files as rasters, except thumbnails and masks."""

from __future__ import annotations

import lzma
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from holoview.targets.raster import Raster, integers_to_unit_range, require_picture_memory, split_alpha
from holoview.util.errors import UserError
from holoview.util.optional_library import import_optional

_PHOTOMETRICS = (
    tifffile.PHOTOMETRIC.MINISWHITE,
    tifffile.PHOTOMETRIC.MINISBLACK,
    tifffile.PHOTOMETRIC.RGB,
    tifffile.PHOTOMETRIC.PALETTE,
    tifffile.PHOTOMETRIC.YCBCR,
)


def tiff_count(path: Path) -> int:
    """Number of pictures. Raises ValueError when the linked list of pages is truncated."""
    with tifffile.TiffFile(path) as file:
        return len(_pages(file))


def tiff_pictures(path: Path) -> Iterator[Raster]:
    """Every picture in the file's order; pages are decoded one by one.

    Raises UserError for layouts and colours other than one flat picture, ValueError and others for damaged files.
    """
    with tifffile.TiffFile(path) as file:
        pages = _pages(file)
        for number, page in enumerate(pages, start=1):
            yield _raster(path, page, f"page {number}" if len(pages) > 1 else "")


_MOST_PAGES = 10_000
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
    """Raises UserError if a compressed part holds more than the picture: it is decompressed in pieces to see.

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


def _raster(path: Path, page: tifffile.TiffPage, name: str) -> Raster:
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
    encoded, values = samples.dtype.kind != "f", integers_to_unit_range(samples, full)
    if photometric == tifffile.PHOTOMETRIC.MINISWHITE and encoded:
        values = 1 - values
    premultiplied = tifffile.EXTRASAMPLE.ASSOCALPHA in page.extrasamples
    return split_alpha(values, encoded=encoded, premultiplied=premultiplied, page=name)
