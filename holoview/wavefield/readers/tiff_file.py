"""TIFF files: grey or coloured pages of integers, floats or complex numbers; pages of one size are frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from holoview.targets.image_reader import naming_missing_codecs, require_page_memory
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.wavefield.readers.contents import Contents, StoredArray, Window
from holoview.wavefield.request import ReadRequest

_MOST_PAGES = 10_000
_EXPECTED = "one picture, or pages of one size"


class TiffReader:
    """The full-size pages of a TIFF file as one array (page, y, x, sample); one page is (y, x) or (y, x, sample)."""

    name = "TIFF"
    suffixes = (".tif", ".tiff")

    def recognises(self, head: bytes) -> bool:
        """Whether byte order and version are those of TIFF or BigTIFF."""
        return head[:4] in (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The pages, decoded when they are loaded; uncompressed ones are mapped into memory."""
        with tifffile.TiffFile(path) as file:
            pages = _full_pages(path, file)
            first = pages[0]
            if first.dtype is None or first.dtype.kind not in "biufc":
                raise UserError(str(path), f"has samples of {first.bitspersample} bits", expected="usual numbers")
            yield Contents.of([_stack(path, pages)])


def _full_pages(path: Path, file: tifffile.TiffFile) -> list[tifffile.TiffPage]:
    """Pages of the size of the first one, without reduced ones. Raises UserError for truncated and too many pages."""
    if len(file.pages) > _MOST_PAGES:
        raise UserError(str(path), f"{len(file.pages)} pages", expected=f"at most {_MOST_PAGES}")
    pages = [file.pages[number] for number in range(len(file.pages))]
    pages = [page for page in pages if not (page.is_reduced or page.is_mask)] or pages
    first, end = pages[0], path.stat().st_size
    for page in pages:
        if (page.shape, page.dtype) != (first.shape, first.dtype):
            raise UserError(str(path), f"pages of {first.shape} and {page.shape}", expected=_EXPECTED)
        if 0 in page.shape or not page.dataoffsets:
            raise UserError(str(path), f"a page of shape {page.shape} without numbers", expected=_EXPECTED)
        last = max(offset + count for offset, count in zip(page.dataoffsets, page.databytecounts, strict=False))
        if last > end or len(page.dataoffsets) != len(page.databytecounts):
            raise UserError(str(path), f"is truncated: {end} bytes", expected=f"{last} bytes")
    if first.axes not in ("YX", "YXS", "SYX"):
        raise UserError(str(path), f"has the TIFF layout {first.axes}", expected=_EXPECTED)
    return pages


def _stack(path: Path, pages: Sequence[tifffile.TiffPage]) -> StoredArray:
    first = pages[0]
    size = int(np.prod(first.shape, dtype=object)) * first.dtype.itemsize
    shape = tuple(first.shape) if len(pages) == 1 else (len(pages), *first.shape)
    is_plain = all(_is_plain(page, size) for page in pages)
    decoded: dict[int, NDArray[Any]] = {}

    def page_values(number: int, window: Window) -> NDArray[Any]:
        page = pages[number]
        if is_plain:
            dtype = page.dtype.newbyteorder(page.parent.byteorder)
            return StoredArray.mapped(path, dtype, tuple(page.shape), page.dataoffsets[0]).load(window)
        if number not in decoded:
            require_page_memory(path, page)
            require_memory(str(path), 3 * size)
            with naming_missing_codecs(path):
                decoded[number] = np.asarray(page.asarray())
        return decoded[number][window]

    def load(window: Window) -> NDArray[Any]:
        if len(pages) == 1:
            return page_values(0, window)
        chosen = range(window[0].start, window[0].stop)
        return np.stack([page_values(number, window[1:]) for number in chosen])

    axes = "f" * (len(pages) > 1) + first.axes.lower().replace("s", "c")
    return StoredArray("", shape, first.dtype, load, axes=axes, whole_bytes=0 if is_plain else (len(pages) + 2) * size)


def _is_plain(page: tifffile.TiffPage, size: int) -> bool:
    """Whether the numbers stand in the file one after the other as they are."""
    whole_bytes = page.bitspersample == 8 * page.dtype.itemsize
    return bool(
        page.compression == 1
        and page.predictor == 1
        and page.fillorder == 1
        and whole_bytes
        and page.is_contiguous
        and sum(page.databytecounts) >= size
    )
