"""Writes light as numbers: .npz, .exr, .tif and .npy, as `light_file` describes and reads them."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from holoview.holograms.files.exr_writer import ExrPart, exr_bytes
from holoview.holograms.files.light_arrays import LIGHT_ARRAYS
from holoview.holograms.files.light_file import SUFFIXES, PlaneLight, about_text, wavelength_text
from holoview.light.colour import ColourSpace
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.file_writer import write_file
from holoview.util.memory_limit import require_memory
from holoview.util.packages import __version__

_WHITE = (0.3127, 0.3290)
_UNITS = {
    "intensity": "1 is a modulator under a uniform wave at amplitude 1",
    "xyz": "CIE XYZ of the observer; Y = 1 is the white of the display",
    "rgb": "linear RGB, not clipped; 1, 1, 1 is the white of the display",
    "wavelengths_m": "m, in vacuum",
    "planes_m": "m, from the last modulator",
    "pitch_m": "m, from one sample to the next",
}
_AXES = {
    "intensity": ["plane", "wavelength", "y", "x"],
    "xyz": ["plane", "y", "x", "X, Y, Z"],
    "rgb": ["plane", "y", "x", "R, G, B"],
    "wavelengths_m": ["wavelength"],
    "planes_m": ["plane"],
}


def make_light(
    intensity: Any, xyz: Any, wavelengths_m: Any, planes_m: Any, space: ColourSpace, **about: Any
) -> PlaneLight:
    """Light with linear RGB of a colour space (float32), from intensity (plane, wavelength, y, x) and XYZ.

    about: further JSON values that the files keep, such as observer, pitch_m, backend and the bench.
    """
    described = {
        "software": f"holoview {__version__}",
        "rgb_space": space.title,
        "chromaticities": [*space.chromaticities, _WHITE],
        "units": _UNITS,
        "axes": _AXES,
        "wavelengths_m": np.asarray(wavelengths_m).tolist(),
        "planes_m": np.asarray(planes_m).tolist(),
        **about,
    }
    rgb = (np.asarray(xyz, dtype=np.float64) @ space.from_xyz.T).astype(np.float32)
    return PlaneLight(xyz, rgb, intensity, np.asarray(wavelengths_m), np.asarray(planes_m), described)


def check_light_suffix(path: str | os.PathLike[str]) -> str:
    """The suffix of a file for light. Raises UserError for another one."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise UserError(str(path), f'the suffix "{Path(path).suffix}"', expected=" or ".join(SUFFIXES))
    return suffix


def write_light(path: str | os.PathLike[str], light: PlaneLight) -> None:
    """Writes light by the suffix of the path, atomically.

    Raises UserError for another suffix, for a .tif in other colours than sRGB, and where there isn't the memory to make
    the file; WriteError when it can't be written.
    """
    suffix = check_light_suffix(path)
    intensity = light.intensity
    assert intensity is not None
    require_memory(str(path), 3 * (light.xyz.nbytes + light.rgb.nbytes + intensity.nbytes), "write fewer planes")
    if suffix == ".npz":
        write_file(path, _npz(light))
    elif suffix == ".npy":
        buffer = io.BytesIO()
        for array in _arrays(light).values():
            np.save(buffer, array, allow_pickle=False)
        write_file(path, buffer.getbuffer())
    elif suffix == ".exr":
        write_file(path, exr_bytes(_exr_parts(light)))
    else:
        write_file(path, _tiff(path, light))


def _npz(light: PlaneLight) -> memoryview:
    buffer, arrays = io.BytesIO(), _arrays(light)
    np.savez(buffer, about=arrays.pop("about"), **arrays)  # first: by it the file is recognised
    return buffer.getbuffer()


def _arrays(light: PlaneLight) -> dict[str, Any]:
    """The arrays of `LIGHT_ARRAYS`, in this order."""
    about = {"about": np.frombuffer(about_text(light.about).encode(), np.uint8)}
    return {name: np.asarray(about[name] if name in about else getattr(light, name)) for name in LIGHT_ARRAYS}


def _exr_parts(light: PlaneLight) -> list[ExrPart]:
    """A part for each plane, named by it."""
    assert light.intensity is not None
    names = [f"S0.{wavelength_text(at)}" for at in light.wavelengths_m.tolist()]
    if len(set(names)) < len(names):
        found = "lasers of equal wavelength, which name its channels"
        raise UserError("an .exr file", found, expected="wavelengths that differ", remedy="write an .npz")
    texts = {
        "holoview": about_text(light.about),
        "spectralLayoutVersion": "1.0",
        "emissiveUnits": "W.m^-2.sr^-1",
    }
    parts = []
    for number, plane_m in enumerate(light.planes_m.tolist()):
        channels = {name: light.rgb[number, ..., c] for c, name in enumerate("RGB")}
        channels |= {f"xyz.{name}": light.xyz[number, ..., c] for c, name in enumerate("XYZ")}
        channels |= dict(zip(names, light.intensity[number], strict=True))
        name = f"plane {number + 1}, {units.format_rounded(plane_m, 'mm')}"
        parts.append(ExrPart(name, channels, texts, light.about["chromaticities"]))
    return parts


def _tiff(path: str | os.PathLike[str], light: PlaneLight) -> memoryview:
    if light.about["rgb_space"] != "sRGB":
        remedy = "write an .exr, which states its primaries"
        raise UserError(str(path), f"in {light.about['rgb_space']}", expected="sRGB: readers take it so", remedy=remedy)
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as writer:
        for number, rgb in enumerate(light.rgb):
            text = about_text(light.about) if number == 0 else None
            writer.write(rgb, photometric="rgb", description=text, metadata=None, software=False)
    return buffer.getbuffer()
