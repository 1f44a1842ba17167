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
from holoview.diagnose.direction import stands_out
from holoview.diagnose.unknowns import Found

DRIFTING, _PARAMETER = "wavelength_offset", "offset"
_STEPS_M = 0.02e-9 * np.arange(-10, 11)  # beyond, it is no drift
_CHANCE = 1e-3  # that drift without a direction has such a mean


@dataclass(frozen=True)
class Drift:
    """R.m.s. drift (m) over the captures, χ²/n once each capture has its own, and whether they drift the same way."""

    rms_m: float
    chi2: float
    has_direction: bool


def drift(comparison: Comparison, values: Found) -> Drift:
    """What is left when each capture has the wavelength that suits it best."""
    known = values.get(DRIFTING, {})
    at = [
        comparison.fit({**values, DRIFTING: {**known, _PARAMETER: known.get(_PARAMETER, 0.0) + float(step)}}).squares
        for step in _STEPS_M
    ]
    chosen = np.argmin(at, axis=0)
    drifts = _STEPS_M[chosen]
    return Drift(
        rms_m=float(np.sqrt(np.mean(np.square(drifts)))),
        chi2=float(np.min(at, axis=0).sum() / comparison.count),
        has_direction=bool(stands_out(drifts, _CHANCE)),
    )
