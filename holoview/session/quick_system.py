"""A cheaper bench whose image is close to the real one's: what is shown while a hand drags, until it rests.

One sample a modulator pixel and no padding: the light of higher orders folds back and what leaves on one side comes in
on the other, for a sixteenth of the work or less. Fewer lasers, where that isn't cheap enough: their power is shared
out anew so that white stays white.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.optimize import nnls

from holoview.colour import observer_weights
from holoview.model.system import System


def make_quick_system(system: System, most_lasers: int | None = None) -> System:
    """The cheaper bench; where more than `most_lasers` of its (frame, laser) pairs are lit, only three are."""
    amplitudes = system.amplitudes if most_lasers is None else reduced_amplitudes(system, most_lasers)
    return system.edit({"upsample": 1, "propagation": "periodic", "amplitudes": amplitudes})


def reduced_amplitudes(system: System, most: int) -> NDArray[np.float64]:
    """Amplitudes (frame, wavelength) with three entries above zero where more than `most` are; nearly the same XYZ.

    Those that span the most colours are kept, so that the image has all of its hues, and the XYZ of an evenly lit one
    is matched as well as non-negative power can: exactly where the three surround its colour.
    """
    lit = np.argwhere(system.amplitudes > 0)
    if len(lit) <= most:
        return system.amplitudes
    weights = observer_weights(system.observer, system.wavelengths_m)
    chosen = lit[_primaries(weights[lit[:, 1]])]
    wanted = (system.amplitudes @ weights).sum(axis=0)
    power, _ = nnls(weights[chosen[:, 1]].T, wanted)
    amplitudes = np.zeros_like(system.amplitudes)
    amplitudes[chosen[:, 0], chosen[:, 1]] = power
    return amplitudes if np.any(power > 0) else system.amplitudes


def _primaries(weights: NDArray[np.float64]) -> NDArray[np.intp]:
    """Three rows (XYZ of lasers at unit power), each the most different from those before it."""
    _, _, order = qr(weights.T, pivoting=True)
    return np.asarray(order[: weights.shape[1]], dtype=np.intp)
