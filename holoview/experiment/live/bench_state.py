"""What a rig's devices are set to, and a picture as the capture that it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from holoview.captures.dataset import Captures
from holoview.experiment.live.sent_pattern import SentPattern
from holoview.rig.description import RigDescription
from holoview.rig.devices import Counts
from holoview.util.errors import UserError


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
        """What is to be done before a picture can be predicted, or ""."""
        if self.pattern is None:
            return "send a pattern"
        if self.distance_m is None:
            return "move the stage, so that its place is known"
        if self.exposure_s is None:
            return "set an exposure"
        return "switch a laser on" if self.wavelength_m is None else ""

    def require_all(self) -> None:
        """Raises UserError while something is missing."""
        if self.missing:
            raise UserError("capture", "can't be taken yet", remedy=self.missing)

    def capture(self, rig: RigDescription, picture: Counts) -> Captures | None:
        """A picture (y, x) with these settings as a session of one capture; None while something is missing."""
        if self.pattern is None or self.distance_m is None or self.exposure_s is None or self.wavelength_m is None:
            return None
        return Captures(
            levels=self.pattern.levels[None],
            images=picture[None],
            wavelength_m=np.array([self.wavelength_m]),
            distance_m=np.array([self.distance_m]),
            power=np.array([self.power]),
            exposure_s=np.array([self.exposure_s]),
            lasers_m=rig.wavelengths_m,
            **rig.bench.as_fields(),
        )


def state_of(capture: Captures, label: str) -> BenchState:
    """The settings with which the only capture of a session was taken. label: of its pattern."""
    return BenchState(
        pattern=SentPattern(capture.levels[0], label),
        wavelength_m=float(capture.wavelength_m[0]),
        power=float(capture.power[0]),
        distance_m=float(capture.distance_m[0]),
        exposure_s=float(capture.exposure_s[0]),
    )
