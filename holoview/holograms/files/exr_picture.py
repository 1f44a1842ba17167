"""Pictures in OpenEXR files: parts, or numbered layers of one part."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from holoview.holograms.files.raster import (
    MAX_PIXELS,
    Chromaticities,
    Raster,
    natural_sort_key,
    require_picture_memory,
    too_large_error,
)
from holoview.util.errors import UserError

# A picture consists of the channels R, G, B and perhaps A, bare or with a layer's name ("beauty.R"), or of a single
# channel as grey. In a file of several parts, each part with R, G, B is a picture; if there is none, each part with a
# single channel. In one part without bare R, G, B, the layers are pictures if all their names contain a number ("0.R" …
# "4.B", "plane-10.R"). Other channels that a renderer stored, such as depths and normals, are ignored.


_RGB = ("R", "G", "B")
_FLOAT_BYTES = 4

_Span = tuple[int, int]  # first pixel, and one after the last
_Window = tuple[_Span, _Span]  # x, y


@dataclass(frozen=True)
class _ExrPart:
    """The header of a part."""

    name: str
    channels: tuple[str, ...]
    primaries: Chromaticities | None
    display_window: _Window
    data_window: _Window

    @property
    def data_covers_display(self) -> bool:
        """Whether the display window lies inside the data window."""
        spans = zip(self.data_window, self.display_window, strict=True)
        return all(data[0] <= display[0] and data[1] >= display[1] for data, display in spans)


@dataclass(frozen=True)
class _ImageLocation:
    """The part (by index) and the channels (by name) of a picture."""

    part: int
    colour_channels: tuple[str, ...]
    page: str = ""
    notes: tuple[str, ...] = ()

    @property
    def alpha(self) -> str:
        """Name of the alpha channel of these colours, if the part has it: "A" for "R", "0.A" for "0.R"."""
        layer, dot, _ = self.colour_channels[0].rpartition(".")
        return f"{layer}{dot}A"


def exr_count(path: Path) -> int:
    """Number of pictures, from the headers alone. Raises UserError when there are none, ValueError if damaged."""
    return len(_locate_images(path, _headers(path)))


def exr_pictures(path: Path) -> Iterator[Raster]:
    """Every picture, in the order of the numbers in their names or, without numbers, in that of the file.

    Raises UserError for channels that don't make a picture, RuntimeError and ValueError for damaged files.
    """
    parts = _headers(path)
    locations = _locate_images(path, parts)
    _require_memory(path, parts)
    with OpenEXR.File(str(path), separate_channels=True) as file:  # closing it empties its channels
        if len(file.parts) != len(parts):  # the library leaves out parts that end too early
            raise ValueError(f"{len(file.parts)} of {len(parts)} parts are whole")
        for location in locations:
            yield _exr_raster(dict(file.channels(location.part)), location, parts[location.part])


def _require_memory(path: Path, parts: Sequence[_ExrPart]) -> None:
    """Raises UserError unless all channels of all parts, which the library reads at once, fit beside a picture."""
    stored = sum(len(part.channels) * math.prod(b - a for a, b in part.data_window) for part in parts) * _FLOAT_BYTES
    for part in parts:
        (left, right), (top, bottom) = part.display_window
        require_picture_memory(path, right - left, bottom - top, 3, stored)


def _exr_raster(channels: Mapping[str, Any], location: _ImageLocation, part: _ExrPart) -> Raster:
    names, pixels = location.colour_channels, {name: channel.pixels for name, channel in channels.items()}
    values = np.stack([_in_display_window(pixels[name], part) for name in names], axis=-1)
    alpha = pixels.get(location.alpha)
    if alpha is None and not part.data_covers_display:
        alpha = np.ones_like(pixels[names[0]])
    return Raster(
        values,
        alpha=None if alpha is None else _in_display_window(alpha, part),
        encoded=False,
        premultiplied=True,
        notes=location.notes,
        page=location.page,
        primaries=part.primaries if len(names) == 3 else None,
        is_stated=True,  # without chromaticities an .exr holds the primaries of BT.709, as its format says
    )


def _in_display_window(pixels: NDArray[Any], part: _ExrPart) -> NDArray[np.float64]:
    """The display window (y, x) of a channel that is stored in the data window; 0 outside the latter."""
    overlaps = [_overlap_slices(part.data_window[axis], part.display_window[axis]) for axis in (1, 0)]
    data_slices, display_slices = zip(*overlaps, strict=True)
    image = np.zeros([last - first for first, last in reversed(part.display_window)])
    image[display_slices] = pixels[data_slices]
    return image


def _overlap_slices(data: _Span, display: _Span) -> tuple[slice, slice]:
    """The overlap of two spans, counted from the start of each."""
    first = max(data[0], display[0])
    last = max(min(data[1], display[1]), first)
    return slice(first - data[0], last - data[0]), slice(first - display[0], last - display[0])


def _headers(path: Path) -> list[_ExrPart]:
    if not OpenEXR.isOpenExrFile(str(path)):
        raise ValueError("not a readable OpenEXR file")
    with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
        return [_part(path, dict(file.header(index))) for index in range(len(file.parts))]


def _part(path: Path, header: Mapping[str, Any]) -> _ExrPart:
    channels = header["channels"]
    if any(c.xSampling != 1 or c.ySampling != 1 for c in channels):
        found = "has subsampled channels"
        raise UserError(str(path), found, expected="R, G, B at full size", remedy="export as RGB")
    display, data = _window(header["displayWindow"]), _window(header["dataWindow"])
    for (left, right), (top, bottom) in (display, data):
        if (right - left) * (bottom - top) > MAX_PIXELS:
            raise too_large_error(path, right - left, bottom - top)
    chromaticities = header.get("chromaticities")
    numbers = [] if chromaticities is None else [float(number) for number in chromaticities]
    primaries = tuple(zip(numbers[0::2], numbers[1::2], strict=True)) or None
    return _ExrPart(str(header.get("name", "")), tuple(c.name for c in channels), primaries, display, data)


def _window(corners: tuple[Sequence[int], Sequence[int]]) -> _Window:
    """The spans from the first to the last pixel, whose (x, y) are given."""
    (left, top), (right, bottom) = corners
    return (int(left), int(right) + 1), (int(top), int(bottom) + 1)


def _locate_images(path: Path, parts: Sequence[_ExrPart]) -> list[_ImageLocation]:
    """The pictures in their order. Raises UserError when there are none."""
    if len(parts) == 1:
        return _locate_layers(path, parts[0])
    coloured = [(index, _rgb_channels(part.channels)) for index, part in enumerate(parts)]
    grey = [(index, _grey_channel(part.channels)) for index, part in enumerate(parts)]
    pictures = [entry for entry in coloured if entry[1]] or [entry for entry in grey if entry[1]]
    if not pictures:
        raise _no_picture_error(path, parts[0].channels)
    if all(_has_number(parts[index].name) for index, _ in pictures):
        pictures.sort(key=lambda entry: natural_sort_key(parts[entry[0]].name))
    notes = _ignored_note([part.name for index, part in enumerate(parts) if index not in dict(pictures)])
    return [
        _ImageLocation(index, colours, f'part "{parts[index].name}"' if len(pictures) > 1 else "", notes)
        for index, colours in pictures
    ]


def _locate_layers(path: Path, part: _ExrPart) -> list[_ImageLocation]:
    """The only picture of a single part, or a picture for each of its numbered layers."""
    colours, layers = _rgb_channels(part.channels) or _grey_channel(part.channels), _rgb_layers(part.channels)
    if colours:
        return [_ImageLocation(0, colours, notes=_ignored_note(layers if colours == _RGB else ()))]
    if not layers or not all(_has_number(layer) for layer in layers):
        raise _no_picture_error(path, part.channels)
    ordered = sorted(layers, key=natural_sort_key)
    return [_ImageLocation(0, tuple(f"{layer}.{c}" for c in _RGB), f'layer "{layer}"') for layer in ordered]


def _ignored_note(names: Sequence[str]) -> tuple[str, ...]:
    return (f"left out: {', '.join(names)}",) if names else ()


def _rgb_layers(channels: Iterable[str]) -> list[str]:
    """Names of the layers that have R, G and B."""
    names = set(channels)
    prefixes = sorted({name[:-2] for name in names if name.endswith(".R")})
    return [prefix for prefix in prefixes if {f"{prefix}.G", f"{prefix}.B"} <= names]


def _rgb_channels(channels: Iterable[str]) -> tuple[str, ...]:
    """Names of R, G and B: bare, or those of the only layer that has them; empty otherwise."""
    names = tuple(channels)
    if set(_RGB) <= set(names):
        return _RGB
    layers = _rgb_layers(names)
    return tuple(f"{layers[0]}.{colour}" for colour in _RGB) if len(layers) == 1 else ()


def _grey_channel(channels: Iterable[str]) -> tuple[str, ...]:
    """The only channel beside A, as a tuple; empty when there are several."""
    colours = tuple(name for name in channels if name != "A")
    return colours if len(colours) == 1 else ()


def _has_number(name: str) -> bool:
    return any(character.isdecimal() for character in name)


def _no_picture_error(path: Path, channels: Iterable[str]) -> UserError:
    return UserError(
        str(path),
        f"has the channels {', '.join(channels) or '(none)'}",
        expected="R, G, B or a single channel, or a numbered layer for each plane (0.R, 0.G, 0.B, 1.R …)",
        remedy="export those",
    )
