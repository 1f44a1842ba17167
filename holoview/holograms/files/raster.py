"""Decoded samples of a picture, before its colours are interpreted: their range, alpha, and limits of memory."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.files.colour_profile import ColourProfile
from holoview.light.numerics.sample_bits import find_bits
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

READABLE_FORMATS = "a Radiance HDR, WebP, AVIF, HEIC, GIF, PNG, JPEG, TIFF or OpenEXR picture"

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


def with_profile(raster: Raster, profile: ColourProfile | None) -> Raster:
    """A display signal with the colour space that its file states, which a remark names unless it is sRGB."""
    if profile is None:
        return raster
    raster = replace(raster, is_stated=True)
    if profile.is_srgb:
        return raster
    return replace(raster, profile=profile, notes=(*raster.notes, f"converted from its colour space, {profile.title}"))


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
