"""The table of an amplitude modulator from the light that it lets through at each of its levels.

A modulator whose pixels all show one level multiplies the whole field by one number, so that a picture's light is as
the square of the amplitude at this level, wherever the camera stands:

    t(level) = √(light at the level / light at the last level),   t never falling
    t = black + (1 − black)·share,   share = x^gamma of x = level/last, as far as one exponent tells
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression, least_squares

from holoview.util.errors import UserError

Floats = NDArray[np.float64]
FORMAT, VERSION = "holoview-amplitudes", 1
_WORST = 0.02  # of the last level's amplitude, that a table that never falls may leave
_LEAST_RISE = 1e-9  # of the range, from a level to the next
_SEEN = 2.0  # standard deviations from which black pixels' light is seen


@dataclass(frozen=True, eq=False)
class AmplitudeTable:
    """The amplitude at each level.

    levels: (n,), ascending. amplitude: (n,), over that at the last level, never falling. black, black_deviation: light
    at level 0 over that at the last one, and its standard deviation. gamma: exponent of the response. residual: r.m.s.
    of what the table leaves of the measured amplitudes.
    """

    levels: NDArray[np.int64]
    amplitude: Floats
    black: float
    black_deviation: float
    gamma: float
    residual: float

    @property
    def is_black_seen(self) -> bool:
        """Whether the light of black pixels stands out of the noise."""
        return self.black > _SEEN * self.black_deviation

    @property
    def shares(self) -> Floats:
        """The share of the range that each level from 0 to the last one shows; linear between those that were sent.

        They rise, as a preset's levels do: where neighbours let equal light through, by a billionth for each level.
        """
        low, every = float(self.amplitude[0]), np.arange(self.levels[-1] + 1)
        shares = np.asarray((np.interp(every, self.levels, self.amplitude) - low) / (1 - low))
        if np.diff(shares).min() < _LEAST_RISE:
            shares = shares + _LEAST_RISE * every
        return np.asarray(shares / shares[-1])

    @property
    def as_toml(self) -> dict[str, Any]:
        """Its numbers; `range` and `levels` as a preset's amplitude modulator has them. sent: the measured levels."""
        return {
            "range": [float(self.amplitude[0]), 1.0],
            "levels": self.shares.tolist(),
            "sent": self.levels.tolist(),
            "black": self.black,
            "black_deviation": self.black_deviation,
            "gamma": self.gamma,
            "residual": self.residual,
        }

    @property
    def lines(self) -> list[str]:
        """The table in words."""
        black, deviation = self.black, self.black_deviation
        seen = f"black pixels let {100 * black:.3g} ± {100 * deviation:.1g} % of the light through"
        if self.is_black_seen:
            contrast = f"{seen}: a contrast of {1 / black:.3g} ± {deviation / black**2:.1g} to 1"
        else:
            contrast = f"{seen}: a contrast above {1 / (max(black, 0.0) + _SEEN * deviation):.3g} to 1"
        half = float(np.interp(0.5 * self.levels[-1], self.levels, self.amplitude))
        return [
            contrast,
            f"half drive gives {half:.3f} of the amplitude: a gamma of {self.gamma:.3f}",
            f"residual {self.residual:.2g} of the last level's amplitude",
        ]


def fit_amplitudes(light: Mapping[int, float], deviation: Mapping[int, float], name: str) -> AmplitudeTable:
    """The table of measured light. light, deviation: by level, 0 and the last among them, in any unit.

    name: of the readings, for messages. Raises UserError where the light doesn't rise with the level.
    """
    levels = np.array(sorted(light))
    power = np.array([light[level] for level in levels.tolist()])
    top = float(power[-1])
    if not top > _SEEN * deviation[int(levels[-1])] or power[0] >= top:
        found = "the last level lets no more light through than level 0"
        raise UserError(name, found, expected="light that rises with the level", remedy="look at the levels' order")
    measured = np.sqrt(np.maximum(power / top, 0.0))
    amplitude = np.asarray(isotonic_regression(measured).x, dtype=np.float64)
    amplitude = amplitude / amplitude[-1]
    residual = float(np.sqrt(np.mean((measured - amplitude) ** 2)))
    if residual > _WORST:
        found = f"amplitudes fall and rise with the level by {residual:.2g} of the last one"
        raise UserError(name, found, expected="amplitudes that never fall", remedy="measure again with steadier light")
    black = float(power[0]) / top
    return AmplitudeTable(levels, amplitude, black, deviation[0] / top, _gamma(levels, amplitude), residual)


def _gamma(levels: NDArray[np.int64], amplitude: Floats) -> float:
    """The exponent that describes the rise from black to white best; 1 for two levels."""
    share, low = levels / levels[-1], float(amplitude[0])
    if len(levels) < 3:
        return 1.0
    found = least_squares(lambda x: low + (1 - low) * share ** np.exp(x[0]) - amplitude, [0.0])
    return float(np.exp(found.x[0]))
