"""PNG, BMP, JPEG, GIF and PGM pictures as the numbers that they store: no colour profile and no gamma is applied."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.files.image_reader import EXIF_ORIENTATION, decode_deep_png
from holoview.holograms.files.readers.contents import Contents, StoredArray, Window
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.memory_limit import require_memory

_MAGIC = (b"\x89PNG\r\n\x1a\n", b"BM", b"\xff\xd8\xff", b"GIF8", b"P4", b"P5", b"P6")
_FORMATS = ("PNG", "BMP", "JPEG", "GIF", "PPM")
_SAMPLES = {"1": 1, "L": 1, "P": 3, "LA": 2, "RGB": 3, "RGBA": 4, "I;16": 1, "I": 1, "CMYK": 4, "YCbCr": 3}
_DECODER_COPIES = 3


class PictureReader:
    """One picture, (y, x) if it is grey and (y, x, 3) in colours; transparency is left out."""

    name = "picture"
    suffixes = (".png", ".bmp", ".jpg", ".jpeg", ".gif", ".pgm", ".ppm")

    def recognises(self, head: bytes) -> bool:
        """Whether it begins as one of the formats."""
        return head.startswith(_MAGIC) and len(head) > 16

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """The picture, decoded when it is loaded."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of metadata that are damaged, which aren't used
            with Image.open(path, formats=_FORMATS) as opened:
                mode, width, height = opened.mode, opened.width, opened.height
                is_deep = opened.format == "PNG" and read_bytes(path, "a picture", most=25)[24] == 16
                is_grey = mode == "P" and _has_grey_palette(opened)
                notes = _notes(opened)
        colours = 1 if is_grey or _SAMPLES.get(mode, 3) < 3 else 3
        dtype = np.dtype("u2" if is_deep or mode.startswith("I") else "?" if mode == "1" else "u1")
        shape = (height, width) if colours == 1 else (height, width, 3)
        if 0 in shape:
            raise UserError(str(path), f"has no pixels: {width} × {height}")
        needed = _DECODER_COPIES * width * height * _SAMPLES.get(mode, 4) * dtype.itemsize
        decoded: list[NDArray[Any]] = []

        def load(window: Window) -> NDArray[Any]:
            if not decoded:
                require_memory(f"{path}, {width} × {height} pixels", needed)
                decoded.append(_decode(path, is_deep, colours, dtype))
            return decoded[0][window]

        yield Contents.of(
            [StoredArray("", shape, dtype, load, axes="yxc"[: len(shape)], whole_bytes=needed)], notes=notes
        )


def _notes(image: Image.Image) -> tuple[str, ...]:
    """Remarks on what of the picture isn't read as it stands."""
    notes = []
    if image.mode in ("LA", "RGBA", "PA"):
        notes.append("transparency is left out")
    frames = getattr(image, "n_frames", 1)
    if frames > 1:
        notes.append(f"it is an animation of {frames} pictures, of which the first is read: save others as files")
    if image.mode == "CMYK":
        notes.append("its inks (CMYK) are converted to red, green and blue")
    elif image.mode in ("P", "PA") and not _has_grey_palette(image):
        notes.append("its numbers are places in a palette of colours, which are read")
    if _orientation(image) != 1:
        notes.append("the camera's orientation flag asks to turn it: rows and columns are left as they stand")
    return tuple(notes)


def _orientation(image: Image.Image) -> int:
    """The camera's flag, 1 for an upright picture and where its metadata are damaged."""
    with suppress(Exception):  # metadata are of no other use here
        return int(image.getexif().get(EXIF_ORIENTATION, 1))
    return 1


def _has_grey_palette(image: Image.Image) -> bool:
    palette = np.array(image.getpalette() or [0, 0, 0]).reshape(-1, 3)
    return bool((palette == palette[:, :1]).all())


def _decode(path: Path, is_deep: bool, colours: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    if is_deep:
        samples: NDArray[Any] = decode_deep_png(read_bytes(path, "a picture"))
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path, formats=_FORMATS) as opened:
                samples = np.asarray(_plain(opened, colours))
    if samples.ndim == 3:
        samples = samples[..., 0] if colours == 1 else samples[..., :3]
    if dtype.kind == "u" and samples.dtype.kind in "iu" and samples.size and int(samples.max()) > np.iinfo(dtype).max:
        raise ValueError(f"levels up to {int(samples.max())}")
    return samples.astype(dtype, copy=False)


def _plain(image: Image.Image, colours: int) -> Image.Image:
    if image.mode in ("1", "L", "RGB", "RGBA", "LA") or image.mode.startswith("I"):
        return image
    return image.convert("L" if colours == 1 else "RGB")
