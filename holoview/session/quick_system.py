"""A simplified system whose image is similar and much faster to compute, for previews during a drag.

It has one sample for each modulator pixel and no padding, which takes a sixteenth of the work or less: light of higher
diffraction orders is aliased, and light that leaves the grid on one side re-enters on the other. If that isn't fast
enough it has three lasers only, with amplitudes that preserve the mean colour.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.optimize import nnls

from holoview.colour import observer_weights
from holoview.model.system import System


def make_quick_system(system: System, most_lasers: int | None = None) -> System:
    """The simplified system; if more than `most_lasers` (frame, laser) pairs are lit, it lights only three."""
    amplitudes = system.amplitudes if most_lasers is None else reduced_amplitudes(system, most_lasers)
    return system.edit({"upsample": 1, "propagation": "periodic", "amplitudes": amplitudes})


def reduced_amplitudes(system: System, most: int) -> NDArray[np.float64]:
    """Amplitudes (frame, wavelength) with three positive entries, if there are more than `most`.

    The three that span the largest gamut are chosen by a pivoted QR decomposition, and their amplitudes by non-negative
    least squares so that the XYZ of a uniform image is preserved: exactly if its colour lies in their gamut.
    """
    lit = np.argwhere(system.amplitudes > 0)
    if len(lit) <= most:
        return system.amplitudes
    weights = observer_weights(system.observer, system.wavelengths_m)
    chosen = lit[_primaries(weights[lit[:, 1]])]
    total_xyz = (system.amplitudes @ weights).sum(axis=0)
    power, _ = nnls(weights[chosen[:, 1]].T, total_xyz)
    amplitudes = np.zeros_like(system.amplitudes)
    amplitudes[chosen[:, 0], chosen[:, 1]] = power
    return amplitudes if np.any(power > 0) else system.amplitudes


def _primaries(weights: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices of three rows of `weights` (XYZ at unit power), each the most independent of those before it."""
    _, _, order = qr(weights.T, pivoting=True)
    return np.asarray(order[: weights.shape[1]], dtype=np.intp)
