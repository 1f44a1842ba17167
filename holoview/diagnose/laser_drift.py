"""Lasers whose wavelengths drift from capture to capture, a nuisance as long as the drift has no direction.

Each capture chooses its own wavelength among a few near the nominal one. Derivatives wouldn't do: a small drift moves
the edge of an iris over whole samples. Drift is no fault where it takes the residuals to the noise and its mean isn't
significant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from holoview.diagnose.comparison import Comparison
from holoview.diagnose.config import LaserDriftConfig
from holoview.diagnose.free_parameters import FittedValues
from holoview.diagnose.significance import mean_is_significant

DRIFT_EFFECT, _PARAMETER = "wavelength_offset", "offset"


@dataclass(frozen=True)
class LaserDrift:
    """R.m.s. drift (m) over the captures, χ²/n with a wavelength for each capture, and whether the mean stands out."""

    rms_m: float
    chi2_per_pixel: float
    is_systematic: bool


def estimate_laser_drift(comparison: Comparison, values: FittedValues, config: LaserDriftConfig) -> LaserDrift:
    """The wavelength that suits each capture best, and what is left with it."""
    known = values.get(DRIFT_EFFECT, {})
    offsets_m = config.step_m * np.arange(-config.steps, config.steps + 1)
    squares = [
        comparison.fit_gains(
            {**values, DRIFT_EFFECT: {**known, _PARAMETER: known.get(_PARAMETER, 0.0) + float(offset)}}
        ).squares
        for offset in offsets_m
    ]
    drifts = offsets_m[np.argmin(squares, axis=0)]
    return LaserDrift(
        rms_m=float(np.sqrt(np.mean(np.square(drifts)))),
        chi2_per_pixel=float(np.min(squares, axis=0).sum() / comparison.pixel_count),
        is_systematic=bool(mean_is_significant(drifts, config.p_value)),
    )
