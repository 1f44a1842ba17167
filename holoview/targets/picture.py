"""Reads a picture or a depth map as linear light, and resizes it to the simulation grid.

Integer files hold a display signal and are decoded with the sRGB curve. Float files hold light: linear sRGB, other
primaries where an OpenEXR file states them, or CIE XYZ where the caller says so. All become (y, x, 3) linear light with
sRGB primaries, where 1 is the display's white; colours outside sRGB are kept as values outside 0…1.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.colour import srgb_decode
from holoview.targets.colour_spaces import COLOUR_SPACES, to_linear_srgb
from holoview.targets.image_reader import file_format, read_raster, read_rasters
from holoview.targets.raster import Raster
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

__all__ = ["COLOUR_SPACES", "Picture", "read_depth", "read_picture", "read_pictures", "resize_to_cover"]

_BLOCK_ROWS, _FLOAT64_BYTES = 64, 8
_DEPTH_FILES = "a grey PNG, TIFF or OpenEXR picture or a numpy .npy array"


@dataclass(frozen=True)
class Picture:
    """rgb: (y, x, 3) float32 linear sRGB. source: the file. notes: what was changed when it was read, for the user."""

    rgb: NDArray[np.float32]
    source: str
    notes: tuple[str, ...] = ()


def read_picture(path: str | os.PathLike[str], space: str = "srgb") -> Picture:
    """A PNG, JPEG, TIFF or OpenEXR file as linear light; the first picture of a file with several.

    space: what a float file holds, one of `COLOUR_SPACES`. Alpha is composited over black, grey is copied to three
    channels, and values above 1 or below 0 in float files are kept; `notes` mentions each.

    Raises UserError when the file is missing, damaged, no picture or without pixels, holds NaN or infinity, or doesn't
    have three float channels although `space` is "xyz".
    """
    return _to_picture(Path(path), read_raster(Path(path)), space)


def read_pictures(path: str | os.PathLike[str], space: str = "srgb") -> Iterator[Picture]:
    """Every picture of a file (TIFF pages, OpenEXR parts or layers), one after the other, as `read_picture` does."""
    for raster in read_rasters(Path(path)):
        yield _to_picture(Path(path), raster, space)


def _to_picture(file: Path, raster: Raster, space: str) -> Picture:
    where = f"{file}, {raster.page}" if raster.page else str(file)
    _check_finite(where, raster.values)
    notes = list(raster.notes)
    light = _decoded_in_blocks(raster.values) if raster.encoded else raster.values
    if raster.alpha is not None:
        light = _composite_over_black(where, raster, light)
        notes.append("alpha composited over black")
    light, note = to_linear_srgb(where, raster, light, space)
    notes += [note] if note else []
    if light.shape[-1] == 1:
        light = np.repeat(light, 3, axis=-1)
        notes.append("grey copied to red, green and blue")
    with np.errstate(over="ignore"):
        rgb = light.astype(np.float32)
    _check_finite(where, rgb)
    if rgb.max() > 1:
        notes.append(f"values up to {rgb.max():.4g} kept: brighter than the display's white (1)")
    if rgb.min() < 0:
        notes.append(f"values down to {rgb.min():.4g} kept: colours outside sRGB")
    return Picture(rgb, where, tuple(notes))


def _decoded_in_blocks(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The light of a display signal, some rows at a time, so that intermediate results take little memory."""
    light = np.empty_like(values)
    for first in range(0, len(values), _BLOCK_ROWS):
        light[first : first + _BLOCK_ROWS] = srgb_decode(values[first : first + _BLOCK_ROWS])
    return light


def read_depth(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """A depth map (y, x), 0 nearest … 1 farthest.

    Integer files are scaled by the full range of their type; float files and arrays must hold 0…1 already. The channels
    of a colour file must be equal. Numpy arrays are loaded without unpickling.

    Raises UserError as `read_picture` does, and for colours, transparency, and float values outside 0…1.
    """
    file = Path(path)
    values = _load_array(file) if file_format(file) == "NPY" else _single_channel(file, read_raster(file))
    if values.ndim != 2 or values.size == 0:
        raise UserError(str(file), f"holds an array of shape {values.shape}", expected="depths of shape (y, x)")
    _check_finite(str(file), values)
    low, high = float(values.min()), float(values.max())
    if low < 0 or high > 1:
        raise UserError(
            str(file),
            f"holds depths from {low:.4g} to {high:.4g}",
            expected="0 (nearest) … 1 (farthest)",
            remedy="rescale",
        )
    return values.astype(np.float32)


def resize_to_cover(array: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """`array` scaled to cover `shape` (y, x) and cropped about its centre; unchanged if it has that shape already.

    Linear light (y, x, channel) is averaged over the source's area, with a filter without negative lobes to avoid
    ringing. A depth map (y, x) takes the nearest sample: an average across an edge would be a depth at which there is
    no object.

    Raises ValueError when `shape` isn't positive or `array` has neither two nor three axes.
    """
    if min(shape) < 1 or array.ndim not in (2, 3) or min(array.shape) < 1:
        raise ValueError(f"array {array.shape} and shape {shape}: expected (y, x) or (y, x, channel), and a size ≥ 1")
    height, width = array.shape[:2]
    scale = max(shape[0] / height, shape[1] / width)
    used = shape[0] / scale, shape[1] / scale
    top, left = (height - used[0]) / 2, (width - used[1]) / 2
    if scale == 1:
        y, x = math.floor(top), math.floor(left)
        return np.ascontiguousarray(array[y : y + shape[0], x : x + shape[1]], dtype=np.float32)
    if array.ndim == 2:
        rows = _nearest(shape[0], top, scale, height)
        columns = _nearest(shape[1], left, scale, width)
        return np.ascontiguousarray(array[np.ix_(rows, columns)], dtype=np.float32)
    box = max(left, 0.0), max(top, 0.0), min(left + used[1], width), min(top + used[0], height)
    method = Image.Resampling.HAMMING if scale < 1 else Image.Resampling.BILINEAR
    channels = np.moveaxis(np.asarray(array, dtype=np.float32), -1, 0)
    size = shape[1], shape[0]
    resized = [np.asarray(Image.fromarray(np.ascontiguousarray(c)).resize(size, method, box)) for c in channels]
    return np.stack(resized, axis=-1)


def _nearest(count: int, start: float, scale: float, size: int) -> NDArray[np.int64]:
    """Index of the source sample at the middle of each of `count` results."""
    index: NDArray[np.int64] = np.floor(start + (np.arange(count) + 0.5) / scale).astype(np.int64)
    return np.clip(index, 0, size - 1)


def _composite_over_black(where: str, raster: Raster, light: NDArray[np.float64]) -> NDArray[np.float64]:
    """The light times alpha. Premultiplied light contains it; a premultiplied signal is divided by it to be decoded."""
    assert raster.alpha is not None
    _check_finite(where, raster.alpha)
    alpha = np.clip(raster.alpha, 0, 1)[..., None]
    if not raster.premultiplied:
        return light * alpha
    if not raster.encoded:
        return light
    straight = np.divide(raster.values, alpha, out=np.zeros_like(raster.values), where=alpha > 0)
    return srgb_decode(np.clip(straight, 0, 1)) * alpha


def _single_channel(file: Path, raster: Raster) -> NDArray[np.float64]:
    if raster.alpha is not None and (raster.alpha < 1).any():
        raise UserError(str(file), "is partly transparent", expected="a depth everywhere", remedy="remove its alpha")
    if (raster.values != raster.values[..., :1]).any():
        raise UserError(str(file), "is in colour", expected=f"depths in {_DEPTH_FILES}", remedy="save it as grey")
    return raster.values[..., 0]


def _load_array(file: Path) -> NDArray[np.float64]:
    try:
        mapped = np.load(file, mmap_mode="r", allow_pickle=False)  # reads the header; the file must be long enough
        require_memory(str(file), mapped.size * (mapped.itemsize + 3 * _FLOAT64_BYTES))
        array = np.array(mapped)
    except UserError:
        raise
    except Exception as error:  # numpy's parser of headers raises those of Python's
        raise UserError(
            str(file),
            f"the array is damaged or holds Python objects ({next(iter(str(error).splitlines()), '')})",
            expected="plain numbers",
            remedy="save it again with numpy.save",
        ) from error
    if array.dtype.kind == "u":
        return np.asarray(array / float(np.iinfo(array.dtype).max), dtype=np.float64)
    if array.dtype.kind != "f":
        raise UserError(str(file), f"holds {array.dtype} values", expected="unsigned integers, or floats in 0…1")
    return np.asarray(array, dtype=np.float64)


def _check_finite(where: str, values: NDArray[np.floating]) -> None:
    count = int(np.count_nonzero(~np.isfinite(values)))
    if count:
        found = f"{count} of {values.size} values are NaN or infinite"
        raise UserError(where, found, expected="finite numbers", remedy="repair the file or export it again")
