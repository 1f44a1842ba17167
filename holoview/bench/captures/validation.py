"""Validates captures and hints at wrong units, so that mistakes in a file don't become a wrong diagnosis.

Errors name the dataset or attribute of the capture file (`docs/captures.md`).

`summarise` and `capture_sheet` show captures as numbers, for `holoview captures check`, and as a contact sheet.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.count_bits import bits_error
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.nominal_bench import describe_stops, has_only_stops, stop_attributes
from holoview.light.model.effects.registry import chain_parts, effects_of, unmet_by_data
from holoview.light.numerics.sample_bits import find_clipping
from holoview.util.errors import UserError
from holoview.util.figures import CaptionedTile, contact_sheet, greyscale_pixels

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
"""Smallest and largest plausible value (m) of each length, and the expectation in words for an error."""

_UNITS = {1e-3: "millimetres", 1e-6: "micrometres", 1e-9: "nanometres", 1e-2: "centimetres"}
_MAX_SPREAD_WIDTHS = 10.0  # modulator widths by which light may spread sideways: beyond, the image is empty
_USUAL_MAX_DISTANCE_M = 0.05  # a hint suggests the unit in which a distance would be at most this
_MIN_LIGHT_SIGMAS = 0.5  # of a pixel's dark noise, for the mean signal of the brightest image
_WHITE_QUANTILE = 0.999  # of the pixels are darker than light that is shown white
_BRIGHT_SIGMAS = 8.0  # of the dark noise, by which white exceeds black; noise alone: a thousandth of pixels above 3
_LEAST_USABLE_PX = 256  # of a picture, that aren't left out
_MAX_SATURATED = 0.5  # fraction of the pixels of the least saturated image


def check_captures(captures: Captures) -> None:
    """Raises UserError unless captures are consistent and plausible as measured data in SI units."""
    check_settings(captures)
    _check_images(captures)


def check_settings(captures: Captures) -> None:
    """As `check_captures`, without a check of the pictures: before a measurement they are all dark."""
    _check_columns(captures)
    check_lengths(captures)
    _check_geometry(captures)
    _check_levels(captures)
    _check_camera(captures)
    _check_orientation(captures)


def check_lengths(captures: Captures) -> None:
    """Raises UserError unless a bench can have every length; the usual reason is a wrong unit."""
    _check_length_limits(captures)
    _check_spread(captures)


def _check_levels(captures: Captures) -> None:
    names = [f"slm{number + 1}" for number in range(len(captures.slms))]
    if captures.chain is not None:
        names = [f"elements/{name}" for name in captures.chain.drive_shapes]
    for number, (slm, where) in enumerate(zip(captures.slms, names, strict=True)):
        if not 2 <= slm.num_levels <= 65536:
            raise UserError(f"{where} attribute num_levels", f"{slm.num_levels}", expected="2 to 65536")
        highest = int(captures.levels[:, number].max())
        if highest >= slm.num_levels:
            raise UserError(f"{where}/levels", f"level {highest}", expected=f"0 to {slm.num_levels - 1}")


def _check_columns(captures: Captures) -> None:
    """Arrays with one entry per capture have equal lengths; numbers are finite; powers and exposures are positive."""
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


def _check_length_limits(captures: Captures) -> None:
    values: dict[str, NDArray[np.float64]] = {
        "wavelength": captures.wavelength_m,
        "camera attribute pitch": np.array([captures.camera.pitch_m]),
    }
    if not captures.is_fourier:
        values["distance"] = captures.distance_m
    for number, slm in enumerate(captures.slms if captures.chain is None else ()):
        values[f"slm{number + 1} attribute pitch"] = np.array([slm.pitch_m])
        values[f"slm{number + 1} attribute opd_range"] = np.array([slm.opd_range_m])
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
        raise UserError(
            "distance", f"{worst:g}", expected=expected, remedy=_unit_hint(worst, 0.0, _USUAL_MAX_DISTANCE_M)
        )


def _check_spread(captures: Captures) -> None:
    """No distance is so long that diffraction would spread the light over many modulator widths.

    Such a distance, for example 0.5 for half a millimetre, is within the limits of `_check_length_limits`, but its unit
    is wrong. The light spreads by distance × the smaller of the stops' sine and λ/(2·pitch), the edge of the first
    order.
    """
    if captures.is_fourier or captures.chain is not None:
        return
    pitch_m, shortest = captures.slms[0].pitch_m, float(captures.wavelength_m.min())
    width = max(captures.levels.shape[2:]) * pitch_m
    paths = {"distance": (float(captures.distance_m.max()), captures.relay2)}
    if captures.gap_m is not None:
        paths["geometry attribute gap"] = (captures.gap_m, captures.relay1)
    for name, (length, relay) in paths.items():
        if length * relay.first_order_sine(shortest, pitch_m) > _MAX_SPREAD_WIDTHS * width:
            found = (
                f"{length:g}: light would spread over {_MAX_SPREAD_WIDTHS:g} times the modulator's {width * 1e3:.3g} mm"
            )
            raise UserError(name, found, remedy=_unit_hint(length, 0.0, _USUAL_MAX_DISTANCE_M))


def _unit_hint(value: float, low: float, high: float) -> str:
    """The unit, in words, in which the value would be within the limits; empty if there is none."""
    fitting = [name for factor, name in _UNITS.items() if low <= value * factor <= high and value * factor > 1e-9]
    return f"it looks like {fitting[0]}: lengths are in metres" if fitting else ""


def _check_geometry(captures: Captures) -> None:
    if captures.chain is not None:
        return  # which is checked where it is made
    two = len(captures.slms) == 2
    if two and captures.is_fourier:
        raise UserError("slm2", "on a Fourier bench", expected="one modulator where there is a focal_length")
    if two and captures.gap_m is None:
        raise UserError("geometry attribute gap", "is missing", expected="the distance between the two modulators")
    if not two and captures.gap_m is not None:
        raise UserError("geometry attribute gap", "with one modulator", expected="no gap, or slm2/levels")
    for number, relay in ((1, captures.relay1), (2, captures.relay2)):
        if not has_only_stops(relay):
            raise UserError(f"relay{number}", "has more than stops", expected="an iris, a square stop and their centre")
    if not two and (stops := stop_attributes(captures.relay1, 1)):
        raise UserError(
            f"geometry attribute {next(iter(stops))}", "with one modulator", expected="stops of relay 2 only"
        )
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
    error = bits_error(images, camera.bit_depth)
    if error is not None:
        raise error
    _check_usable(captures)
    is_dim = float(images.mean(axis=(1, 2)).max()) - camera.black_level < _MIN_LIGHT_SIGMAS * camera.dark_noise
    if is_dim and not _has_bright_pixels(captures):
        raise UserError(
            "camera/images",
            "all are dark",
            expected="light above black_level + noise",
            remedy="check shutter, exposure and black_level",
        )
    if float(captures.saturated_shares.min()) > _MAX_SATURATED:
        raise UserError("camera/images", "all are saturated", expected="a shorter exposure or less laser power")


def _check_usable(captures: Captures) -> None:
    if captures.usable is None:
        return
    if captures.usable.shape != captures.images.shape:
        found = f"a mask of {captures.usable.shape} for pictures of {captures.images.shape}"
        raise UserError("camera/mask", found, expected="the shape of the pictures")
    least = min(_LEAST_USABLE_PX, math.prod(captures.shape) // 4)
    counts = captures.usable.sum(axis=(1, 2))
    if (counts < least).any():
        found = f"leaves {counts.min()} pixels of capture {counts.argmin()}"
        raise UserError("camera/mask", found, expected=f"{least} or more", remedy="0 leaves a pixel out")


def _has_bright_pixels(captures: Captures) -> bool:
    """Whether the light of a picture is gathered in a few pixels, as near the axis of a Fourier bench."""
    camera = captures.camera
    bright = max(float(np.quantile(image, _WHITE_QUANTILE)) for image in captures.images)
    return bright - camera.black_level > _BRIGHT_SIGMAS * camera.dark_noise


def _check_orientation(captures: Captures) -> None:
    """Images and patterns are either both wide or both tall; otherwise rows and columns are swapped in one of them."""
    if captures.is_fourier:
        return
    shape = captures.levels.shape[2:] if captures.chain is None else captures.chain.way.shape
    (rows, columns), (image_rows, image_columns) = shape, captures.shape
    if rows == columns or image_rows == image_columns:
        return
    if (rows < columns) != (image_rows < image_columns):
        found = f"pictures of {image_rows} × {image_columns} pixels for modulators of {rows} × {columns}"
        raise UserError(
            "camera/images",
            found,
            expected="rows × columns, first row at the top, as slm1/levels",
            remedy="rows and columns look swapped in one of them",
        )


# --- a summary --------------------------------------------------------------------------------------------------------


_DARK_SIGMAS = 3.0  # an image is dark if its mean signal is less than this many standard deviations of a dark mean
_SATURATED_COLOUR = (230, 40, 40)
_LEFT_OUT_COLOUR = (40, 80, 200)  # half of it, over the picture
_TILE_WIDTH_PX = 420


def summarise(captures: Captures) -> dict[str, Any]:
    """The contents of captures as a dictionary for JSON.

    stops: the stops of each relay in words, the first relay before the second. saturated: fractions of the pixels, in
    the worst capture and on average. clipped: where counts are clipped below the full scale, else absent. dark:
    captures without significant light. left_out: share of the pixels that no fit and measure uses, and the rows and
    columns [first, behind the last] of the others, absent where all count. estimated: sentences on what nobody stated.
    mean_electrons: median over the captures of the mean signal per pixel.
    cant_tell: {effect id: why these data can't show it}.
    """
    camera, properties = captures.camera, captures.data_properties()
    signal = captures.images.mean(axis=(1, 2)) - camera.black_level
    dark_limit = _DARK_SIGMAS * camera.dark_noise / np.sqrt(captures.images[0].size)
    saturated = captures.saturated_shares
    clip = find_clipping(captures.images)
    clipped = {"level": clip.level, "share": clip.share} if clip and clip.level < camera.saturation else None
    unmet = {effect.id: unmet_by_data(effect, properties) for effect in effects_of(properties)}
    return {
        "captures": len(captures),
        "modulators": len(captures.slms),
        "pixels": list(captures.levels.shape[2:]),
        "levels": [slm.num_levels for slm in captures.slms],
        "image": list(captures.shape),
        "geometry": _geometry(captures),
        "stops": _stops(captures),
        **({} if captures.chain is None else {"elements": dict(chain_parts(captures.chain))}),
        "wavelengths_m": captures.wavelengths_m.tolist(),
        "distances_m": np.unique(captures.distance_m).tolist(),
        "powers": properties.powers,
        "saturated": {"worst": float(saturated.max()), "mean": float(saturated.mean())},
        **({"clipped": clipped} if clipped else {}),
        **({} if captures.usable is None else {"left_out": _left_out(captures.usable)}),
        **({"estimated": list(captures.estimated)} if captures.estimated else {}),
        "dark": np.flatnonzero(signal < dark_limit).tolist(),
        "mean_electrons": float(np.median(signal) * camera.electrons_per_count),
        "cant_tell": {name: reason for name, reason in unmet.items() if reason},
    }


def _geometry(captures: Captures) -> str:
    if captures.chain is not None:
        return "chain of elements"
    return "Fourier bench" if captures.is_fourier else "near field"


def _stops(captures: Captures) -> list[str]:
    """The stops of each relay in words, in the order of the light."""
    if captures.chain is not None:
        return [describe_stops(relay) for relay in captures.chain.way.relays]
    return [describe_stops(relay) for relay in (captures.relay1, captures.relay2)[-len(captures.slms) :]]


def _left_out(usable: NDArray[np.bool_]) -> dict[str, Any]:
    """The share that is left out, and the smallest box of rows and columns that holds the others."""
    lines = (np.flatnonzero(usable.any(axis=axes)) for axes in ((0, 2), (0, 1)))
    rows, columns = ([int(k[0]), int(k[-1]) + 1] for k in lines)
    return {"share": 1.0 - float(usable.mean()), "rows": rows, "columns": columns}


def capture_sheet(captures: Captures, max_captures: int = 12) -> NDArray[np.uint8]:
    """A contact sheet (y, x, 3): patterns and image of at most `max_captures` captures, evenly spread.

    Each image is scaled to its own range; saturated pixels are red, pixels that are left out are blue.
    """
    chosen = np.unique(np.linspace(0, len(captures) - 1, max_captures).round().astype(int))
    chain = captures.chain
    rows = []
    for k in chosen:
        λ, z = captures.wavelength_m[k] * 1e9, captures.distance_m[k] * 1e3
        caption = f"{k}: {λ:g} nm, {z:g} mm, power {captures.power[k]:g}, {captures.exposure_s[k] * 1e3:.3g} ms"
        drives = captures.drive(int(k))
        shown = drives if chain is None else captures.patterns(drives).values()
        patterns = [CaptionedTile(greyscale_pixels(drive), "") for drive in shown]
        rows.append([*patterns, CaptionedTile(_camera_pixels(captures, int(k)), caption)])
    return contact_sheet(f"{len(captures)} captures", [*captures.slm_names, "camera"], rows, width=_TILE_WIDTH_PX)


def _camera_pixels(captures: Captures, k: int) -> NDArray[np.uint8]:
    """A camera image as 8-bit pixels (y, x, 3), proportional to the square root of the light."""
    image, camera = captures.images[k].astype(np.float64), captures.camera
    white = max(float(np.quantile(image, _WHITE_QUANTILE)) - camera.black_level, 1.0)
    pixels = greyscale_pixels(np.sqrt(np.clip((image - camera.black_level) / white, 0, 1)))
    pixels[captures.images[k] >= camera.saturation] = _SATURATED_COLOUR
    left_out = ~captures.usable_pixels(k)
    pixels[left_out] = (pixels[left_out] + np.array(_LEFT_OUT_COLOUR)) // 2
    return pixels
