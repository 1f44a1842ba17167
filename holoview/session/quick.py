"""A cheaper bench whose image is close to the real one's: what is shown while a hand drags, until it rests.

One sample a modulator pixel and no padding: the light of higher orders folds back and what leaves on one side comes in
on the other, for a sixteenth of the work or less. Fewer lasers, where that isn't cheap enough: their power is shared
out anew so that white stays white.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from holoview.colour import observer_weights
from holoview.system import System


def quick_version(system: System, most_lasers: int | None = None) -> System:
    """The cheaper bench; with `most_lasers`, at most so many of its (frame, laser) pairs are lit, spread evenly."""
    amplitudes = system.amplitudes if most_lasers is None else fewer_lasers(system, most_lasers)
    return system.edit({"upsample": 1, "propagation": "periodic", "amplitudes": amplitudes})


def fewer_lasers(system: System, most: int) -> NDArray[np.float64]:
    """Amplitudes (frame, wavelength) with at most `most` entries above zero and nearly the XYZ of all of them.

    The XYZ of an evenly lit image is matched as well as non-negative power can: exactly with three or more lasers that
    surround its colour.
    """
    lit = np.argwhere(system.amplitudes > 0)
    if len(lit) <= most:
        return system.amplitudes
    lit = lit[np.argsort(system.wavelengths_m[lit[:, 1]], kind="stable")]
    middles = (np.arange(most) + 0.5) * len(lit) / most
    chosen = lit[middles.astype(int)]
    weights = observer_weights(system.observer, system.wavelengths_m)
    wanted = (system.amplitudes @ weights).sum(axis=0)
    power, _ = nnls(weights[chosen[:, 1]].T, wanted)
    amplitudes = np.zeros_like(system.amplitudes)
    amplitudes[chosen[:, 0], chosen[:, 1]] = power
    return amplitudes if np.any(power > 0) else system.amplitudes
