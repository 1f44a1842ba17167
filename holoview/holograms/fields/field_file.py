"""The field file: a complex field with its sampling and wavelengths, in one safetensors file.

real, imaginary   float32 (frame, wavelength, y, x)
wavelengths       float64 (wavelength,), m, in the medium
pitch             float64 (2,), distance between samples along y and x, m
metadata          format, version, distance ("200 mm"); if known: reference_radius, name, and system, the bench in TOML
                  through which the field was seen
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.wavefield import Wavefield
from holoview.util import units
from holoview.util.safetensors_file import TensorFormat
from holoview.util.tables import ArraySchema

FIELD_FORMAT, VERSION = "holoview-field", "1"
_AXES = ("frame", "wavelength", "y", "x")
_FILE = TensorFormat(
    name=FIELD_FORMAT,
    version=VERSION,
    what="a field file that holoview wrote (safetensors)",
    tensors=(
        ArraySchema("real", ("float32",), _AXES),
        ArraySchema("imaginary", ("float32",), _AXES),
        ArraySchema("wavelengths", ("float64",), ("wavelength",), low=0.0),
        ArraySchema("pitch", ("float64",), (2,), low=0.0),
    ),
    metadata_keys=("distance",),
    copies=1.0,
)


def save_field(path: str | os.PathLike[str], field: Wavefield, texts: Mapping[str, str]) -> None:
    """Writes a field to a file, atomically. texts: further metadata. Raises UserError when it can't be written."""
    tensors: dict[str, NDArray[Any]] = {
        "real": field.values.real,
        "imaginary": field.values.imag,
        "wavelengths": field.wavelengths_m,
        "pitch": np.array(field.pitch_m),
    }
    known = {"distance": units.format_exact(field.distance_m, "mm")}
    if field.reference_radius_m is not None:
        known["reference_radius"] = units.format_exact(field.reference_radius_m, "mm")
    if field.name:
        known["name"] = field.name
    _FILE.write(path, tensors, {**texts, **known})


def read_field(path: str | os.PathLike[str]) -> tuple[Wavefield, dict[str, str]]:
    """A field and the metadata of its file.

    Raises UserError when the file is missing, damaged or of another format, and for an impossible field.
    """
    with _FILE.open(path) as file:
        tensors, texts = file.tensors(), file.texts
        values = np.empty(tensors["real"].shape, np.complex64)
        values.real, values.imag = tensors["real"], tensors["imaginary"]
        radius, pitch = texts.get("reference_radius"), tensors["pitch"]
        return (
            Wavefield(
                values,
                (float(pitch[0]), float(pitch[1])),
                tensors["wavelengths"],
                units.parse(texts["distance"], f"{path}: distance"),
                None if radius is None else units.parse(radius, f"{path}: reference_radius"),
                texts.get("name", ""),
            ),
            texts,
        )
