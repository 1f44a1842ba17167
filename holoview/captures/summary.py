"""What a measurement session holds, in numbers and in pictures, and what it can't tell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.model.effects.registry import listed_effects
from holoview.report.contact_sheet import CaptionedTile, contact_sheet

_DARK_SIGMAS = 3.0  # of the noise: a picture whose mean signal is less shows nothing


def summarise(captures: Captures) -> dict[str, Any]:
    """Facts of a session, ready for JSON. `cant_tell`: {effect: why these data don't show it}."""
    camera, facts = captures.camera, captures.data_properties()
    signal = captures.images.mean(axis=(1, 2)) - camera.black_level
    noise = float(camera.noise_variance(np.zeros(1))[0]) ** 0.5
    saturated = (captures.images >= camera.saturation).mean(axis=(1, 2))
    return {
        "captures": len(captures),
        "modulators": len(captures.slms),
        "pixels": list(captures.levels.shape[2:]),
        "levels": [panel.num_levels for panel in captures.slms],
        "image": list(captures.shape),
        "geometry": "Fourier bench" if captures.is_fourier else "near field",
        "wavelengths_m": captures.wavelengths_m.tolist(),
        "distances_m": np.unique(captures.distance_m).tolist(),
        "powers": facts.powers,
        "saturated": {"worst": float(saturated.max()), "mean": float(saturated.mean())},
        "dark": np.flatnonzero(signal < _DARK_SIGMAS * noise / np.sqrt(captures.images[0].size)).tolist(),
        "mean_electrons": float(np.median(signal) * camera.electrons_per_count),
        "cant_tell": {name: why for name, one in listed_effects().items() if (why := one.needs.unmet_by(facts))},
    }


def capture_sheet(captures: Captures, max_captures: int = 12) -> NDArray[np.uint8]:
    """A picture (y, x, 3): patterns and camera image of captures spread over the session, each scaled to its range."""
    chosen = np.unique(np.linspace(0, len(captures) - 1, max_captures).round().astype(int))
    heads = [*(f"modulator {n + 1}" for n in range(len(captures.slms))), "camera"]
    rows = []
    for k in chosen:
        λ, z = captures.wavelength_m[k] * 1e9, captures.distance_m[k] * 1e3
        said = f"{k}: {λ:g} nm, {z:g} mm, power {captures.power[k]:g}, {captures.exposure_s[k] * 1e3:.3g} ms"
        patterns = [
            CaptionedTile(_grey(levels / (panel.num_levels - 1)), "")
            for levels, panel in zip(captures.levels[k], captures.slms, strict=True)
        ]
        rows.append([*patterns, CaptionedTile(_camera_picture(captures, int(k)), said)])
    return contact_sheet(f"{len(captures)} captures", heads, rows, width=420)


def _camera_picture(captures: Captures, k: int) -> NDArray[np.uint8]:
    """A camera image, saturated pixels in red."""
    image, camera = captures.images[k].astype(np.float64), captures.camera
    top = max(float(np.quantile(image, 0.999)) - camera.black_level, 1.0)
    pixels = _grey(np.sqrt(np.clip((image - camera.black_level) / top, 0, 1)))
    pixels[captures.images[k] >= camera.saturation] = (230, 40, 40)
    return pixels


def _grey(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    shades = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    return np.repeat(shades[..., None], 3, axis=-1)
