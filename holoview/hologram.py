"""The hologram file: patterns, amplitudes, wavelengths and the bench itself, in one self-describing safetensors file.

drive        float32 (frame, modulator, y, x), 0…1 of the modulator's stroke
amplitudes   float64 (frame, wavelength)
wavelengths  float64 (wavelength,), m
metadata     format, version, system (TOML in people's units)
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from holoview import preset
from holoview.errors import UserError
from holoview.files import replacing
from holoview.system import System

FORMAT, VERSION = "holoview-hologram", "1"
_TENSORS = ("drive", "amplitudes", "wavelengths")
_WHAT = "a hologram file that holoview wrote (safetensors)"


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
        tensors = {
            "drive": np.ascontiguousarray(self.drive, dtype=np.float32),
            "amplitudes": np.array(self.system.amplitudes),
            "wavelengths": np.array(self.system.wavelengths_m),
        }
        metadata = {"format": FORMAT, "version": VERSION, "system": preset.dumps(self.system)}
        with replacing(path) as temporary:
            save_file(tensors, temporary, metadata=metadata)


def load_hologram(path: str | os.PathLike[str]) -> Hologram:
    """Reads a hologram file. Raises UserError when it is missing, damaged, of another format, or contradicts itself."""
    if not Path(path).is_file():
        raise UserError(str(path), "no such file", expected=_WHAT)
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            _check_contents(path, metadata, set(file.keys()))
            tensors = {name: file.get_tensor(name) for name in _TENSORS}
    except (SafetensorError, OSError, ValueError, TypeError, AttributeError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(str(path), f"can't be read: {error}", expected=_WHAT) from error
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


def _check_contents(path: str | os.PathLike[str], metadata: dict[str, str], names: set[str]) -> None:
    """UserError unless the header is that of a hologram, before any tensor is read."""
    if metadata.get("format") != FORMAT or metadata.get("version") != VERSION:
        found = f'format "{metadata.get("format", "none")}", version {metadata.get("version", "none")}'
        raise UserError(str(path), found, expected=f'format "{FORMAT}", version {VERSION}')
    missing = set(_TENSORS) - names
    if missing or "system" not in metadata:
        raise UserError(str(path), f"lacks {', '.join(sorted(missing)) or 'its system'}", expected=_WHAT)
