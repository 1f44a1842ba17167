"""The hologram file: patterns, amplitudes, wavelengths and the bench itself, in one self-describing safetensors file.

drive        float32 (frame, modulator, y, x), 0…1 of the modulator's stroke
amplitudes   float64 (frame, wavelength)
wavelengths  float64 (wavelength,), m
metadata     format, version, system (TOML in people's units)
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.model import preset
from holoview.model.system import System
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat

FORMAT, VERSION = "holoview-hologram", "1"
_FILE = TensorFormat(
    name=FORMAT,
    version=VERSION,
    what="a hologram file that holoview wrote (safetensors)",
    tensors=("drive", "amplitudes", "wavelengths"),
    metadata_keys=("system",),
)


@dataclass(frozen=True)
class Hologram:
    """Patterns (frame, modulator, y, x) in 0…1 of the stroke, and the system that shows them (amplitudes included)."""

    drive: NDArray[np.float32]
    system: System

    def __post_init__(self) -> None:
        if self.drive.shape != self.system.drive_shape:
            raise UserError(
                "drive", f"shape {self.drive.shape}", expected=f"(frame, modulator, y, x) = {self.system.drive_shape}"
            )
        if not (np.isfinite(self.drive).all() and self.drive.min() >= 0 and self.drive.max() <= 1):
            raise UserError("drive", "values outside 0…1", expected="fractions of the modulator's stroke")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, whole or not at all."""
        tensors: dict[str, NDArray[np.floating]] = {
            "drive": self.drive.astype(np.float32),
            "amplitudes": self.system.amplitudes,
            "wavelengths": self.system.wavelengths_m,
        }
        _FILE.write(path, tensors, {"system": preset.dumps(self.system)})


def load_hologram(path: str | os.PathLike[str]) -> Hologram:
    """Reads a hologram file. Raises UserError when it is missing, damaged, of another format, or contradicts itself."""
    tensors, metadata = _FILE.read(path)
    system = preset.loads(metadata["system"], f"{path}: system")
    for name, known in (("wavelengths", system.wavelengths_m), ("amplitudes", system.amplitudes)):
        if not np.array_equal(tensors[name], known):
            raise UserError(f"{path}: {name}", "contradict the file's own system", remedy="write the hologram again")
    drive = tensors["drive"]
    if drive.dtype.kind != "f":
        raise UserError(f"{path}: drive", f"values of type {drive.dtype}", expected="float32")
    try:
        return Hologram(drive.astype(np.float32), system)
    except UserError as error:
        raise error.inside(f"{path}: ") from error
