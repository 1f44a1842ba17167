"""The patterns that are sent to a rig's modulators, the settings of its devices, and captures with these settings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.io.hologram import load_hologram
from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts, Levels
from holoview.util.errors import UserError
from holoview.util.text import printable

_REMEDY = "take the bench of the rig (menu Rig), then find patterns for it"


@dataclass(frozen=True, eq=False)
class BenchState:
    """Settings of the devices as they last confirmed them; None where nothing was set yet.

    wavelength_m: of the laser that is on; None while all are off. power: relative, of that laser.
    """

    pattern: SentPattern | None = None
    wavelength_m: float | None = None
    power: float = 0.0
    distance_m: float | None = None
    exposure_s: float | None = None

    @property
    def missing(self) -> str:
        """The next step that is needed before a picture can be predicted, or ""."""
        if self.pattern is None:
            return "send a pattern"
        if self.distance_m is None:
            return "move the stage, so that its place is known"
        if self.exposure_s is None:
            return "set an exposure"
        return "switch a laser on" if self.wavelength_m is None else ""

    def require_all(self) -> None:
        """Raises UserError while a setting is missing."""
        if self.missing:
            raise UserError("capture", "can't be taken yet", remedy=self.missing)

    def capture(self, rig: RigDescription, picture: Counts) -> Captures | None:
        """A picture (y, x) with these settings as a capture; None while a setting is missing."""
        if self.pattern is None or self.distance_m is None or self.exposure_s is None or self.wavelength_m is None:
            return None
        return rig.capture(
            self.pattern.levels,
            picture,
            wavelength_m=self.wavelength_m,
            distance_m=self.distance_m,
            power=self.power,
            exposure_s=self.exposure_s,
            lasers_m=rig.wavelengths_m,
        )


def state_of(capture: Captures, label: str) -> BenchState:
    """The settings with which a capture was taken. label: of its pattern."""
    return BenchState(
        pattern=SentPattern(capture.levels[0], label),
        wavelength_m=float(capture.wavelength_m[0]),
        power=float(capture.power[0]),
        distance_m=float(capture.distance_m[0]),
        exposure_s=float(capture.exposure_s[0]),
    )


@dataclass(frozen=True, eq=False)
class SentPattern:
    """Grey levels (modulator, y, x), and where they come from, in words."""

    levels: Levels
    label: str


def drive_pattern(rig: RigDescription, drive: NDArray[np.floating], label: str) -> SentPattern:
    """A drive (modulator, y, x) in 0…1, rounded to the nearest levels of the rig's modulators.

    Raises UserError where it has another shape.
    """
    shape = (len(rig.bench.slms), *rig.slm_shape)
    if drive.shape != shape:
        found, wanted = (" × ".join(map(str, s)) for s in (drive.shape, shape))
        expected = f"{wanted} (modulator, y, x) as the rig has"
        raise UserError(label, f"patterns of {found}", expected=expected, remedy=_REMEDY)
    highest = np.array([slm.num_levels - 1 for slm in rig.bench.slms])[:, None, None]
    levels = np.rint(np.clip(np.asarray(drive, np.float64), 0.0, 1.0) * highest)
    return SentPattern(levels.astype(rig.levels_type), label)


def random_pattern(rig: RigDescription, sigma_px: float, seed: int) -> SentPattern:
    """Random levels, blurred by a Gaussian of `sigma_px` modulator pixels."""
    levels = rig.random_levels(np.random.default_rng(seed), sigma_px)
    return SentPattern(levels.astype(rig.levels_type), f"random, smooth over {sigma_px:g} px")


def flat_pattern(rig: RigDescription, share: float) -> SentPattern:
    """The same level everywhere, `share` of the highest one."""
    drive = np.full((len(rig.bench.slms), *rig.slm_shape), share)
    return drive_pattern(rig, drive, f"flat, {share:.2f} of the stroke")


def file_pattern(rig: RigDescription, path: Path, frame: int = 0) -> SentPattern:
    """A frame of a hologram file; the last one if it has fewer. Raises UserError."""
    drive = load_hologram(path).drive
    return drive_pattern(rig, drive[min(frame, len(drive) - 1)], printable(path.name))
