"""Captures that aren't what their records say: what is told of one, and those that need no model to be found.

Dark and saturated pictures show nothing. A picture that is given twice with the same record counts once: a copy that is
held out would confirm whatever fits the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.diagnose.config import JudgementConfig

DARK, SATURATED, DUPLICATE = "dark", "saturated", "duplicate"
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class BadCapture:
    """A capture that was left out.

    index: in the session, from 0. why: the reason in a few words. sentence: the same with what was measured.
    """

    index: int
    why: str
    sentence: str


def find_useless_captures(captures: Captures, config: JudgementConfig) -> tuple[BadCapture, ...]:
    """Captures that are dark, saturated, or copies of an earlier one, by index."""
    found: dict[int, BadCapture] = {}
    light = captures.images.mean(axis=(1, 2)) - captures.camera.black_level
    for k in np.flatnonzero(_is_dark(captures, light, config)).tolist():
        found[k] = BadCapture(k, DARK, f"Its mean light is {light[k]:.2g} counts above black.")
    saturated = np.array([float((image >= captures.camera.saturation).mean()) for image in captures.images])
    limit = max(config.saturated_share, config.saturated_factor * float(np.median(saturated)))
    for k in np.flatnonzero(saturated > limit).tolist():
        found.setdefault(k, BadCapture(k, SATURATED, f"{saturated[k]:.0%} of its pixels are saturated."))
    for first, *copies in equal_pictures(captures):
        for k in copies:
            if has_same_record(captures, first, k):
                found.setdefault(k, BadCapture(k, DUPLICATE, f"It is capture {first} once more, which counts once."))
    return tuple(found[k] for k in sorted(found))


def equal_pictures(captures: Captures) -> list[list[int]]:
    """Groups of two or more captures whose pictures are equal, count by count."""
    groups: dict[bytes, list[int]] = {}
    for k, image in enumerate(captures.images):
        groups.setdefault(sha256(image.tobytes()).digest(), []).append(k)
    return [group for group in groups.values() if len(group) > 1]


def has_same_record(captures: Captures, first: int, second: int) -> bool:
    """Whether two captures have the same patterns, wavelength and distance."""
    same = (captures.levels, captures.wavelength_m, captures.distance_m)
    return all(np.array_equal(column[first], column[second]) for column in same)


def bad_share(bad: Sequence[BadCapture], count: int) -> float:
    """Share of the bad ones among `count` captures of which copies count once."""
    copies = sum(b.why == DUPLICATE for b in bad)
    return (len(bad) - copies) / max(count - copies, 1)


def _is_dark(captures: Captures, light: Floats, config: JudgementConfig) -> NDArray[np.bool_]:
    """Whether each capture is without light, or dimmer than others and without structure: noise at a black level."""
    variance = np.array([float(image.var(dtype=np.float64)) for image in captures.images])
    is_flat = variance < config.flat_variance * captures.camera.noise_variance(light)
    noise = captures.camera.dark_noise / np.sqrt(captures.images[0].size)
    dark = light < config.dark_sigmas * noise
    response = light / (captures.power * captures.exposure_s)
    for wavelength in captures.wavelengths_m:
        same = captures.wavelength_m == wavelength
        usual = float(np.median(response[same]))
        dark |= same & (response < config.dark_share * usual)
        dark |= same & is_flat & (response < config.dim_share * usual)
    return np.asarray(dark, dtype=bool)
