"""The decoded image (`Raster`) before its colours are interpreted, and helpers that all decoders share."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

MAX_PIXELS = 1 << 27
"""Larger pictures are refused, since a damaged header may claim any size."""

_SAMPLE_BYTES, _PIXEL_BYTES = 16, 32
"""Memory at the peak of reading a picture as light: for each stored sample, and for each pixel in three colours."""

Chromaticities = tuple[tuple[float, float], ...]
"""CIE (x, y) of red, green, blue and white."""


@dataclass(frozen=True)
class Raster:
    """Decoded samples of one picture.

    values: (y, x, 1 or 3), integers scaled to 0…1 of their full range, floats as stored. alpha: (y, x) or None.
    encoded: whether the samples were integers (a display signal) rather than floats (light).
    premultiplied: whether the colours are already multiplied by alpha. notes: what was changed, for the user.
    page: which picture of a file with several, in words. primaries: those that the file states.
    """

    values: NDArray[np.float64]
    alpha: NDArray[np.float64] | None
    encoded: bool
    premultiplied: bool = False
    notes: tuple[str, ...] = ()
    page: str = ""
    primaries: Chromaticities | None = None


def integers_to_unit_range(samples: NDArray[Any], full_scale: int | None = None) -> NDArray[np.float64]:
    """Unsigned integers divided by the full scale of their type or by `full_scale`; floats and booleans unscaled."""
    if samples.dtype.kind in "fb":
        return samples.astype(np.float64)
    if samples.dtype.kind != "u":
        raise ValueError(f"samples of type {samples.dtype} have no fixed white")
    return samples / float(full_scale if full_scale is not None else np.iinfo(samples.dtype).max)


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
