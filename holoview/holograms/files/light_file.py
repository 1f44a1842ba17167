"""Light as numbers in files: intensity by wavelength, XYZ and linear RGB, with their units and axes.

    .npz          all numbers as they were computed; "about" holds a JSON text as bytes
    .exr          R, G, B with chromaticities; xyz.X, xyz.Y, xyz.Z; S0.550,000000nm of each wavelength (JCGT 10(3),
                  2021); a part for each plane
    .tif          R, G, B, a page for each plane, linear sRGB
    .npy          the intensity (plane, wavelength, y, x), which `np.load` reads; behind it in the same file, as
                  `np.save` writes several arrays, the JSON text as bytes, xyz, rgb, wavelengths_m and planes_m

`light_writer` writes them. A file of holoview says so in its JSON text: the attribute "holoview" of an .exr, the
description of a .tif.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray

from holoview.holograms.files.image_reader import file_format, read_rasters
from holoview.holograms.files.light_arrays import light_arrays
from holoview.light.colour import SRGB_TO_XYZ
from holoview.util.errors import UserError
from holoview.util.files import read_bytes
from holoview.util.memory_limit import require_memory
from holoview.util.reader_process import call_in_child
from holoview.util.tables import parse_json_table

SUFFIXES = (".npz", ".exr", ".tif", ".tiff", ".npy")
FORMAT = "holoview light 1"
_EXPECTED = "light that holoview wrote (.npz, .npy, .exr or .tif)"
_MOST_ABOUT = 8 << 20


@dataclass(frozen=True, eq=False)
class PlaneLight:
    """The light at focal planes.

    intensity: (plane, wavelength, y, x), None where a file doesn't hold it. xyz, rgb: (plane, y, x, 3), rgb linear and
    not clipped, in the colour space that `about` names. wavelengths_m: (wavelength,). planes_m: (plane,). about: JSON
    values: format, observer, bench, versions. stored: which of intensity, xyz and rgb a file holds as they were, the
    others being derived from them.
    """

    xyz: NDArray[np.floating]
    rgb: NDArray[np.floating]
    intensity: NDArray[np.floating] | None = None
    wavelengths_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    planes_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    about: Mapping[str, Any] = field(default_factory=dict)
    stored: tuple[str, ...] = ("xyz", "rgb", "intensity")


def is_light_file(path: Path) -> bool:
    """Whether a file says that it holds light that holoview wrote. Raises UserError where it can't be read."""
    kind = file_format(path)
    if kind in ("OpenEXR", "TIFF"):
        return FORMAT.encode() in read_bytes(path, _EXPECTED, most=_MOST_ABOUT)
    return kind in ("NPZ", "NPY of light")


def read_light(path: Path) -> PlaneLight:
    """The light of a file that holoview wrote, every number as it was written.

    Raises UserError for other files, damaged ones, and such that are too large for the memory that is allowed.
    """
    if not is_light_file(path):
        raise UserError(str(path), "holds no light that holoview wrote", expected=_EXPECTED)
    kind = file_format(path)
    if kind in ("NPZ", "NPY of light"):
        return _read_arrays(path)
    return call_in_child(str(path), path, partial(_read_exr if kind == "OpenEXR" else _read_tiff, path))


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turns the exceptions of readers into a UserError that names the file."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # each reader raises exceptions of its own
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(str(path), f"is truncated or damaged ({reason})", expected=_EXPECTED) from error


def _read_arrays(path: Path) -> PlaneLight:
    with _naming(path):
        arrays = light_arrays(path)
    if not {"about", "xyz", "rgb"} <= arrays.keys():
        raise UserError(str(path), f"holds the arrays {', '.join(sorted(arrays))}", expected=_EXPECTED)
    about = _parse_about(path, arrays["about"].tobytes())
    light = PlaneLight(
        arrays["xyz"],
        arrays["rgb"],
        arrays.get("intensity"),
        arrays.get("wavelengths_m", np.zeros(0)),
        arrays.get("planes_m", np.zeros(0)),
        about,
    )
    return _checked(path, light)


def _checked(path: Path, light: PlaneLight) -> PlaneLight:
    """The light. Raises UserError for arrays that don't belong together, and for numbers that aren't finite."""
    shape = light.xyz.shape
    intensity = light.intensity
    fits = len(shape) == 4 and shape[3] == 3 and light.rgb.shape == shape and 0 not in shape
    if fits and intensity is not None:
        fits = intensity.shape == (shape[0], len(light.wavelengths_m), *shape[1:3]) and intensity.dtype.kind == "f"
    if not fits or light.xyz.dtype.kind != "f" or light.rgb.dtype.kind != "f":
        raise UserError(
            str(path), f"holds colours of shape {shape} that don't fit its other arrays", expected=_EXPECTED
        )
    arrays = (light.xyz, light.rgb, *(() if intensity is None else (intensity,)))
    if not all(np.isfinite(array).all() for array in arrays):
        raise UserError(str(path), "holds NaN or infinity", expected="finite numbers")
    return light


def _parse_about(path: Path, text: bytes | str) -> Mapping[str, Any]:
    if len(text) > _MOST_ABOUT:
        raise UserError(str(path), f"a text of {len(text)} bytes about its light", expected=f"at most {_MOST_ABOUT}")
    decoded = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    about = parse_json_table(decoded, str(path), _EXPECTED)
    if about.get("format") != FORMAT:
        raise UserError(str(path), f"the format {about.get('format')!r}", expected=f'"{FORMAT}"')
    return about


def _numbers(about: Mapping[str, Any], key: str) -> NDArray[np.float64]:
    with suppress(TypeError, ValueError):
        return np.array(about.get(key, ()), dtype=np.float64).reshape(-1)
    return np.zeros(0)


def _read_exr(path: Path) -> PlaneLight:
    with _naming(path):
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            headers = [dict(file.header(index)) for index in range(len(file.parts))]
        about = _parse_about(path, str(headers[0].get("holoview", "")))
        wavelengths_m = _numbers(about, "wavelengths_m")
        require_memory(str(path), sum(map(_exr_bytes, headers)))
        with OpenEXR.File(str(path), separate_channels=True) as file:
            if len(file.parts) != len(headers):  # the library leaves out parts that end too early
                raise ValueError(f"{len(file.parts)} of {len(headers)} parts are whole")
            parts = [dict(file.channels(index)) for index in range(len(headers))]
            rgb, xyz = (_stacked(parts, names) for names in (["R", "G", "B"], ["xyz.X", "xyz.Y", "xyz.Z"]))
            spectral = [f"S0.{wavelength_text(at)}" for at in wavelengths_m.tolist()]
            intensity = np.moveaxis(_stacked(parts, spectral), -1, 1) if spectral else None
    return _checked(path, PlaneLight(xyz, rgb, intensity, wavelengths_m, _numbers(about, "planes_m"), about))


def wavelength_text(wavelength_m: float) -> str:
    """A wavelength as a spectral channel of an .exr names it: "550,000000nm"."""
    return f"{wavelength_m * 1e9:.6f}nm".replace(".", ",")


def _exr_bytes(header: Mapping[str, Any]) -> int:
    (left, top), (right, bottom) = header["dataWindow"]
    return 8 * (int(right) - int(left) + 1) * (int(bottom) - int(top) + 1) * len(header["channels"])


def _stacked(parts: list[dict[str, Any]], names: list[str]) -> NDArray[np.floating]:
    """The channels of all parts, (plane, y, x, channel); a copy, as closing the file empties its channels."""
    return np.stack([np.stack([part[name].pixels for name in names], axis=-1) for part in parts])


def _read_tiff(path: Path) -> PlaneLight:
    with _naming(path):
        with tifffile.TiffFile(path) as file:
            about = _parse_about(path, str(file.pages[0].description))
        rgb = np.stack([raster.values for raster in read_rasters(path)]).astype(np.float32)
    xyz = rgb @ SRGB_TO_XYZ.T if rgb.shape[-1] == 3 else rgb  # which `_checked` refuses
    return _checked(path, PlaneLight(xyz, rgb, None, np.zeros(0), _numbers(about, "planes_m"), about, ("rgb",)))


def about_text(about: Mapping[str, Any]) -> str:
    """The JSON text that a file keeps."""
    return json.dumps({"format": FORMAT, **about}, ensure_ascii=True)
