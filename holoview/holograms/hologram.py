"""The hologram file: patterns and the system that shows them, in one safetensors file.

A hologram that is a complex field is stored as a field file (`holoview.holograms.fields.field_file`), with its system.

drive        float32 (frame, modulator, y, x), 0…1 of the modulator's stroke; or uint8, 0…255 for the same range
drive/NAME   in its place, of a chain: float32 (frame, y, x) of each element that shows patterns, by its name; of a
             complex modulator (frame, y, x, 2), real and imaginary part
amplitudes   float64 (frame, wavelength)
wavelengths  float64 (wavelength,), m
metadata     format, version, system (TOML with units)
"""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.fields.field_bench import bench_of_field, lit_field
from holoview.holograms.fields.field_file import FIELD_FORMAT, read_field, save_field
from holoview.holograms.fields.wavefield import Wavefield
from holoview.light.model import preset
from holoview.light.model.drives import chain_drives, complex_names, short_drive
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.safetensors_file import TensorFormat, format_of, metadata_of
from holoview.util.tables import ArraySchema

if TYPE_CHECKING:
    from holoview.holograms.fields.field_target import FieldTarget

FORMAT, VERSION = "holoview-hologram", "1"
_MAX_CODE = np.float32(255.0)  # of a drive in 8 bits


def drive_schema(name: str, *types: str) -> ArraySchema:
    """The schema of patterns in a file: fractions of the stroke (frame, modulator, y, x)."""
    return ArraySchema(name, types, ("frame", "modulator", "y", "x"), low=0.0, high=1.0)


def drive_sizes(system: System) -> dict[str, int]:
    """The sizes that arrays of a system's patterns and lasers have in a file, by the names of their axes."""
    sizes, axes = {"wavelength": len(system.wavelengths_m), "frame": system.frames}, ("frame", "y", "x", "part")
    if not system.is_chain:
        return sizes | dict(zip(("frame", "modulator", "y", "x"), system.drive_shape, strict=True))
    for name, shape in system.drive_shapes.items():
        sizes |= {f"{name}: {axis}": n for axis, n in zip(axes, (*shape, 2), strict=True)}
    return sizes


_FILE = TensorFormat(
    name=FORMAT,
    version=VERSION,
    what="a hologram file that holoview wrote (safetensors)",
    tensors=(
        drive_schema("drive", "uint8", "float16", "float32", "float64"),
        ArraySchema("amplitudes", ("float64",), ("frame", "wavelength"), low=0.0),
        ArraySchema("wavelengths", ("float64",), ("wavelength",), low=0.0),
    ),
    metadata_keys=("system",),
)


def chain_schema(system: System, element: str, name: str, *types: str) -> ArraySchema:
    """The schema of an array in a file that is as the patterns (frame, y, x) of an element, whose sizes are its own; of
    a complex modulator (frame, y, x, part) float32."""
    axes = (f"{element}: frame", f"{element}: y", f"{element}: x")
    if element in complex_names(system):
        return ArraySchema(name, ("float32",), (*axes, f"{element}: part"))
    return ArraySchema(name, types, axes)


def _chain_format(system: System) -> TensorFormat:
    """The format of a chain's file, which has the patterns of each element."""
    drives = (chain_schema(system, name, f"drive/{name}", "uint8", "float32") for name in system.drive_shapes)
    return replace(_FILE, tensors=(*drives, *_FILE.tensors[1:]))


@dataclass(frozen=True)
class Hologram:
    """Patterns and the system that shows them, or a complex field and the bench that shows it.

    drive: (frame, modulator, y, x) float32, 0…1 of the stroke, of shape `system.drive_shape`; of a field
    (frame, wavelength, y, x) complex64; of a chain a mapping of (frame, y, x) by the names of its elements, also given
    as a list.
    system: the display, with the amplitudes of its lasers.

    Raises UserError when the drive has another shape, or values outside 0…1 or NaN.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[48, 64])
    >>> hologram = hv.Hologram(hv.random_drive(system), system)
    >>> hologram.drive.shape
    (1, 2, 48, 64)
    """

    drive: Any
    system: System

    def __post_init__(self) -> None:
        if self.system.is_chain:
            object.__setattr__(self, "drive", chain_drives(self.system, self.drive))
            return
        object.__setattr__(self, "drive", short_drive(self.system, self.drive))
        if self.drive.shape != self.system.drive_shape:
            axes = f"(frame, {'wavelength' if self.system.is_field else 'modulator'}, y, x)"
            raise UserError("drive", f"shape {self.drive.shape}", expected=f"{axes} = {self.system.drive_shape}")
        if self.system.is_field:
            self.field()
            return
        if not (np.isfinite(self.drive).all() and self.drive.min() >= 0 and self.drive.max() <= 1):
            raise UserError("drive", "values outside 0…1", expected="fractions of the modulator's stroke")

    @staticmethod
    def of_field(field: Wavefield) -> Hologram:
        """A field with the bench that shows it.

        field: a `Wavefield`. One whose pitch differs between y and x is resampled to the smaller one by its spectrum.
        Raises UserError for lengths out of range.

        >>> import holoview as hv, numpy as np
        >>> field = hv.load_field(np.ones((48, 64), np.complex64), pitch="8 um", wavelengths=["532 nm"]).field()
        >>> hv.Hologram.of_field(field).system.is_field
        True
        """
        if field.pitch_m[0] != field.pitch_m[1]:
            from holoview.holograms.fields.imaging import with_square_pitch  # slow start: it imports torch

            field = with_square_pitch(field)[0]
        return Hologram(lit_field(field), bench_of_field(field))

    def field(self) -> Wavefield:
        """The field of a hologram that is one, lit. Raises UserError for patterns, and for values that aren't finite.

        >>> import holoview as hv, numpy as np
        >>> field = hv.load_field(np.ones((48, 64), np.complex64), pitch="8 um", wavelengths=["532 nm"])
        >>> field.field().describe()
        '64 × 48 samples at 8 um, 1 wavelength (532 nm)'
        """
        system = self.system
        if not system.is_field:
            raise UserError(
                "hologram", "patterns of a modulator", expected="a field", remedy="`holoview export --field`"
            )
        pitch_m = system.modulators[0].pitch_m
        planes_m = system.planes_m
        distance_m = float(planes_m[len(planes_m) // 2])
        return Wavefield(self.drive, (pitch_m, pitch_m), system.wavelengths_m, distance_m, name=system.name)

    def scene(self, at: float | str = 0.0) -> FieldTarget:
        """The light of a hologram that is a field, for another hologram to show: a target of `iterate`.

        at: the plane of the field behind the last modulator of the other display, metres or text such as "5 mm".

        Returns a `FieldTarget`, whose `images` are the focal stack for a display. Raises UserError as `field` does.

        >>> import holoview as hv, numpy as np
        >>> field = hv.load_field(np.ones((48, 64), np.complex64), pitch="8 um", wavelengths=["532 nm"])
        >>> system = hv.load("holochrome-8").with_(shape=[48, 64], planes=["5 mm"])
        >>> field.scene("5 mm").images(system, system.planes_m).shape
        (1, 96, 128, 3)
        """
        from holoview.holograms.fields.field_target import FieldTarget  # slow start: it imports torch

        return FieldTarget(self.field(), self.system.amplitudes, units.parse(at, "at"))

    def save(self, path: str | os.PathLike[str], *, as_uint8: bool = False) -> None:
        """Writes the hologram to a file, atomically. Paths of effects' files beside it become relative to its folder.

        path: of the file (safetensors), which is replaced if it exists.
        as_uint8: stores the drive in 8 bits, a quarter of the size, rounded to the nearest 255th of the stroke; a
        field can't be.

        Raises UserError when the file can't be written.

        >>> import holoview as hv
        >>> system = hv.load("holochrome-8").with_(shape=[48, 64])
        >>> hv.Hologram(hv.random_drive(system), system).save("speckle.safetensors")
        """
        texts = {"system": preset.dumps(self.system, Path(path).parent)}
        if self.system.is_field:
            if as_uint8:
                raise UserError("as_uint8", "with a field", expected="patterns of modulators")
            save_field(path, self.field(), texts)
            return
        if self.system.is_chain:
            self._save_chain(path, texts, as_uint8)
            return
        tensors: dict[str, NDArray[Any]] = {
            "drive": np.rint(self.drive * _MAX_CODE).astype(np.uint8) if as_uint8 else self.drive.astype(np.float32),
            "amplitudes": self.system.amplitudes,
            "wavelengths": self.system.wavelengths_m,
        }
        _FILE.write(path, tensors, texts)

    def _save_chain(self, path: str | os.PathLike[str], texts: dict[str, str], as_uint8: bool) -> None:
        """Writes the file of a chain."""
        known: dict[str, NDArray[Any]] = {
            "amplitudes": self.system.amplitudes,
            "wavelengths": self.system.wavelengths_m,
        }
        for name, drive in self.drive.items():
            if name in complex_names(self.system):
                known[f"drive/{name}"] = np.stack([drive.real, drive.imag], axis=-1).astype(np.float32)
            elif as_uint8:
                known[f"drive/{name}"] = np.rint(drive * _MAX_CODE).astype(np.uint8)
            else:
                known[f"drive/{name}"] = np.asarray(drive, np.float32)
        _chain_format(self.system).write(path, known, texts)


def system_with_elements(path: str | os.PathLike[str]) -> System | None:
    """The system that a file of tensors holds as a list of elements, before its tensors are known; None without one."""
    text = metadata_of(path).get("system", "")
    return preset.loads(text, f"{path}: system", Path(path).parent) if "[[elements]]" in text else None


def load_hologram(path: str | os.PathLike[str]) -> Hologram:
    """Reads a hologram file that `Hologram.save` or `holoview optimise` wrote; also the file of a field.

    path: of the file (safetensors).

    Returns a `Hologram`. Raises UserError when the file is missing, damaged or of another format, when the drive
    doesn't fit the system, and when wavelengths or amplitudes differ from those of the system in the file.

    >>> import holoview as hv
    >>> system = hv.load("holochrome-8").with_(shape=[48, 64])
    >>> hv.Hologram(hv.random_drive(system), system).save("speckle.safetensors")
    >>> hv.load_hologram("speckle.safetensors").system == system
    True
    """
    if format_of(path) == FIELD_FORMAT:
        return _load_field_hologram(path)
    told = system_with_elements(path)
    with (_chain_format(told) if told is not None and told.is_chain else _FILE).open(path) as file:
        system = told or preset.loads(file.texts["system"], f"{path}: system", Path(path).parent)
        tensors = file.tensors(drive_sizes(system))
    for name, known in (("wavelengths", system.wavelengths_m), ("amplitudes", system.amplitudes)):
        if not np.array_equal(tensors[name], known):
            raise UserError(f"{path}: {name}", "contradict the file's own system", remedy="write the hologram again")
    if system.is_chain:
        return _chain_hologram(path, tensors, system)
    drive = tensors["drive"]
    scale = _MAX_CODE if drive.dtype == np.uint8 else np.float32(1.0)
    try:
        return Hologram(drive.astype(np.float32) / scale, system)
    except UserError as error:
        raise error.inside(f"{path}: ") from error


def _chain_hologram(path: str | os.PathLike[str], tensors: dict[str, NDArray[Any]], system: System) -> Hologram:
    """The hologram of a chain from the tensors of its file."""
    drives: dict[str, NDArray[Any]] = {}
    for name in system.drive_shapes:
        stored = tensors[f"drive/{name}"]
        if name in complex_names(system):
            drives[name] = (stored[..., 0] + 1j * stored[..., -1]).astype(np.complex64)
        else:
            drives[name] = stored.astype(np.float32) / (_MAX_CODE if stored.dtype == np.uint8 else np.float32(1.0))
    try:
        return Hologram(drives, system)
    except UserError as error:
        raise error.inside(f"{path}: ") from error


def _load_field_hologram(path: str | os.PathLike[str]) -> Hologram:
    """A field with the bench that its file holds, or else with one that is made for it."""
    field, texts = read_field(path)
    try:
        if "system" not in texts:
            return Hologram.of_field(field)
        system = preset.loads(texts["system"], f"{path}: system", Path(path).parent)
        if not np.array_equal(system.wavelengths_m, field.wavelengths_m) or not system.is_field:
            raise UserError("wavelengths", "contradict the file's own system", remedy="write the field again")
        return Hologram(lit_field(field), system)
    except UserError as error:
        raise error if error.where.startswith(str(path)) else error.inside(f"{path}: ") from error


def system_name_of(path: str | os.PathLike[str]) -> str | None:
    """The name of the bench in a hologram file; None for any other file. Only the header is read."""
    metadata = metadata_of(path)
    if metadata.get("format") not in (FORMAT, FIELD_FORMAT):
        return None
    try:
        return str(tomllib.loads(metadata["system"]).get("name", ""))
    except (KeyError, ValueError, RecursionError):
        return None
