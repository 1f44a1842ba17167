"""Reads and writes the capture file, version 1: HDF5 with patterns, camera images, settings and nominal geometry.

`docs/captures.md` lists every dataset and attribute.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from holoview.captures.capture_schema import (
    CAMERA_NUMBERS,
    GEOMETRY_NUMBERS,
    IMAGES,
    LEVELS,
    PER_CAPTURE,
    SLM_NUMBERS,
    VERSION,
)
from holoview.captures.dataset import Camera, Captures, SlmSpec
from holoview.captures.nominal_stops import STOP_KEYS, stop_attributes, stops_from_attributes
from holoview.captures.plain_hdf5 import DatasetReader, open_plain_hdf5, plain_child, read_attribute
from holoview.captures.validation import check_captures
from holoview.util.errors import UserError
from holoview.util.file_schema import NumberSchema
from holoview.util.file_writer import write_file
from holoview.util.memory_limit import require_memory

FORMAT_NAME, FORMAT_VERSION = "holoview-captures", 1
_PEAK_SHARE = 1.6  # of the data: while they are checked, a mask of the pictures is held beside them
_PER_CAPTURE = ("wavelength", "distance", "power", "exposure")
_GEOMETRY = "geometry attribute "  # before its name, in errors


def read_captures(path: str | os.PathLike[str], check: Callable[[Captures], object] = check_captures) -> Captures:
    """Reads the measurement session of a capture file.

    check: raises UserError for sessions that aren't wanted; `records.plausible_units` lets those through whose units it
    can correct.
    Raises UserError that names the file and the dataset when the file is missing, cut short, not HDF5 or of another
    format, when a dataset is missing or isn't as `capture_schema` says, when data are elsewhere or need too much
    memory, and when `check` refuses the session.
    """
    remedy = "`holoview captures import` converts a folder of pictures"
    with open_plain_hdf5(Path(path), "a capture file (HDF5)", remedy) as h5:
        captures = _read(h5)
        check(captures)
    return captures


def write_captures(
    path: str | os.PathLike[str],
    captures: Captures,
    check: Callable[[Captures], object] = check_captures,
    extend: Callable[[h5py.File], object] = lambda _: None,
) -> None:
    """Writes a capture file completely or not at all; what was corrected is noted in it.

    check: raises UserError for sessions that mustn't be written. extend: adds what readers of captures ignore.
    Raises what `check` does, and WriteError.
    """
    check(captures)
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as h5:
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
        extend(h5)
    write_file(path, buffer.getbuffer())


def slm_from_attributes(attributes: Mapping[str, float]) -> SlmSpec:
    """A modulator from the numbers of `capture_schema.SLM_NUMBERS`, in SI units."""
    return SlmSpec(attributes["pitch"], int(attributes["num_levels"]), attributes["opd_range"])


def camera_from_attributes(attributes: Mapping[str, float]) -> Camera:
    """A camera from the numbers of `capture_schema.CAMERA_NUMBERS`, in SI units, electrons and counts."""
    return Camera(
        pitch_m=attributes["pitch"],
        bit_depth=int(attributes["bit_depth"]),
        electrons_per_count=attributes["electrons_per_count"],
        read_noise=attributes["read_noise"],
        black_level=attributes["black_level"],
    )


def _read(h5: h5py.File) -> Captures:
    _check_format(h5)
    sizes: dict[str, int] = {}
    slms = ["slm1", "slm2"] if plain_child(h5, "slm2") is not None else ["slm1"]
    levels = [DatasetReader(h5, schema, sizes) for schema in LEVELS[: len(slms)]]
    images = DatasetReader(h5, IMAGES, sizes)
    columns = {schema.name: DatasetReader(h5, schema, sizes) for schema in PER_CAPTURE}
    datasets = [*levels, images, *columns.values()]
    needed = _PEAK_SHARE * sum(d.size_bytes for d in datasets) + 2 * max(d.chunk_bytes for d in datasets)
    require_memory("captures", needed, remedy="give it fewer captures")
    geometry = _geometry(h5)
    return Captures(
        levels=_read_levels(levels),
        images=_read_images(images),
        wavelength_m=columns["wavelength"].read().astype(np.float64),
        distance_m=columns["distance"].read().astype(np.float64),
        power=columns["power"].read().astype(np.float64),
        exposure_s=columns["exposure"].read().astype(np.float64),
        slms=tuple(slm_from_attributes(_numbers(h5, slm, SLM_NUMBERS)) for slm in slms),
        camera=camera_from_attributes(_numbers(h5, "camera", CAMERA_NUMBERS)),
        gap_m=geometry.get("gap"),
        relay1=stops_from_attributes(geometry, 1, _GEOMETRY),
        relay2=stops_from_attributes(geometry, 2, _GEOMETRY),
        focal_length_m=geometry.get("focal_length"),
        corrections=_corrections(h5),
    )


def _check_format(h5: h5py.File) -> None:
    name, version = _decode_attribute(read_attribute(h5, "format")), read_attribute(h5, "version")
    if name != FORMAT_NAME:
        raise UserError("attribute format", f'"{name}"' if name else "is missing", expected=f'"{FORMAT_NAME}"')
    if version is None or VERSION.read(version, "attribute version") != FORMAT_VERSION:
        raise UserError("attribute version", f"{version}", expected=f"{FORMAT_VERSION}, the only one that is known")


def _read_levels(readers: Sequence[DatasetReader]) -> NDArray[np.unsignedinteger]:
    """The levels (capture, modulator, y, x) of all modulators."""
    captures, *shape = readers[0].shape
    common_type = np.result_type(*(reader.dtype.newbyteorder("=") for reader in readers))
    levels = np.empty((captures, len(readers), *shape), dtype=common_type)
    for number, reader in enumerate(readers):
        reader.read_into(levels[:, number])
    return levels


def _read_images(reader: DatasetReader) -> NDArray[np.uint16]:
    images = np.empty(reader.shape, dtype=np.uint16)
    reader.read_into(images)
    return images


def _geometry(h5: h5py.File) -> dict[str, Any]:
    """The attributes of the geometry that the file has."""
    group, lengths = plain_child(h5, "geometry"), _numbers(h5, "geometry", GEOMETRY_NUMBERS)
    stops = {} if group is None else {name: read_attribute(group, name) for name in STOP_KEYS}
    return {name: value for name, value in stops.items() if value is not None} | lengths


def _numbers(h5: h5py.File, group_name: str, schemas: Sequence[NumberSchema]) -> dict[str, float]:
    """The attributes of a group that it has; UserError where one is missing that isn't optional."""
    group = plain_child(h5, group_name)
    values = {}
    for schema in schemas:
        where = f"{group_name} attribute {schema.name}"
        value = None if group is None else read_attribute(group, schema.name)
        if value is not None:
            values[schema.name] = schema.read(value, where)
        elif not schema.optional:
            raise UserError(where, "is missing", expected="a number")
    return values


def _corrections(h5: h5py.File) -> tuple[str, ...]:
    texts = read_attribute(h5, "corrections")
    return () if texts is None else tuple(_decode_attribute(text) for text in np.atleast_1d(texts))


def _decode_attribute(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value or "")
