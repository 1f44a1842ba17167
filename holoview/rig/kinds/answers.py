"""What devices return, checked against rig.toml before anything is measured with it."""

from __future__ import annotations

from typing import Any

import numpy as np

from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts, DeviceError, Levels


def require_shape(name: str, found: Any, expected: tuple[int, int]) -> None:
    """Raises DeviceError unless a device has so many rows and columns. name: its table in rig.toml."""
    if tuple(found) != expected:
        rows, columns = found
        remedy = f"correct {name}.shape in rig.toml, or the device's own settings"
        raise DeviceError(
            name, f"has {rows} × {columns} pixels", expected=f"{expected[0]} × {expected[1]}", remedy=remedy
        )


def require_bits(name: str, found: int, expected: int) -> None:
    """Raises DeviceError unless a device has so many bits."""
    if found != expected:
        remedy = f"correct [{name}] in rig.toml, or the device's own settings"
        raise DeviceError(name, f"has {found} bits", expected=f"{expected}", remedy=remedy)


def require_counts(picture: Any, rig: RigDescription) -> Counts:
    """A camera's picture as raw counts (y, x). Raises DeviceError for another type, shape or range."""
    picture, highest = np.asarray(picture), rig.bench.camera.saturation
    if picture.dtype.kind not in "iu":
        remedy = "let the camera return raw counts, without averaging and without high dynamic range"
        raise DeviceError("camera", f"sent values of {picture.dtype.name}", expected="whole numbers", remedy=remedy)
    if picture.shape != rig.camera_shape:
        remedy = "correct camera.shape in rig.toml, or the camera's window, binning and rotation"
        raise DeviceError(
            "camera",
            f"sent a picture of {' × '.join(map(str, picture.shape))}",
            expected=" × ".join(map(str, rig.camera_shape)),
            remedy=remedy,
        )
    if picture.min() < 0 or picture.max() > highest:
        remedy = "correct camera.bit_depth in rig.toml, or the camera's pixel format"
        found = f"sent counts from {picture.min()} to {picture.max()}"
        raise DeviceError("camera", found, expected=f"0 … {highest}", remedy=remedy)
    return picture.astype(np.uint16)


def require_levels(name: str, levels: Levels, rig: RigDescription) -> None:
    """Raises DeviceError for levels (y, x) that a modulator doesn't have."""
    count = rig.bench.slms[int(name[3]) - 1].num_levels
    require_shape(name, levels.shape, rig.slm_shape)
    if int(levels.max()) >= count:
        raise DeviceError(name, f"was to show level {int(levels.max())}", expected=f"0 … {count - 1}")
