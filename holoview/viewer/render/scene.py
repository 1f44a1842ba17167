"""Scenes, from which images are rendered, and images on the device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.gpu.device import Buffer, Device
from holoview.light.model.system import System

Drive = Any
"""Patterns (frame, modulator, y, x) in 0…1, float32; of a field its values (frame, wavelength, y, x), complex64; of a
chain `ElementPatterns`. Read-only, and compared by identity."""


class ElementPatterns(Mapping[str, NDArray[Any]]):
    """Patterns (frame, y, x) of a chain by the names of its elements; equal to itself alone, as edits share them."""

    def __init__(self, patterns: Mapping[str, NDArray[Any]]) -> None:
        self._patterns = dict(patterns)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._patterns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._patterns)

    def __len__(self) -> int:
        return len(self._patterns)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __hash__(self) -> int:
        return id(self)


@dataclass(frozen=True, eq=False)
class Scene:
    """A system, its drive, and the focal plane in metres."""

    system: System
    drive: Drive
    plane_m: float

    def is_same(self, other: Scene | None) -> bool:
        """Whether the image is the same; drives are compared by identity, since edits share unchanged arrays."""
        return (
            other is not None
            and self.drive is other.drive
            and self.plane_m == other.plane_m
            and self.system == other.system
        )


@dataclass(frozen=True, eq=False)
class DeviceImage:
    """An XYZ image (y, x, 4) in float32 on the device; the fourth component is unused. shape: (y, x).

    is_quick: whether it shows the simplified system. version: rises when the content changes. gain: factors on its
    X, Y and Z for display.
    """

    buffer: Buffer
    shape: tuple[int, int]
    is_quick: bool = False
    version: int = 0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)


def uploaded_image(device: Device, xyz: NDArray[np.float32], label: str) -> DeviceImage:
    """An image XYZ (y, x, 3) of the host on the device."""
    four = np.zeros((*xyz.shape[:2], 4), np.float32)
    four[..., :3] = xyz
    return DeviceImage(device.upload(four, label), (xyz.shape[0], xyz.shape[1]))


def image_shape(system: System) -> tuple[int, int]:
    """Rows and columns of the simulated image."""
    return system.way.shape
