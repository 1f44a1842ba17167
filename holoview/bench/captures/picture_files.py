"""Pictures and patterns in files of their own: greyscale PNG and TIFF, JPEG with what it costs, and lists of pairs."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.files.raster import require_picture_memory
from holoview.holograms.files.tiff_picture import check_page_list, naming_missing_codecs, require_page_memory
from holoview.util.errors import UserError
from holoview.util.files import read_text, require_file
from holoview.util.reader_process import call_in_child

JPEG_SUFFIXES = (".jpg", ".jpeg")
UNKNOWN = "unknown"


def read_greyscale(path: Path, what: str = "a picture") -> NDArray[Any]:
    """Reads the values (y, x) of a greyscale PNG or TIFF, or of three equal channels, unchanged, as uint8 or uint16.

    what: is expected, in errors. Raises UserError for a file that is missing, can't be decoded, or isn't greyscale of 8
    or 16 bits.
    """
    require_file(path, what)
    return _grey(call_in_child(str(path), path, partial(_decode, path)), path)


@dataclass(frozen=True)
class JpegLoss:
    """What JPEG took from a picture: error_counts, r.m.s., at most about; largest_step: of its table, counts."""

    error_counts: float
    largest_step: int

    def sentence(self, name: str) -> str:
        """The loss in words."""
        return (
            f"{name} is a JPEG: its blocks of 8 × 8 pixels were rounded in steps of up to {self.largest_step} counts, "
            f"an error of up to {self.error_counts:.2g} counts r.m.s. that counts as noise; fine and faint speckle is "
            "lost, and the camera's own noise can't be told: keep PNG or TIFF"
        )


def read_camera_picture(path: Path) -> tuple[NDArray[Any], JpegLoss | None]:
    """As `read_greyscale`, also of a JPEG, with its loss.

    Coefficients of orthonormal blocks, rounded in steps q, are wrong by q/√12 r.m.s., and pixels by their mean square.
    """
    if path.suffix.lower() not in JPEG_SUFFIXES:
        return read_greyscale(path, "a camera's picture"), None
    require_file(path, "a camera's picture")
    values, table = call_in_child(str(path), path, partial(_decode_jpeg, path))
    steps = np.array(table, dtype=np.float64)
    return _grey(values, path), JpegLoss(math.sqrt(float(np.mean(steps**2)) / 12), int(steps.max()))


def read_pattern(path: Path) -> NDArray[Any]:
    """As `read_greyscale`, of a pattern. Raises UserError for a JPEG: its blocks change the levels."""
    if path.suffix.lower() in JPEG_SUFFIXES:
        expected = "the levels that were sent, in PNG or TIFF"
        raise UserError(str(path), "is a JPEG, whose blocks change the levels", expected=expected)
    return read_greyscale(path, "a pattern")


def _grey(values: NDArray[Any], path: Path) -> NDArray[Any]:
    if values.ndim == 3 and values.shape[2] in (3, 4) and values.dtype.kind == "u":
        spread = values[..., :3].max(axis=2).astype(int) - values[..., :3].min(axis=2)
        if spread.any():
            y, x = (int(k) for k in np.unravel_index(int(spread.argmax()), spread.shape))
            found = f"a picture in colour: its channels differ by up to {spread.max()} (row {y}, column {x})"
            remedy = "save the one channel that was shown or seen as greyscale"
            raise UserError(str(path), found, expected="a greyscale picture, or three equal channels", remedy=remedy)
        values = values[..., 0]
    if values.ndim == 2 and values.dtype.kind == "i" and values.size and values.min() >= 0 and values.max() < 65536:
        values = values.astype(np.uint16)  # Pillow decodes some 16-bit files as int32
    if values.ndim != 2 or values.dtype not in (np.uint8, np.uint16):
        found = f"an array of shape {values.shape}, {values.dtype}"
        raise UserError(str(path), found, expected="a greyscale picture of 8 or 16 bits")
    return values


def _decode(path: Path) -> NDArray[Any]:
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            check_page_list(path)
            with naming_missing_codecs(path), tifffile.TiffFile(path) as file:
                require_page_memory(path, file.pages.first)
                return np.asarray(file.pages.first.asarray())
        else:
            with Image.open(path, formats=("PNG",)) as image:
                require_picture_memory(path, image.width, image.height, 1)
                return np.asarray(image.convert("RGB") if image.mode == "P" else image)
    except UserError:
        raise
    except Exception as error:  # each decoder raises exceptions of its own
        raise UserError(str(path), f"can't be decoded: {error}", expected="a greyscale PNG or TIFF") from error


def _decode_jpeg(path: Path) -> tuple[NDArray[Any], list[int]]:
    try:
        with Image.open(path, formats=("JPEG",)) as image:
            require_picture_memory(path, image.width, image.height, 1)
            table: list[int] = image.quantization[0]  # type: ignore[attr-defined]
            return np.asarray(image), table
    except UserError:
        raise
    except Exception as error:  # Pillow's decoder raises exceptions of its own
        raise UserError(str(path), f"can't be decoded: {error}", expected="a greyscale JPEG") from error


@dataclass(frozen=True)
class KnownNumber:
    """Type of a field: a number above 0, or 0 as well if `has_zero`; NaN, in text "unknown", where nobody knows it."""

    has_zero: bool = False
    metavar: ClassVar[str] = f"N | {UNKNOWN}"
    is_appended: ClassVar[bool] = False

    def parse(self, value: Any, where: str) -> float:
        if value is math.nan or str(value).strip().lower() == UNKNOWN:
            return math.nan
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not (0 < number < math.inf or (self.has_zero and number == 0)):
            raise UserError(where, f'"{value}"', expected=self.format_range())
        return number

    def format_range(self) -> str:
        """What is expected, for error messages."""
        return f'a number {"from" if self.has_zero else "above"} 0, or "{UNKNOWN}"'


@dataclass(frozen=True)
class Pair:
    """A picture and the pattern that was shown; power and exposure_s are NaN where nobody knows."""

    picture: Path
    pattern: Path
    power: float = math.nan
    exposure_s: float = math.nan


def read_pairs(path: Path) -> list[Pair]:
    """The pairs of a CSV with columns image and slm1, and power and exposure where these are known.

    Files are beside the table. Raises UserError, which names the line, for cells that are missing or no numbers.
    """
    expected = "columns image, slm1 and, if known, power, exposure: a line a picture"
    try:
        lines = list(csv.DictReader(io.StringIO(read_text(path, expected), newline=""), skipinitialspace=True))
    except csv.Error as error:
        raise UserError(str(path), f"can't be read: {error}", expected=expected) from error
    if not lines:
        raise UserError(str(path), "is empty", expected=expected)
    pairs = []
    for number, line in enumerate(lines, start=2):
        for name in ("image", "slm1"):
            if not line.get(name):
                raise UserError(f"{path}, line {number}: {name}", "is missing", expected=expected)
        settings = [
            KnownNumber().parse(line.get(name) or UNKNOWN, f"{path}, line {number}: {name}") for name in _SETTINGS
        ]
        pairs.append(Pair(path.parent / line["image"], path.parent / line["slm1"], *settings))
    return pairs


_SETTINGS = ("power", "exposure")
