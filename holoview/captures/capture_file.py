"""The capture file, version 1: HDF5 with what was sent, what was seen, and the nominal geometry. Reading and writing.

Every dataset and attribute is listed in `docs/captures.md`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Camera, Captures, SlmSpec
from holoview.captures.validation import check_captures
from holoview.util.errors import UserError
from holoview.util.files import atomic_write

FORMAT_NAME, FORMAT_VERSION = "holoview-captures", 1
_PER_CAPTURE = ("wavelength", "distance", "power", "exposure")


def read_captures(path: str | os.PathLike[str]) -> Captures:
    """The session of a capture file.

    Raises UserError that names the file and the dataset when it is missing, cut short, not HDF5, of another format, or
    holds what can't be (`check_captures`).
    """
    file = Path(path)
    with _open_capture_file(file) as h5:
        try:
            captures = _read(h5)
            check_captures(captures)
        except UserError as error:
            raise error.inside(f"{file}: ") from error
        except (OSError, RuntimeError) as error:
            raise UserError(str(file), f"is damaged: {error}", remedy="copy or write the file again") from error
    return captures


def write_captures(path: str | os.PathLike[str], captures: Captures) -> None:
    """Writes a capture file, whole or not at all. Raises UserError for a session that can't be, as reading does."""
    check_captures(captures)
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as h5:
        h5.attrs["format"], h5.attrs["version"] = FORMAT_NAME, FORMAT_VERSION
        for number, panel in enumerate(captures.slms):
            group = h5.create_group(f"slm{number + 1}")
            group.create_dataset("levels", data=captures.levels[:, number], compression="gzip", compression_opts=4)
            group.attrs.update(pitch=panel.pitch_m, num_levels=panel.num_levels, opd_range=panel.opd_range_m)
        camera = h5.create_group("camera")
        camera.create_dataset("images", data=captures.images, compression="gzip", compression_opts=4)
        c = captures.camera
        camera.attrs.update(pitch=c.pitch_m, bit_depth=c.bit_depth, electrons_per_count=c.electrons_per_count)
        camera.attrs.update(read_noise=c.read_noise, black_level=c.black_level)
        columns = (captures.wavelength_m, captures.distance_m, captures.power, captures.exposure_s)
        for name, values in zip(_PER_CAPTURE, columns, strict=True):
            h5.create_dataset(name, data=values.astype(np.float64))
        geometry = h5.create_group("geometry")
        for name in ("gap", "iris1_na", "iris2_na", "focal_length"):
            value = getattr(captures, f"{name}_m" if name in ("gap", "focal_length") else name)
            if value is not None:
                geometry.attrs[name] = value


@contextmanager
def _open_capture_file(file: Path) -> Iterator[h5py.File]:
    if not file.is_file():
        raise UserError(str(file), "no such file", expected="a capture file (HDF5)")
    try:
        h5 = h5py.File(file, "r")
    except OSError as error:
        cut = "truncated" in str(error)
        found = "is cut short: it ends before its data do" if cut else "isn't an HDF5 file"
        remedy = "copy it again" if cut else "`holoview captures import` converts a folder of pictures"
        raise UserError(str(file), found, expected="a capture file (HDF5)", remedy=remedy) from error
    with h5:
        yield h5


def _read(h5: h5py.File) -> Captures:
    stated, version = _decode_attribute(h5.attrs.get("format")), h5.attrs.get("version")
    if stated != FORMAT_NAME:
        raise UserError("attribute format", f'"{stated}"' if stated else "is missing", expected=f'"{FORMAT_NAME}"')
    if version is None or np.ndim(version) or int(version) != FORMAT_VERSION:
        raise UserError("attribute version", f"{version}", expected=f"{FORMAT_VERSION}, the only one that is known")
    slms = ["slm1", "slm2"] if "slm2" in h5 else ["slm1"]
    levels = [_dataset(h5, f"{slm}/levels", "u", 3) for slm in slms]
    if len({array.shape for array in levels}) > 1:
        shapes = " and ".join(str(array.shape) for array in levels)
        raise UserError("slm2/levels", f"shapes {shapes}", expected="the shape of slm1/levels")
    geometry = dict(h5["geometry"].attrs) if "geometry" in h5 else {}
    wide = np.result_type(*levels)
    return Captures(
        levels=np.stack([array.astype(wide) for array in levels], axis=1),
        images=_images(h5),
        **{f"{name}_m": _dataset(h5, name, "fiu", 1).astype(np.float64) for name in ("wavelength", "distance")},
        power=_dataset(h5, "power", "fiu", 1).astype(np.float64),
        exposure_s=_dataset(h5, "exposure", "fiu", 1).astype(np.float64),
        slms=tuple(
            SlmSpec(_number(h5[slm], "pitch"), int(_number(h5[slm], "num_levels")), _number(h5[slm], "opd_range"))
            for slm in slms
        ),
        camera=_camera(h5),
        gap_m=_optional(geometry, "gap"),
        iris1_na=_optional(geometry, "iris1_na"),
        iris2_na=_optional(geometry, "iris2_na"),
        focal_length_m=_optional(geometry, "focal_length"),
    )


def _images(h5: h5py.File) -> NDArray[np.uint16]:
    images = _dataset(h5, "camera/images", "u", 3)
    if images.dtype.itemsize > 2:
        raise UserError("camera/images", f"numbers of type {images.dtype}", expected="uint16 raw counts")
    return images.astype(np.uint16)


def _camera(h5: h5py.File) -> Camera:
    group = h5["camera"]
    return Camera(
        pitch_m=_number(group, "pitch"),
        bit_depth=int(_number(group, "bit_depth")),
        electrons_per_count=_number(group, "electrons_per_count"),
        read_noise=_number(group, "read_noise"),
        black_level=_number(group, "black_level"),
    )


def _dataset(h5: h5py.File, name: str, kinds: str, axes: int) -> NDArray[Any]:
    """A dataset whose type is one of numpy's `kinds` and which has so many axes."""
    found = h5.get(name)
    if not isinstance(found, h5py.Dataset):
        raise UserError(name, "is missing", expected="a dataset of this name")
    if found.dtype.kind not in kinds:
        expected = "uint8 or uint16" if kinds == "u" else "real numbers"
        raise UserError(name, f"numbers of type {found.dtype}", expected=expected)
    if found.ndim != axes or 0 in found.shape:
        expected = "(captures, rows, columns)" if axes == 3 else "one number a capture"
        raise UserError(name, f"an array of shape {found.shape}", expected=expected)
    return np.asarray(found[()])


def _number(group: h5py.Group, name: str) -> float:
    where = f"{group.name.lstrip('/')} attribute {name}"
    if name not in group.attrs:
        raise UserError(where, "is missing", expected="a number")
    return _scalar(group.attrs[name], where)


def _optional(attributes: dict[str, Any], name: str) -> float | None:
    return None if name not in attributes else _scalar(attributes[name], f"geometry attribute {name}")


def _scalar(value: Any, where: str) -> float:
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind not in "fiu":
        raise UserError(where, f"{value!r}", expected="a number")
    return float(array.reshape(()))


def _decode_attribute(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value or "")
