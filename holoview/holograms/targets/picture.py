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
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from holoview.holograms.files.colour_profile import ColourProfile, matrix_of_primaries
from holoview.holograms.files.image_reader import file_format, read_animation, read_raster, read_rasters
from holoview.holograms.files.raster import Chromaticities, Raster
from holoview.holograms.targets.framing import FILL, Framing
from holoview.light.colour import COLOUR_SPACES as SCREEN_SPACES
from holoview.light.colour import D65_WHITE, SRGB_TO_XYZ, XYZ_TO_SRGB, observer_weights, srgb_decode, xyz_to_linear_srgb
from holoview.util.errors import UserError
from holoview.util.files import opened_file
from holoview.util.memory_limit import require_memory
from holoview.util.plain_arrays import read_npy_header

__all__ = ["COLOUR_SPACES", "Picture", "depth_notes", "read_depth", "read_picture", "read_pictures", "resize_to_cover"]

_BLOCK_ROWS, _FLOAT64_BYTES = 64, 8
_DEPTH_FILES = "a grey PNG, TIFF or OpenEXR picture or a numpy .npy array"


@dataclass(frozen=True)
class Picture:
    """rgb: (y, x, 3) float32 linear sRGB. source: the file. notes: changes that were made when it was read, for the
    user. white: the number in a file of 16 bits that is white, None for others."""

    rgb: NDArray[np.float32]
    source: str
    notes: tuple[str, ...] = ()
    white: int | None = None


def read_picture(path: str | os.PathLike[str], space: str = "srgb") -> Picture:
    """A PNG, JPEG, TIFF or OpenEXR file as linear light; the first picture of a file with several.

    space: one of `COLOUR_SPACES`. Alpha is composited over black, grey is copied to
    three channels, and values above 1 or below 0 in float files are kept; `notes` mentions each.

    Raises UserError when the file is missing, damaged, no picture or without pixels, holds NaN or infinity, or doesn't
    have three float channels although `space` is "xyz".
    """
    return _to_picture(Path(path), read_raster(Path(path), white_of(space)), space)


class UnreadPicture(Picture):
    """A picture of a file that is read when its light is first asked for, which then raises as `read_picture` does."""

    def __init__(self, path: Path) -> None:
        object.__setattr__(self, "source", str(path))

    @cached_property
    def rgb(self) -> NDArray[np.float32]:
        """The light of the file."""
        return read_picture(self.source).rgb


def read_pictures(path: str | os.PathLike[str], space: str = "srgb") -> Iterator[Picture]:
    """Every picture of a file (TIFF pages, OpenEXR parts or layers), one after the other, as `read_picture` does."""
    for raster in read_rasters(Path(path), white_of(space)):
        yield _to_picture(Path(path), raster, space)


def read_animated(path: str | os.PathLike[str]) -> Iterator[Picture]:
    """Every picture of an animation (GIF, WebP, PNG, AVIF), one after the other, as `read_picture` does."""
    for raster in read_animation(Path(path)):
        yield _to_picture(Path(path), raster, "srgb")


def _to_picture(file: Path, raster: Raster, space: str) -> Picture:
    where = f"{file}, {raster.page}" if raster.page else str(file)
    _check_finite(where, raster.values)
    notes = list(raster.notes)
    light = _decoded_in_blocks(raster.values, raster.profile) if raster.encoded else raster.values
    if raster.alpha is not None:
        light = _composite_over_black(where, raster, light)
        notes.append("alpha composited over black")
    light, note = to_linear_srgb(where, raster, light, space)
    notes += [note] if note else _assumptions(raster, space)
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
    return Picture(rgb, where, tuple(notes), raster.white)


def _assumptions(raster: Raster, space: str) -> list[str]:
    """What is assumed of colours that the file doesn't describe, and no other note tells; nothing of grey ones."""
    if raster.values.shape[-1] != 3 or raster.is_stated or raster.primaries is not None or space == "xyz":
        return []
    if any("taken as" in note for note in raster.notes):
        return []
    return [f"states no colour space: taken as {'sRGB' if raster.encoded else 'linear sRGB'}"]


def _decoded_in_blocks(values: NDArray[np.float64], profile: ColourProfile | None) -> NDArray[np.float64]:
    """The light of a display signal, some rows at a time, so that intermediate results take little memory."""
    light = np.empty_like(values)
    for first in range(0, len(values), _BLOCK_ROWS):
        signal = values[first : first + _BLOCK_ROWS]
        light[first : first + _BLOCK_ROWS] = srgb_decode(signal) if profile is None else profile.linear_srgb(signal)
    return light


def read_depth(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """A depth map (y, x), 0 nearest … 1 farthest.

    Integer files are scaled by their white, which is that of their type or of their bits; float files and arrays must
    hold 0…1 already. The channels of a colour file must be equal. Numpy arrays are loaded without unpickling.

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


def depth_notes(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Remarks on how a depth map was read, such as on its bits. Raises UserError as `read_depth` does."""
    file = Path(path)
    return () if file_format(file) == "NPY" else tuple(f"depth map: {note}" for note in read_raster(file).notes)


def resize_to_cover(array: NDArray[np.float32], shape: tuple[int, int], framing: Framing = FILL) -> NDArray[np.float32]:
    """`array` scaled to `shape` (y, x), which it covers, cropped about its centre, or as a framing says.

    It is unchanged if it has that shape already. Linear light (y, x, channel) is averaged over the source's area, with
    a filter without negative lobes to avoid ringing; beside a picture it is 0. A depth map (y, x) takes the nearest
    sample: an average across an edge would be a depth at which there is no object.

    Raises ValueError when `shape` isn't positive or `array` has neither two nor three axes.
    """
    if min(shape) < 1 or array.ndim not in (2, 3) or min(array.shape) < 1:
        raise ValueError(f"array {array.shape} and shape {shape}: expected (y, x) or (y, x, channel), and a size ≥ 1")
    rows, columns = array.shape[:2]
    left, top, width, height = framing.window((rows, columns), shape)
    scale = shape[0] / height
    if scale == 1 and framing.kind != "fit":
        y, x = math.floor(top), math.floor(left)
        return np.ascontiguousarray(array[y : y + shape[0], x : x + shape[1]], dtype=np.float32)
    if array.ndim == 2:
        lines = _nearest(shape[0], top, scale, rows)
        return np.ascontiguousarray(array[np.ix_(lines, _nearest(shape[1], left, scale, columns))], dtype=np.float32)
    box = max(left, 0.0), max(top, 0.0), min(left + width, columns), min(top + height, rows)
    size = shape
    if framing.kind == "fit":
        size = min(round(rows * scale), shape[0]) or 1, min(round(columns * scale), shape[1]) or 1
    method = Image.Resampling.HAMMING if scale < 1 else Image.Resampling.BILINEAR
    channels = np.moveaxis(np.asarray(array, dtype=np.float32), -1, 0)
    resized = [np.asarray(Image.fromarray(np.ascontiguousarray(c)).resize(size[::-1], method, box)) for c in channels]
    light = np.stack(resized, axis=-1)
    if size == shape:
        return light
    y, x = (shape[0] - size[0]) // 2, (shape[1] - size[1]) // 2
    return np.pad(light, ((y, shape[0] - size[0] - y), (x, shape[1] - size[1] - x), (0, 0)))


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
    return _decoded_in_blocks(np.clip(straight, 0, 1), raster.profile) * alpha


def _single_channel(file: Path, raster: Raster) -> NDArray[np.float64]:
    if raster.alpha is not None and (raster.alpha < 1).any():
        raise UserError(str(file), "is partly transparent", expected="a depth everywhere", remedy="remove its alpha")
    if (raster.values != raster.values[..., :1]).any():
        raise UserError(str(file), "is in colour", expected=f"depths in {_DEPTH_FILES}", remedy="save it as grey")
    return raster.values[..., 0]


def _load_array(file: Path) -> NDArray[np.float64]:
    try:
        with opened_file(file, _DEPTH_FILES) as opened:
            header = read_npy_header(opened, os.fstat(opened.fileno()).st_size, str(file))
            require_memory(str(file), header.nbytes + 3 * math.prod(header.shape) * _FLOAT64_BYTES)
            array = header.array(opened.read(header.nbytes))
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


# --- float images: linear sRGB, CIE XYZ, or the primaries that a file states ------------------------------------------

# The result isn't limited to 0…1. Nothing is lost, since XYZ ↔ linear sRGB is one to one: a colour outside the triangle
# of the sRGB primaries has a negative channel.


_BITS = {"srgb8": 8, "srgb10": 10, "srgb12": 12, "srgb14": 14, "srgb16": 16}
COLOUR_SPACES = ("srgb", "xyz", *_BITS)
"""Interpretations of a float file's three channels: linear sRGB, or CIE XYZ with Y = 1 the display's white (D65).

Of a file of 16 bits, "srgb" recognises white, and "srgb8" to "srgb16" state its bits."""

_SRGB_PRIMARIES = (*SCREEN_SPACES["srgb"].chromaticities, (0.3127, 0.3290))
_XYZ_PRIMARIES = ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0))
"""Chromaticities by which OpenEXR files say that they hold XYZ."""


def white_of(space: str) -> int | None:
    """The number of white that a colour space states for files of 16 bits, None if it states none."""
    return (1 << _BITS[space]) - 1 if space in _BITS else None


def to_linear_srgb(
    where: str, raster: Raster, light: NDArray[np.float64], space: str = "srgb"
) -> tuple[NDArray[np.float64], str]:
    """Light (y, x, 1 or 3) of a raster as linear sRGB of the same shape, and a note on the conversion, or "".

    `space` "xyz" overrides the primaries that the file states. Raises UserError, located at `where`, for another space,
    for "xyz" without three float channels, and for primaries that can't make white.
    """
    if space not in COLOUR_SPACES:
        raise UserError("space", f'"{space}"', expected=" or ".join(COLOUR_SPACES))
    primaries = raster.primaries
    if space == "xyz":
        if raster.encoded or light.shape[-1] != 3:
            found = "holds integers, a display signal" if raster.encoded else "has one channel"
            remedy = "save it as float TIFF or OpenEXR, or read it as sRGB"
            raise UserError(where, found, expected="three float channels of CIE XYZ", remedy=remedy)
        ignored = "" if primaries is None or _is_xyz(primaries) else "; the chromaticities in its header are ignored"
        return xyz_to_linear_srgb(light), f"CIE XYZ converted to linear sRGB{ignored}"
    if primaries is None or _is_srgb(primaries):
        return light, ""
    if _is_xyz(primaries):
        return xyz_to_linear_srgb(light), "CIE XYZ, as its header says, converted to linear sRGB"
    return light @ srgb_from_primaries(where, primaries).T, "converted from the file's own primaries"


def srgb_from_primaries(where: str, chromaticities: Chromaticities) -> NDArray[np.float64]:
    """The matrix (3, 3) from linear light of other primaries to linear sRGB, which maps their white to D65.

    `chromaticities`: (x, y) of red, green, blue and white; SMPTE RP 177 gives the matrix to XYZ. A white other than D65
    is adapted in Bradford's cone space. Raises UserError when the primaries lie on a line, or can't make the white.
    """
    matrix = matrix_of_primaries(np.array(chromaticities, dtype=np.float64)) if len(chromaticities) == 4 else None
    if matrix is None:
        pairs = ", ".join(f"({x:g}, {y:g})" for x, y in chromaticities)
        raise UserError(
            where,
            f"its header states the chromaticities {pairs}",
            expected="red, green, blue and white that span a triangle",
            remedy="export it with other primaries, or without any for sRGB",
        )
    return matrix


def _is_srgb(chromaticities: Chromaticities) -> bool:
    """Whether light of these primaries is linear sRGB already: then no number changes, not even by rounding."""
    return len(chromaticities) == 4 and bool(np.allclose(chromaticities, _SRGB_PRIMARIES, rtol=0, atol=1e-6))


def _is_xyz(chromaticities: Chromaticities) -> bool:
    return bool(np.allclose(chromaticities[:3], _XYZ_PRIMARIES, atol=1e-6))


# Scales chroma in CIE LCHuv at constant lightness and hue, up to the spectral locus, as in the paper's gamut study.
#
# With u′, v′ the CIE 1976 chromaticities, u* = 13·L*·(u′ − u′ₙ) and the same for v* (CIE 15:2004, 8.2.2). L* depends on
# luminance alone, so that scaling the chroma C*uv = √(u*² + v*²) by t at fixed L* and hue moves the chromaticity along
# its ray from white, at fixed luminance:
#
# u′ ← u′ₙ + t·(u′ − u′ₙ)        v′ ← v′ₙ + t·(v′ − v′ₙ)        X = Y·9u′/4v′        Z = Y·(12 − 3u′ − 20v′)/4v′
#
# For t > 1 the ray leaves sRGB and finally the colours that any light can have. Towards blue it even reaches v′ = 0,
# where X and Z are infinite: for the sRGB blue at t = 1.5. Chroma is therefore limited to that of the purest light of
# its hue, on the spectral locus or the line of purples (CIE 1931 2°), inside which X, Y and Z are never negative.


_LOCUS_WAVELENGTHS_M = np.arange(390, 701) * 1e-9  # beyond, the chromaticity hardly changes
_PURPLE_LINE_POINTS = 512


def scale_saturation(rgb_linear: NDArray[np.floating], factor: float) -> NDArray[np.float32]:
    """Linear sRGB (…, 3), inside or outside 0…1, with its chroma in LCHuv (white D65) times `factor`; float32.

    0 gives the grey of the same luminance, 1 changes nothing, and above 1 chroma rises up to that of the purest light
    of the hue; colours beyond it already aren't changed then. Luminance is constant.

    Colours without a chromaticity (Y and X + 15Y + 3Z aren't of one sign: black, or imaginary colours) are mixed with
    the grey of their luminance instead, and a factor above 1 doesn't change them.

    Raises UserError for a negative factor, infinity and NaN.
    """
    check_saturation(factor)
    rgb = np.asarray(rgb_linear)
    if factor == 1:
        return rgb.astype(np.float32)
    x, y, z = np.moveaxis(rgb @ SRGB_TO_XYZ.T, -1, 0)
    lit = y * (x + 15 * y + 3 * z) > 0
    u, v = _uv_chromaticity(np.where(lit, x, D65_WHITE[0]), np.where(lit, y, 1), np.where(lit, z, D65_WHITE[2]))
    white_u, white_v = _uv_chromaticity(*D65_WHITE)
    du, dv = u - white_u, v - white_v
    scale = factor if factor < 1 else np.clip(_max_factor(du, dv), 1, factor)
    u, v = white_u + scale * du, white_v + scale * dv
    weight = min(factor, 1.0)
    scaled_x = np.where(lit, y * 9 * u / (4 * v), weight * x + (1 - weight) * y * D65_WHITE[0])
    scaled_z = np.where(lit, y * (12 - 3 * u - 20 * v) / (4 * v), weight * z + (1 - weight) * y * D65_WHITE[2])
    scaled: NDArray[np.float64] = np.stack([scaled_x, y, scaled_z], axis=-1) @ XYZ_TO_SRGB.T
    return scaled.astype(np.float32)


def check_saturation(factor: float) -> None:
    """Raises UserError for a factor that isn't finite and 0 or more."""
    if not 0 <= factor < np.inf:
        raise UserError(
            "saturation", f"{factor:g}", expected="a factor of 0 or more", remedy="0 is grey, 1 changes nothing"
        )


def _uv_chromaticity(
    x: NDArray[np.float64] | float, y: NDArray[np.float64] | float, z: NDArray[np.float64] | float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """CIE 1976 u′, v′."""
    total = np.asarray(x + 15 * y + 3 * z)
    return 4 * x / total, 9 * y / total


def _max_factor(du: NDArray[np.float64], dv: NDArray[np.float64]) -> NDArray[np.float64]:
    """The factor by which each (u′ − u′ₙ, v′ − v′ₙ) reaches the purest light of its hue; infinite for greys."""
    hues, radii = _spectral_boundary()
    radius = np.interp(np.arctan2(dv, du), hues, radii, period=2 * np.pi)
    distance = np.hypot(du, dv)
    return np.divide(radius, distance, out=np.full_like(radius, np.inf), where=distance > 1e-12 * radius)


@cache
def _spectral_boundary() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Hue angle (rad) and distance from white, in (u′, v′), of the spectral locus and the line of purples."""
    u, v = _uv_chromaticity(*observer_weights("cie1931", _LOCUS_WAVELENGTHS_M).T)
    purples = np.linspace(0, 1, _PURPLE_LINE_POINTS)
    locus_u = np.append(u, u[-1] + purples * (u[0] - u[-1])) - _uv_chromaticity(*D65_WHITE)[0]
    locus_v = np.append(v, v[-1] + purples * (v[0] - v[-1])) - _uv_chromaticity(*D65_WHITE)[1]
    return np.arctan2(locus_v, locus_u), np.hypot(locus_u, locus_v)
