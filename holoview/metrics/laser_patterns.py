"""Independent speckle patterns that the lasers, frames and sources of a system contribute, by their brightness.

Patterns of different lasers count as independent and fully developed here, which those of one hologram need not be: the
contrast √(Σm²)/Σm for mean luminances m is the least that they can bring (Goodman, *Speckle Phenomena in Optics*, 2007,
ch. 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from holoview.colour import observer_weights
from holoview.model.system import System

Floats = NDArray[np.float64]


def laser_luminances(system: System) -> Floats:
    """Mean luminance (frame, wavelength) that each laser adds to an evenly lit image: amplitude · Y(λ) / frames."""
    visible = np.maximum(observer_weights(system.observer, system.wavelengths_m)[:, 1], 0.0)
    power: Floats = system.amplitudes / system.frames * visible
    return power


def independent_pattern_count(system: System) -> float:
    """Effective number of independent patterns (Σm)²/Σm², m the mean luminance of each laser, frame and source."""
    means = np.repeat(laser_luminances(system).ravel(), len(system.source.directions_rad)) / len(
        system.source.directions_rad
    )
    return float(means.sum() ** 2 / np.square(means).sum()) if np.any(means > 0) else 1.0


def independent_contrast(system: System) -> float:
    """Luminance contrast of independent patterns, 1/√N with N of `independent_pattern_count`."""
    return float(independent_pattern_count(system) ** -0.5)


def mean_wavelength(system: System) -> float:
    """Mean wavelength in metres, each weighted by its luminance; by nothing if none can be seen."""
    weights = laser_luminances(system).sum(axis=0)
    return float(np.average(system.wavelengths_m, weights=weights if np.any(weights > 0) else None))
