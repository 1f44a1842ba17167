"""Summary of captures: as numbers for `holoview captures check`, and as a contact sheet."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.nominal_bench import describe_stops
from holoview.model.effects.registry import listed_effects
from holoview.report import CaptionedTile, contact_sheet, greyscale_pixels

_DARK_SIGMAS = 3.0  # an image is dark if its mean signal is less than this many standard deviations of a dark mean
_WHITE_QUANTILE = 0.999  # of the pixels, shown white
_SATURATED_COLOUR = (230, 40, 40)
_TILE_WIDTH_PX = 420


def summarise(captures: Captures) -> dict[str, Any]:
    """The contents of captures as a dictionary for JSON.

    stops: those of each relay in words, the first relay before the second. saturated: fractions of the pixels, in the
    worst capture and on average. dark: captures without significant light. mean_electrons: median over the captures of
    the mean signal per pixel. cant_tell: {effect id: why these data can't show it}.
    """
    camera, properties = captures.camera, captures.data_properties()
    signal = captures.images.mean(axis=(1, 2)) - camera.black_level
    dark_limit = _DARK_SIGMAS * camera.dark_noise / np.sqrt(captures.images[0].size)
    saturated = (captures.images >= camera.saturation).mean(axis=(1, 2))
    unmet = {name: effect.needs.unmet_by(properties) for name, effect in listed_effects().items()}
    return {
        "captures": len(captures),
        "modulators": len(captures.slms),
        "pixels": list(captures.levels.shape[2:]),
        "levels": [slm.num_levels for slm in captures.slms],
        "image": list(captures.shape),
        "geometry": "Fourier bench" if captures.is_fourier else "near field",
        "stops": [describe_stops(relay) for relay in (captures.relay1, captures.relay2)[-len(captures.slms) :]],
        "wavelengths_m": captures.wavelengths_m.tolist(),
        "distances_m": np.unique(captures.distance_m).tolist(),
        "powers": properties.powers,
        "saturated": {"worst": float(saturated.max()), "mean": float(saturated.mean())},
        "dark": np.flatnonzero(signal < dark_limit).tolist(),
        "mean_electrons": float(np.median(signal) * camera.electrons_per_count),
        "cant_tell": {name: reason for name, reason in unmet.items() if reason},
    }


def capture_sheet(captures: Captures, max_captures: int = 12) -> NDArray[np.uint8]:
    """A contact sheet (y, x, 3): patterns and image of at most `max_captures` captures, evenly spread.

    Each image is scaled to its own range; saturated pixels are red.
    """
    chosen = np.unique(np.linspace(0, len(captures) - 1, max_captures).round().astype(int))
    titles = [*(f"modulator {n + 1}" for n in range(len(captures.slms))), "camera"]
    rows = []
    for k in chosen:
        λ, z = captures.wavelength_m[k] * 1e9, captures.distance_m[k] * 1e3
        caption = f"{k}: {λ:g} nm, {z:g} mm, power {captures.power[k]:g}, {captures.exposure_s[k] * 1e3:.3g} ms"
        patterns = [CaptionedTile(greyscale_pixels(drive), "") for drive in captures.drive(int(k))]
        rows.append([*patterns, CaptionedTile(_camera_pixels(captures, int(k)), caption)])
    return contact_sheet(f"{len(captures)} captures", titles, rows, width=_TILE_WIDTH_PX)


def _camera_pixels(captures: Captures, k: int) -> NDArray[np.uint8]:
    """A camera image as 8-bit pixels (y, x, 3), proportional to the square root of the light."""
    image, camera = captures.images[k].astype(np.float64), captures.camera
    white = max(float(np.quantile(image, _WHITE_QUANTILE)) - camera.black_level, 1.0)
    pixels = greyscale_pixels(np.sqrt(np.clip((image - camera.black_level) / white, 0, 1)))
    pixels[captures.images[k] >= camera.saturation] = _SATURATED_COLOUR
    return pixels
