"""TIFF files: grey or coloured pages of integers, floats or complex numbers; pages of one size are frames.

Of the hyperstacks of ImageJ and of files with an OME description, channels are colours, and the pitch is that of their
calibration.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from holoview.holograms.files.readers.contents import Contents, Facts, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.holograms.files.tiff_picture import check_page_list, naming_missing_codecs, require_page_memory
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

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
        """The pages, decoded when they are loaded; of uncompressed ones a window is read."""
        check_page_list(path)
        with tifffile.TiffFile(path) as file:
            pages = _full_pages(path, file)
            first = pages[0]
            if first.dtype is None or first.dtype.kind not in "biufc":
                raise UserError(str(path), f"has samples of {first.bitspersample} bits", expected="usual numbers")
            stack = _by_axes(_stack(path, pages), _page_axes(path, file, len(pages)))
            array, notes = _as_light(stack, first)
            if "c" in stack.axes and "s" not in first.axes.lower():
                notes += (f"its {stack.shape[stack.axes.index('c')]} channels are taken as colours",)
            yield Contents.of([array], Facts(pitch_m=_calibrated_pitch_m(file)), notes)


def _page_axes(path: Path, file: tifffile.TiffFile, count: int) -> tuple[int, int]:
    """Numbers of frames and of channels that the pages are, as ImageJ or an OME description says; all frames else.

    Frames are time steps and slices. Raises UserError where the description tells of more pictures than there are.
    """
    if file.is_imagej:
        table = file.imagej_metadata or {}
        frames, channels = int(table.get("frames", 1)) * int(table.get("slices", 1)), int(table.get("channels", 1))
        frames = max(frames, int(table.get("images", 1)) // max(channels, 1))
    elif file.is_ome:
        text = file.ome_metadata or ""
        found = {axis: re.search(rf'\bSize{axis}="(\d{{1,9}})"', text) for axis in "CZT"}
        sizes = {axis: int(number[1]) if number else 1 for axis, number in found.items()}
        frames, channels = sizes["Z"] * sizes["T"], sizes["C"]
        is_outermost = frames > 1 and 'DimensionOrder="XYC' not in text
        if file.pages.first.samplesperpixel > 1 or (is_outermost and channels > 1):
            return count, 1
    else:
        return count, 1
    if frames * channels > count:
        pictures = f"{frames * channels} pictures, and has pages for {count}"
        raise UserError(str(path), f"describes {pictures}", expected="a page for each", remedy="save the stack again")
    return (frames, channels) if frames * channels == count else (count, 1)


def _by_axes(stack: StoredArray, sizes: tuple[int, int]) -> StoredArray:
    """The pages with an axis for frames and one for channels, which are colours."""
    frames, channels = sizes
    if channels == 1 or "c" in stack.axes:
        return stack

    def load(window: Window) -> NDArray[Any]:
        if frames == 1:
            return stack.load(window)
        chosen = [stack.load((slice(t * channels + window[1].start, t * channels + window[1].stop), *window[2:]))
                  for t in range(window[0].start, window[0].stop)]  # fmt: skip
        return np.stack(chosen)

    if frames == 1:
        return replace(stack, axes="cyx")
    return replace(stack, shape=(frames, channels, *stack.shape[1:]), axes="fcyx", load=load)


def _as_light(stack: StoredArray, page: tifffile.TiffPage) -> tuple[StoredArray, tuple[str, ...]]:
    """The samples as numbers that grow with light, without transparency; and remarks on what was done."""
    extras = len(page.extrasamples)
    notes: tuple[str, ...] = ()
    if extras and "c" in stack.axes and page.axes != "YX":
        axis = stack.axes.index("c")
        colours = stack.shape[axis] - extras
        kept = stack if colours > 1 else stack.at(axis, 0)
        stack = replace(kept, shape=(*stack.shape[:axis], colours, *stack.shape[axis + 1 :]))
        notes += ("transparency and other extra samples are left out",)
    if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE and stack.dtype.kind in "bu":
        white = True if stack.dtype.kind == "b" else 2**page.bitspersample - 1
        plain = stack.load
        stack = replace(stack, load=lambda window: (white - plain(window).astype("i8")).astype(stack.dtype))
        notes += ("its smallest number is white (WhiteIsZero): turned round, so that numbers grow with light",)
    if page.photometric == tifffile.PHOTOMETRIC.PALETTE and page.colormap is not None:
        return _coloured(stack, page, notes)
    if page.photometric == tifffile.PHOTOMETRIC.SEPARATED:
        notes += ("its colours are those of inks (CMYK), which are read as they stand",)
    return stack, notes


def _coloured(
    stack: StoredArray, page: tifffile.TiffPage, notes: tuple[str, ...]
) -> tuple[StoredArray, tuple[str, ...]]:
    """A picture with a palette: its numbers if these are the greys, else the colours that they stand for."""
    palette = np.asarray(page.colormap)
    ramp = np.arange(palette.shape[1]) * 65535 / (palette.shape[1] - 1)
    if np.abs(palette - ramp).max() <= 256:
        return stack, notes
    plain = stack.load
    if (palette == palette[:1]).all():
        grey = replace(stack, dtype=palette.dtype, load=lambda window: palette[0][plain(window)])
        return grey, (*notes, "its numbers are places in a palette of greys, which are read")

    def load(window: Window) -> NDArray[Any]:
        return np.moveaxis(palette[:, plain(window[:-1])], 0, -1)[..., window[-1]]

    shape, axes = (*stack.shape, 3), f"{stack.axes}c"
    coloured = replace(stack, shape=shape, dtype=palette.dtype, load=load, axes=axes)
    return coloured, (*notes, "its numbers are places in a palette of colours, which are read")


_MICROMETRES = {
    "micron": 1.0,
    "microns": 1.0,
    "um": 1.0,
    "µm": 1.0,
    "μm": 1.0,
    "nm": 1e-3,
    "mm": 1e3,
    "cm": 1e4,
    "m": 1e6,
}


def _calibrated_pitch_m(file: tifffile.TiffFile) -> tuple[float, float] | None:
    """The pitch (y, x) that a calibration by ImageJ or an OME description states; None if there is none."""
    page = file.pages.first
    if file.is_imagej:
        unit = _MICROMETRES.get(str((file.imagej_metadata or {}).get("unit", "")).replace("\\u00B5", "µ"))
        tags = [page.tags.get(name) for name in ("YResolution", "XResolution")]
        if unit is None or any(tag is None or not min(tag.value) > 0 for tag in tags):
            return None
        y, x = (tag.value[1] / tag.value[0] * unit * 1e-6 for tag in tags)
        return (y, x) if _is_pitch(y) and _is_pitch(x) else None
    if not file.is_ome:
        return None
    found = [re.search(rf'PhysicalSize{axis}="([\d.eE+-]{{1,30}})"', file.ome_metadata or "") for axis in "YX"]
    units = [re.search(rf'PhysicalSize{axis}Unit="([^"]{{1,10}})"', file.ome_metadata or "") for axis in "YX"]
    scales = [_MICROMETRES.get(unit[1]) if unit else 1.0 for unit in units]
    if any(number is None for number in found) or None in scales:
        return None
    y, x = (float(number[1]) * (scale or 0) * 1e-6 for number, scale in zip(found, scales, strict=True) if number)
    return (y, x) if _is_pitch(y) and _is_pitch(x) else None


def _is_pitch(length_m: float) -> bool:
    return 1e-9 <= length_m <= 1e-3


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
