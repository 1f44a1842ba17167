"""A simplified system whose image is similar and much faster to compute, for previews during a drag.

It has one sample for each modulator pixel and no padding, which takes a sixteenth of the work or less: light of higher
diffraction orders is aliased, and light that leaves the grid on one side re-enters on the other. If that isn't fast
enough it has three lasers only, with amplitudes that preserve the mean colour. A field keeps its padding: its planes
are often so far away that light would re-enter many times.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from holoview.colour import observer_weights
from holoview.model.system import System


def make_quick_system(system: System, most_lasers: int | None = None) -> System:
    """The simplified system; if more than `most_lasers` (frame, laser) pairs are lit, it lights only three."""
    amplitudes = system.amplitudes if most_lasers is None else reduced_amplitudes(system, most_lasers)
    sampling = {} if system.is_field else {"upsample": 1, "propagation": "periodic"}
    return system.edit({**sampling, "amplitudes": amplitudes})


def reduced_amplitudes(system: System, most: int) -> NDArray[np.float64]:
    """Amplitudes (frame, wavelength) with three positive entries, if there are more than `most`.

    The three that span the largest gamut are chosen one by one, and their amplitudes by non-negative least squares so
    that the XYZ of a uniform image is preserved: exactly if its colour lies in their gamut.
    """
    lit = np.argwhere(system.amplitudes > 0)
    if len(lit) <= most:
        return system.amplitudes
    weights = observer_weights(system.observer, system.wavelengths_m)
    chosen = lit[_primaries(weights[lit[:, 1]])]
    total_xyz = (system.amplitudes @ weights).sum(axis=0)
    power = _nonnegative_powers(weights[chosen[:, 1]], total_xyz)
    amplitudes = np.zeros_like(system.amplitudes)
    amplitudes[chosen[:, 0], chosen[:, 1]] = power
    return amplitudes if np.any(power > 0) else system.amplitudes


def _primaries(weights: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices of three rows of `weights` (XYZ at unit power), each the farthest from the span of those before it.

    They are the first pivots of a QR decomposition with column pivoting.
    """
    chosen: list[int] = []
    left = weights.astype(np.float64)
    for _ in range(weights.shape[1]):
        lengths = np.linalg.norm(left, axis=1)
        lengths[chosen] = -1.0
        chosen.append(int(np.argmax(lengths)))
        direction = left[chosen[-1]] / max(lengths[chosen[-1]], np.finfo(np.float64).tiny)
        left = left - np.outer(left @ direction, direction)
    return np.array(chosen, dtype=np.intp)


def _nonnegative_powers(xyz: NDArray[np.float64], total_xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """The powers p ≥ 0 (laser,) of few lasers for which p·xyz (laser, 3) is the nearest to `total_xyz` (3,).

    Some subset of the lasers is lit, by plain least squares: all subsets are tried.
    """
    best, distance = np.zeros(len(xyz)), float(np.linalg.norm(total_xyz))
    for count in range(1, len(xyz) + 1):
        for subset in combinations(range(len(xyz)), count):
            power = np.zeros(len(xyz))
            power[list(subset)] = np.linalg.lstsq(xyz[list(subset)].T, total_xyz, rcond=None)[0]
            missed = float(np.linalg.norm(total_xyz - power @ xyz))
            if power.min() >= 0 and missed < distance:
                best, distance = power, missed
    return best
