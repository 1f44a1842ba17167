"""Dark frames: the mean of pictures with all lasers off, and what they say of the stated black level and read noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Camera
from holoview.rig.devices import CameraDevice

PICTURES = 16
"""Of which each dark frame is the mean."""

_SAME_EXPOSURE = 1.25  # factor within which two exposures share a dark frame
_LEVEL_COUNTS, _NOISE_FACTOR = 0.5, 1.25  # by which level and noise may differ from those that rig.toml states
_RATE_COUNTS = 0.5  # difference between the longest and the shortest exposure that is told


@dataclass(frozen=True)
class DarkFrame:
    """mean: (y, x), counts, of `pictures` pictures. noise: standard deviation (counts) from picture to picture."""

    exposure_s: float
    mean: NDArray[np.float32]
    noise: float
    pictures: int

    @property
    def level(self) -> float:
        """Counts of a pixel without light, mean over the picture."""
        return float(self.mean.mean(dtype=np.float64))


def take_dark_frame(camera: CameraDevice, exposure_s: float, pictures: int = PICTURES) -> DarkFrame:
    """Averages pictures. The lasers are off."""
    exposure_s = camera.set_exposure(exposure_s)
    total, squares = np.zeros(camera.shape), np.zeros(camera.shape)
    for _ in range(pictures):
        picture = camera.take().astype(np.float64)
        total += picture
        squares += picture**2
    mean = total / pictures
    variance = (squares - pictures * mean**2) / (pictures - 1)
    noise = math.sqrt(max(float(variance.mean()), 0.0))
    return DarkFrame(exposure_s, mean.astype(np.float32), noise, pictures)


def dark_exposures(exposures_s: Sequence[float], there_s: Sequence[float]) -> list[float]:
    """The shortest and the longest of the exposures of a session, unless there are dark frames of about these."""
    wanted: list[float] = []
    for exposure_s in (min(exposures_s, default=0.0), max(exposures_s, default=0.0)):
        known = [*there_s, *wanted]
        if exposure_s > 0 and not any(max(exposure_s / t, t / exposure_s) <= _SAME_EXPOSURE for t in known):
            wanted.append(exposure_s)
    return wanted


def dark_notes(frames: Sequence[DarkFrame], facts: Camera) -> dict[str, str]:
    """In words, what rig.toml states otherwise than the dark frames show, by what it is of: level, noise, growth."""
    notes: dict[str, str] = {}
    if not frames:
        return notes
    ordered = sorted(frames, key=lambda frame: frame.exposure_s)
    shortest, longest = ordered[0], ordered[-1]
    if abs(shortest.level - facts.black_level) > _LEVEL_COUNTS:
        stated = f"rig.toml states black_level = {facts.black_level:g}"
        notes["level"] = f"dark pictures have {shortest.level:.1f} counts, but {stated}"
    if not 1 / _NOISE_FACTOR <= shortest.noise / facts.dark_noise <= _NOISE_FACTOR:
        measured = math.sqrt(max(shortest.noise**2 - 1 / 12, 0.0)) * facts.electrons_per_count
        stated = f"a read noise of {measured:.2g} electrons, but rig.toml states read_noise = {facts.read_noise:g}"
        notes["noise"] = f"dark pictures vary by {shortest.noise:.2g} counts, which is {stated}"
    grown = longest.level - shortest.level
    if abs(grown) > _RATE_COUNTS and longest.exposure_s > shortest.exposure_s:
        rate = grown / (longest.exposure_s - shortest.exposure_s)
        reason = "dark current, or light beside the lasers'"
        notes["growth"] = f"dark pictures grow by {rate:.2g} counts a second: {reason}"
    return notes
