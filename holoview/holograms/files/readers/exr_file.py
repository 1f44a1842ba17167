"""OpenEXR files: the channels R, G, B of a layer as colours, spectral channels as wavelengths, others by their names.

Spectral channels are named by their wavelengths, S0.550,5nm of emitted light and T.550,5nm of reflected light (Fichet,
Pacanowski, Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3), 2021). Channels of a file with several parts
have the name of their part before their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from holoview.holograms.files.readers.contents import Contents, Facts, StoredArray
from holoview.holograms.files.request import ReadRequest
from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory

_RGB = ("R", "G", "B")
_FLOAT_BYTES = 4
_SPECTRAL = re.compile(
    r"(?P<kind>(?:.*\.)?(?:S[0-3]|T))\.(?P<number>\d{1,6}(?:[.,]\d{0,6})?)(?P<unit>[kMGT]?Hz|[pnµucm]?m)"
)
_STOKES_0 = ("S0", "T")  # without polarisation
_LIGHT_M_S = 299792458.0
_UNITS = {"": 1.0, "p": 1e-12, "n": 1e-9, "µ": 1e-6, "u": 1e-6, "m": 1e-3, "c": 1e-2}
_HERTZ = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12}


class ExrReader:
    """Channels as arrays (y, x); R, G and B of one layer become one array (y, x, 3), named after the layer."""

    name = "OpenEXR"
    suffixes = (".exr",)

    def recognises(self, head: bytes) -> bool:
        """Whether the magic number is there."""
        return head.startswith(b"v/1\x01")

    @contextmanager
    def open(self, path: Path, request: ReadRequest) -> Iterator[Contents]:
        """All channels; the library reads them at once."""
        if not OpenEXR.isOpenExrFile(str(path)):
            raise ValueError("not a readable OpenEXR file")
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            headers = [dict(file.header(index)) for index in range(len(file.parts))]
        require_memory(str(path), 2 * sum(map(_stored_bytes, headers)))
        with OpenEXR.File(str(path), separate_channels=True) as file:
            if len(file.parts) != len(headers):  # the library leaves out parts that end too early
                raise ValueError(f"{len(file.parts)} of {len(headers)} parts are whole")
            parts = {
                str(headers[index].get("name", "")) or str(index): {
                    name: np.array(channel.pixels)  # a copy: closing the file empties its channels
                    for name, channel in dict(file.channels(index)).items()
                }
                for index in range(len(headers))
            }
        if len(parts) != len(headers):
            raise UserError(str(path), "has several parts of one name", expected="parts with names of their own")
        channels = parts.popitem()[1] if len(parts) == 1 else _by_part(parts)
        if any(pixels.ndim != 2 for pixels in channels.values()):
            raise UserError(str(path), "has deep or subsampled channels", expected="flat channels at full size")
        spectra, facts, notes = _spectra(channels)
        plain = {name: values for name, values in channels.items() if not _SPECTRAL.fullmatch(name)}
        arrays = [
            StoredArray.of(name, values, axes="yxc"[: values.ndim])
            for name, values in [*spectra.items(), *_grouped(plain)]
        ]
        yield Contents.of(arrays, facts, notes)


def _by_part(parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """All channels with the names of their parts; a part's only channel has the name of its part."""
    return {
        part if len(channels) == 1 else f"{part}.{name}": pixels
        for part, channels in parts.items()
        for name, pixels in channels.items()
    }


def _spectra(channels: Mapping[str, Any]) -> tuple[dict[str, Any], Facts, tuple[str, ...]]:
    """Spectral channels as arrays (y, x, wavelength) by kind, the wavelengths of the first, and remarks.

    The wavelengths fall, as those of red, green and blue do.
    """
    by_kind: dict[str, list[tuple[float, str]]] = {}
    for name in channels:
        if found := _SPECTRAL.fullmatch(name):
            by_kind.setdefault(found["kind"], []).append((_wavelength_m(found["number"], found["unit"]), name))
    plain = {kind: named for kind, named in by_kind.items() if kind.rpartition(".")[2] in _STOKES_0}
    notes = tuple(f"{kind} describes polarisation: left out" for kind in by_kind if kind not in plain)
    spectra, facts = {}, Facts()
    for kind, named in plain.items():
        named.sort(reverse=True)
        spectra[kind] = np.stack([channels[name] for _, name in named], axis=-1)
        facts = facts if facts.wavelengths_m else Facts(wavelengths_m=tuple(length for length, _ in named))
    return spectra, facts, notes


def _wavelength_m(number: str, unit: str) -> float:
    value = float(number.replace(",", "."))
    if unit.endswith("Hz"):
        return _LIGHT_M_S / (value * _HERTZ[unit[:-2]])
    return value * _UNITS[unit[:-1]]


def _stored_bytes(header: dict[str, Any]) -> int:
    (left, top), (right, bottom) = header["dataWindow"]
    return (
        max(int(right) - int(left) + 1, 0) * max(int(bottom) - int(top) + 1, 0) * len(header["channels"]) * _FLOAT_BYTES
    )


def _grouped(channels: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Arrays by name: the red, green and blue channels of a layer together, named after the layer."""
    layers: dict[str, list[str]] = {}
    for name in channels:
        layers.setdefault(name[: name.rfind(".") + 1], []).append(name)  # with the dot, which may be all there is
    for layer, names in layers.items():
        colours = [f"{layer}{colour}" for colour in _RGB]
        is_coloured = set(colours) <= set(names)
        if is_coloured:
            yield layer.removesuffix("."), np.stack([channels[name] for name in colours], axis=-1)
        for name in names:
            if not (is_coloured and name in (*colours, f"{layer}A")):
                yield name, channels[name]
