"""Lasers that drift from capture to capture: a nuisance like jitter of exposures, as long as the drift has no
direction.

Each capture may choose its own wavelength among a few near the nominal one. Slopes wouldn't do: a small drift moves the
edge of an iris over whole samples. Drift is nobody's fault where it takes the residuals to the noise and its mean
doesn't stand out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.significance import mean_is_significant

DRIFTING, _PARAMETER = "wavelength_offset", "offset"
_STEPS_M = 0.02e-9 * np.arange(-10, 11)  # beyond, it is no drift
_CHANCE = 1e-3  # that drift without a direction has such a mean


@dataclass(frozen=True)
class LaserDrift:
    """R.m.s. drift (m) over the captures, χ²/n once each capture has its own, and whether they drift the same way."""

    rms_m: float
    chi2_per_pixel: float
    is_systematic: bool


def estimate_laser_drift(comparison: Comparison, values: FittedValues) -> LaserDrift:
    """What is left when each capture has the wavelength that suits it best."""
    known = values.get(DRIFTING, {})
    at = [
        comparison.fit_gains(
            {**values, DRIFTING: {**known, _PARAMETER: known.get(_PARAMETER, 0.0) + float(step)}}
        ).squares
        for step in _STEPS_M
    ]
    chosen = np.argmin(at, axis=0)
    drifts = _STEPS_M[chosen]
    return LaserDrift(
        rms_m=float(np.sqrt(np.mean(np.square(drifts)))),
        chi2_per_pixel=float(np.min(at, axis=0).sum() / comparison.pixel_count),
        is_systematic=bool(mean_is_significant(drifts, _CHANCE)),
    )
