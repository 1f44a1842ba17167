"""What slowly changes on a bench while hours pass: the camera's place and the lasers' power, as random walks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_HOUR_S = 3600.0


@dataclass(frozen=True)
class DriftSettings:
    """Standard deviations after an hour. camera_m: of its place, in y and in x. power: of the power's logarithm."""

    camera_m: float = 0.0
    power: float = 0.0


class Drift:
    """Random walks (Wiener processes): their variances grow with the time on the bench.

    camera_m: shift (y, x) of the camera. power: factor of the lasers' light.
    """

    def __init__(self, settings: DriftSettings, rng: np.random.Generator) -> None:
        self._settings, self._rng, self._time_s = settings, rng, 0.0
        self._walk = np.zeros(3)

    def advance(self, time_s: float) -> None:
        """Goes on to this time on the bench."""
        if time_s > self._time_s and (self._settings.camera_m or self._settings.power):
            self._walk += math.sqrt((time_s - self._time_s) / _HOUR_S) * self._rng.standard_normal(3)
        self._time_s = max(time_s, self._time_s)

    @property
    def camera_m(self) -> tuple[float, float]:
        y, x, _ = self._settings.camera_m * self._walk
        return float(y), float(x)

    @property
    def power(self) -> float:
        return math.exp(self._settings.power * float(self._walk[2]))
