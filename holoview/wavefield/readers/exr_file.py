"""OpenEXR files: the channels R, G, B of a layer as colours, other channels by their names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from holoview.util.errors import UserError
from holoview.util.memory_limit import require_memory
from holoview.wavefield.readers.contents import Contents, StoredArray
from holoview.wavefield.request import ReadRequest

_RGB = ("R", "G", "B")
_FLOAT_BYTES = 4


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
            channels = {
                name: np.array(channel.pixels)  # a copy: closing the file empties its channels
                for index in range(len(headers))
                for name, channel in dict(file.channels(index)).items()
            }
        if any(pixels.ndim != 2 for pixels in channels.values()):
            raise UserError(str(path), "has deep or subsampled channels", expected="flat channels at full size")
        yield Contents.of(
            [StoredArray.of(name, values, axes="yxc"[: values.ndim]) for name, values in _grouped(channels)]
        )


def _stored_bytes(header: dict[str, Any]) -> int:
    (left, top), (right, bottom) = header["dataWindow"]
    return (
        max(int(right) - int(left) + 1, 0) * max(int(bottom) - int(top) + 1, 0) * len(header["channels"]) * _FLOAT_BYTES
    )


def _grouped(channels: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    layers: dict[str, Sequence[str]] = {}
    for name in channels:
        layer, _, last = name.rpartition(".")
        layers.setdefault(layer, [])
        layers[layer] = [*layers[layer], last]
    for layer, names in layers.items():
        prefix = f"{layer}." if layer else ""
        is_coloured = set(_RGB) <= set(names)
        if is_coloured:
            yield layer, np.stack([channels[f"{prefix}{colour}"] for colour in _RGB], axis=-1)
        for name in names:
            if not (is_coloured and name in (*_RGB, "A")):
                yield f"{prefix}{name}", channels[f"{prefix}{name}"]
