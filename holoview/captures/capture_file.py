"""Reads and writes the capture file, version 1: HDF5 with patterns, camera images, settings and nominal geometry.

`docs/captures.md` lists every dataset and attribute.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Camera, Captures, SlmSpec
from holoview.captures.nominal_stops import stop_attributes, stops_from_attributes
from holoview.captures.validation import check_captures
from holoview.util.errors import UserError
from holoview.util.files import atomic_write

FORMAT_NAME, FORMAT_VERSION = "holoview-captures", 1
SLM_ATTRIBUTES = ("pitch", "num_levels", "opd_range")
CAMERA_ATTRIBUTES = ("pitch", "bit_depth", "electrons_per_count", "read_noise", "black_level")
_PER_CAPTURE = ("wavelength", "distance", "power", "exposure")
_GEOMETRY = "geometry attribute "  # before its name, in errors


def read_captures(path: str | os.PathLike[str], check: Callable[[Captures], object] = check_captures) -> Captures:
    """Reads the measurement session of a capture file.

    check: raises UserError for sessions that aren't wanted; `records.plausible_units` lets those through whose units it
    can correct.
    Raises UserError that names the file and the dataset when the file is missing, cut short, not HDF5 or of another
    format, when a dataset is missing or of a wrong type, and when `check` refuses the session.
    """
    file = Path(path)
    with _open_capture_file(file) as h5:
        try:
            captures = _read(h5)
            check(captures)
        except UserError as error:
            raise error.inside(f"{file}: ") from error
        except (OSError, RuntimeError) as error:
            raise UserError(str(file), f"is damaged: {error}", remedy="copy or write the file again") from error
    return captures


def write_captures(path: str | os.PathLike[str], captures: Captures) -> None:
    """Writes a capture file completely or not at all; what was corrected is noted in it.

    Raises UserError for an impossible session (`check_captures`).
    """
    check_captures(captures)
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as h5:
        h5.attrs["format"], h5.attrs["version"] = FORMAT_NAME, FORMAT_VERSION
        if captures.corrections:
            h5.attrs["corrections"] = list(captures.corrections)
        for number, slm in enumerate(captures.slms):
            group = h5.create_group(f"slm{number + 1}")
            group.create_dataset("levels", data=captures.levels[:, number], compression="gzip", compression_opts=4)
            group.attrs.update(pitch=slm.pitch_m, num_levels=slm.num_levels, opd_range=slm.opd_range_m)
        camera = h5.create_group("camera")
        camera.create_dataset("images", data=captures.images, compression="gzip", compression_opts=4)
        c = captures.camera
        camera.attrs.update(pitch=c.pitch_m, bit_depth=c.bit_depth, electrons_per_count=c.electrons_per_count)
        camera.attrs.update(read_noise=c.read_noise, black_level=c.black_level)
        columns = (captures.wavelength_m, captures.distance_m, captures.power, captures.exposure_s)
        for name, values in zip(_PER_CAPTURE, columns, strict=True):
            h5.create_dataset(name, data=values.astype(np.float64))
        geometry = h5.create_group("geometry")
        for name, value in (("gap", captures.gap_m), ("focal_length", captures.focal_length_m)):
            if value is not None:
                geometry.attrs[name] = value
        geometry.attrs.update(stop_attributes(captures.relay1, 1) | stop_attributes(captures.relay2, 2))


def slm_from_attributes(attributes: Mapping[str, float]) -> SlmSpec:
    """A modulator from the numbers of SLM_ATTRIBUTES, in SI units."""
    return SlmSpec(attributes["pitch"], int(attributes["num_levels"]), attributes["opd_range"])


def camera_from_attributes(attributes: Mapping[str, float]) -> Camera:
    """A camera from the numbers of CAMERA_ATTRIBUTES, in SI units, electrons and counts."""
    return Camera(
        pitch_m=attributes["pitch"],
        bit_depth=int(attributes["bit_depth"]),
        electrons_per_count=attributes["electrons_per_count"],
        read_noise=attributes["read_noise"],
        black_level=attributes["black_level"],
    )


@contextmanager
def _open_capture_file(file: Path) -> Iterator[h5py.File]:
    if not file.is_file():
        raise UserError(str(file), "no such file", expected="a capture file (HDF5)")
    try:
        h5 = h5py.File(file, "r")
    except OSError as error:
        truncated = "truncated" in str(error)
        found = "is cut short: it ends before its data do" if truncated else "isn't an HDF5 file"
        remedy = "copy it again" if truncated else "`holoview captures import` converts a folder of pictures"
        raise UserError(str(file), found, expected="a capture file (HDF5)", remedy=remedy) from error
    with h5:
        yield h5


def _read(h5: h5py.File) -> Captures:
    _check_format(h5)
    slms = ["slm1", "slm2"] if "slm2" in h5 else ["slm1"]
    levels = [_dataset(h5, f"{slm}/levels", "u", 3) for slm in slms]
    if len({array.shape for array in levels}) > 1:
        shapes = " and ".join(str(array.shape) for array in levels)
        raise UserError("slm2/levels", f"shapes {shapes}", expected="the shape of slm1/levels")
    geometry = dict(h5["geometry"].attrs) if "geometry" in h5 else {}
    common_type = np.result_type(*levels)
    return Captures(
        levels=np.stack([array.astype(common_type) for array in levels], axis=1),
        images=_images(h5),
        wavelength_m=_dataset(h5, "wavelength", "fiu", 1).astype(np.float64),
        distance_m=_dataset(h5, "distance", "fiu", 1).astype(np.float64),
        power=_dataset(h5, "power", "fiu", 1).astype(np.float64),
        exposure_s=_dataset(h5, "exposure", "fiu", 1).astype(np.float64),
        slms=tuple(slm_from_attributes(_numbers(h5[slm], SLM_ATTRIBUTES)) for slm in slms),
        camera=camera_from_attributes(_numbers(h5["camera"], CAMERA_ATTRIBUTES)),
        gap_m=_optional(geometry, "gap"),
        relay1=stops_from_attributes(geometry, 1, _GEOMETRY),
        relay2=stops_from_attributes(geometry, 2, _GEOMETRY),
        focal_length_m=_optional(geometry, "focal_length"),
        corrections=tuple(_decode_attribute(text) for text in np.atleast_1d(h5.attrs.get("corrections", []))),
    )


def _check_format(h5: h5py.File) -> None:
    name, version = _decode_attribute(h5.attrs.get("format")), h5.attrs.get("version")
    if name != FORMAT_NAME:
        raise UserError("attribute format", f'"{name}"' if name else "is missing", expected=f'"{FORMAT_NAME}"')
    if version is None or np.ndim(version) or int(version) != FORMAT_VERSION:
        raise UserError("attribute version", f"{version}", expected=f"{FORMAT_VERSION}, the only one that is known")


def _images(h5: h5py.File) -> NDArray[np.uint16]:
    images = _dataset(h5, "camera/images", "u", 3)
    if images.dtype.itemsize > 2:
        raise UserError("camera/images", f"numbers of type {images.dtype}", expected="uint16 raw counts")
    return images.astype(np.uint16)


def _dataset(h5: h5py.File, name: str, kinds: str, axes: int) -> NDArray[Any]:
    """Reads a dataset; UserError unless its type is of numpy's `kinds` and it has this number of axes, none empty."""
    dataset = h5.get(name)
    if not isinstance(dataset, h5py.Dataset):
        raise UserError(name, "is missing", expected="a dataset of this name")
    if dataset.dtype.kind not in kinds:
        expected = "uint8 or uint16" if kinds == "u" else "real numbers"
        raise UserError(name, f"numbers of type {dataset.dtype}", expected=expected)
    if dataset.ndim != axes or 0 in dataset.shape:
        expected = "(captures, rows, columns)" if axes == 3 else "one number a capture"
        raise UserError(name, f"an array of shape {dataset.shape}", expected=expected)
    return np.asarray(dataset[()])


def _numbers(group: h5py.Group, names: tuple[str, ...]) -> dict[str, float]:
    values = {}
    for name in names:
        where = f"{group.name.lstrip('/')} attribute {name}"
        if name not in group.attrs:
            raise UserError(where, "is missing", expected="a number")
        values[name] = _scalar(group.attrs[name], where)
    return values


def _optional(attributes: dict[str, Any], name: str) -> float | None:
    return None if name not in attributes else _scalar(attributes[name], f"{_GEOMETRY}{name}")


def _scalar(value: Any, where: str) -> float:
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind not in "fiu":
        raise UserError(where, f"{value!r}", expected="a number")
    return float(array.reshape(()))


def _decode_attribute(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value or "")
