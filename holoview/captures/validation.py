"""What a measurement session can't be, and what looks like a mistake: clear words instead of a wrong diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.util.errors import UserError

_LENGTH_LIMITS: dict[str, tuple[float, float, str]] = {
    "slm1 attribute pitch": (0.1e-6, 1e-3, "a pixel pitch in metres, such as 8e-6"),
    "slm2 attribute pitch": (0.1e-6, 1e-3, "a pixel pitch in metres, such as 8e-6"),
    "slm1 attribute opd_range": (1e-9, 20e-6, "an optical path in metres, such as 8e-7"),
    "slm2 attribute opd_range": (1e-9, 20e-6, "an optical path in metres, such as 8e-7"),
    "camera attribute pitch": (0.05e-6, 1e-3, "a pixel pitch in metres, such as 4e-6"),
    "wavelength": (100e-9, 10e-6, "wavelengths in metres, such as 520e-9"),
    "distance": (0.0, 1.0, "distances in metres, such as 0.004"),
    "geometry attribute gap": (0.0, 1.0, "a distance in metres, such as 0.001"),
    "geometry attribute focal_length": (1e-3, 1.0, "a focal length in metres, such as 0.2"),
}
"""Smallest and largest value that can be meant, and what is expected."""

_UNITS = {1e-3: "millimetres", 1e-6: "micrometres", 1e-9: "nanometres", 1e-2: "centimetres"}
_MAX_SPREAD_WIDTHS = (
    10.0  # modulator widths that light may spread sideways on its way: beyond, nothing is left of a picture
)


def check_captures(captures: Captures) -> None:
    """UserError unless the session can be measured data in SI units and fits together."""
    _check_counts(captures)
    _check_lengths(captures)
    _check_geometry(captures)
    _check_spread(captures)
    for number, panel in enumerate(captures.slms):
        where = f"slm{number + 1}"
        if not 2 <= panel.num_levels <= 65536:
            raise UserError(f"{where} attribute num_levels", f"{panel.num_levels}", expected="2 to 65536")
        highest = int(captures.levels[:, number].max())
        if highest >= panel.num_levels:
            raise UserError(f"{where}/levels", f"level {highest}", expected=f"0 to {panel.num_levels - 1}")
    _check_camera(captures)
    _check_images(captures)


def _check_counts(captures: Captures) -> None:
    columns: dict[str, NDArray[Any]] = {
        "camera/images": captures.images,
        "wavelength": captures.wavelength_m,
        "distance": captures.distance_m,
        "power": captures.power,
        "exposure": captures.exposure_s,
    }
    for name, array in columns.items():
        if len(array) != len(captures):
            raise UserError(name, f"{len(array)} captures", expected=f"{len(captures)}, as in slm1/levels")
        if array.dtype.kind == "f":
            wrong = np.flatnonzero(~np.isfinite(array))
            if len(wrong):
                raise UserError(name, f"{array[wrong[0]]} at capture {wrong[0]}", expected="finite numbers")
    for name in ("power", "exposure"):
        if not (columns[name] > 0).all():
            raise UserError(name, f"{columns[name].min():g}", expected="positive numbers")


def _check_lengths(captures: Captures) -> None:
    values: dict[str, NDArray[np.float64]] = {
        "wavelength": captures.wavelength_m,
        "camera attribute pitch": np.array([captures.camera.pitch_m]),
    }
    if not captures.is_fourier:
        values["distance"] = captures.distance_m
    for number, panel in enumerate(captures.slms):
        values[f"slm{number + 1} attribute pitch"] = np.array([panel.pitch_m])
        values[f"slm{number + 1} attribute opd_range"] = np.array([panel.opd_range_m])
    for name, value in (("gap", captures.gap_m), ("focal_length", captures.focal_length_m)):
        if value is not None:
            values[f"geometry attribute {name}"] = np.array([value])
    for name, array in values.items():
        low, high, expected = _LENGTH_LIMITS[name]
        wrong = array[~((array >= low) & (array <= high))]
        if len(wrong):
            raise UserError(name, f"{wrong[0]:g}", expected=expected, remedy=_unit_hint(float(wrong[0]), low, high))
    if captures.is_fourier and np.any(np.abs(captures.distance_m) > float(captures.focal_length_m or 0.0)):
        worst = float(np.abs(captures.distance_m).max())
        expected = "defocus from the focal plane in metres, less than the focal length"
        raise UserError("distance", f"{worst:g}", expected=expected, remedy=_unit_hint(worst, 0.0, 0.05))


def _check_spread(captures: Captures) -> None:
    """A distance over which light would leave the picture: 0.5 for half a millimetre."""
    if captures.is_fourier:
        return
    width = max(captures.levels.shape[2:]) * captures.slms[0].pitch_m
    diffracted = float(captures.wavelength_m.min()) / (2 * captures.slms[0].pitch_m)
    paths = {"distance": (float(captures.distance_m.max()), captures.iris2_na)}
    if captures.gap_m is not None:
        paths["geometry attribute gap"] = (captures.gap_m, captures.iris1_na)
    for name, (length, na) in paths.items():
        if length * min(na or 1.0, diffracted) > _MAX_SPREAD_WIDTHS * width:
            found = (
                f"{length:g}: light would spread over {_MAX_SPREAD_WIDTHS:g} times the modulator's {width * 1e3:.3g} mm"
            )
            raise UserError(name, found, remedy=_unit_hint(length, 0.0, 0.05))


def _unit_hint(value: float, low: float, high: float) -> str:
    """In which unit the value would make sense."""
    fitting = [name for factor, name in _UNITS.items() if low <= value * factor <= high and value * factor > 1e-9]
    return f"it looks like {fitting[0]}: lengths are in metres" if fitting else ""


def _check_geometry(captures: Captures) -> None:
    two = len(captures.slms) == 2
    if two and captures.is_fourier:
        raise UserError("slm2", "on a Fourier bench", expected="one modulator where there is a focal_length")
    if two and captures.gap_m is None:
        raise UserError("geometry attribute gap", "is missing", expected="the distance between the two modulators")
    if not two and captures.gap_m is not None:
        raise UserError("geometry attribute gap", "with one modulator", expected="no gap, or slm2/levels")
    if not two and captures.iris1_na is not None:
        raise UserError("geometry attribute iris1_na", "with one modulator", expected="iris2_na only")
    for name, na in (("iris1_na", captures.iris1_na), ("iris2_na", captures.iris2_na)):
        if na is not None and not 1e-5 <= na <= 1.0:
            raise UserError(f"geometry attribute {name}", f"{na:g}", expected="a sine between 0.00001 and 1")
    if two and captures.slms[0].pitch_m != captures.slms[1].pitch_m:
        raise UserError("slm2 attribute pitch", f"{captures.slms[1].pitch_m:g}", expected="the pitch of slm1")


def _check_camera(captures: Captures) -> None:
    camera = captures.camera
    if not 1 <= camera.bit_depth <= 16:
        raise UserError("camera attribute bit_depth", f"{camera.bit_depth}", expected="1 to 16")
    if not camera.electrons_per_count > 0:
        raise UserError("camera attribute electrons_per_count", f"{camera.electrons_per_count:g}", expected="above 0")
    if not camera.read_noise >= 0:
        raise UserError("camera attribute read_noise", f"{camera.read_noise:g}", expected="0 or more")
    if not 0 <= camera.black_level < camera.saturation:
        expected = f"0 to {camera.saturation} counts"
        raise UserError("camera attribute black_level", f"{camera.black_level:g}", expected=expected)


def _check_images(captures: Captures) -> None:
    camera, images = captures.camera, captures.images
    highest = int(images.max())
    if highest > camera.saturation:
        expected = f"0 to {camera.saturation} at {camera.bit_depth} bits"
        raise UserError("camera/images", f"{highest} counts", expected=expected, remedy="correct bit_depth")
    noise = (camera.read_noise**2 / camera.electrons_per_count**2 + 1 / 12) ** 0.5
    if float(images.mean(axis=(1, 2)).max()) - camera.black_level < 0.5 * noise:
        raise UserError(
            "camera/images",
            "all are dark",
            expected="light above black_level + noise",
            remedy=("check shutter, exposure and black_level"),
        )
    if float((images >= camera.saturation).mean(axis=(1, 2)).min()) > 0.5:
        raise UserError("camera/images", "all are saturated", expected="a shorter exposure or less laser power")
    _check_orientation(captures)


def _check_orientation(captures: Captures) -> None:
    """Rows and columns swapped: the picture covers the modulator only when it is turned."""
    if captures.is_fourier:
        return
    (rows, columns), (h, w) = captures.levels.shape[2:], captures.shape
    if rows == columns or h == w:
        return
    if (rows < columns) != (h < w):
        found = f"pictures of {h} × {w} pixels for modulators of {rows} × {columns}"
        raise UserError(
            "camera/images",
            found,
            expected="rows × columns, first row at the top, as slm1/levels",
            remedy="rows and columns look swapped in one of them",
        )
