"""Laser amplitudes by non-negative least squares, since the image is linear in them.

    minimise Σ_{plane, channel, pixel} (Σ_j a_j·M_jc·I_j − T_c)²   over a ≥ 0

with the intensity I_j of laser j at unit amplitude, its colour M_jc and the target T_c. Only the Gram matrix
G_ij = (I_i·I_j)(M_i·M_j) and the right-hand side b_i = Σ_c M_ic (I_i·T_c) are needed; both are accumulated part by
part. In a process group, each process fills the rows of its own lasers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

from holoview.optimise.process_group import SINGLE_PROCESS, ProcessGroup

Tensor = torch.Tensor
Floats = NDArray[np.float64]

# Intensities of neighbouring wavelengths are nearly parallel, and rounding makes their float32 Gram matrix indefinite:
# eigenvalues below this fraction of the largest are raised to it.
_EIGENVALUE_FLOOR = 1e-6


@dataclass(frozen=True)
class NormalEquations:
    """The rows of own lasers, for some samples: gram (own laser, laser) and right_hand_side (own laser,)."""

    gram: Floats
    right_hand_side: Floats


class AmplitudeLeastSquares:
    """Accumulates the normal equations part by part.

    laser_channels (laser, channel): what each laser of the whole process group adds to the image at unit amplitude and
    intensity.
    """

    def __init__(self, laser_channels: Floats, group: ProcessGroup = SINGLE_PROCESS) -> None:
        count = len(laser_channels)
        self._laser_channels, self._group = laser_channels, group
        self._own_rows = group.shard(count)
        self._gram, self._right_hand_side = np.zeros((count, count)), np.zeros(count)

    def normal_equations(self, intensity: Tensor, target: Tensor) -> NormalEquations:
        """What samples add: intensity (own laser, …) at unit amplitude, target (channel, …) of equal trailing shape."""
        own_images, target_channels = intensity.flatten(1), target.flatten(1)
        gram = np.zeros((len(own_images), len(self._laser_channels)))
        for columns, images in self._group.broadcast_shards(own_images, len(self._laser_channels)):
            gram[:, columns] = (own_images @ images.T).cpu().double().numpy()
        products = (own_images @ target_channels.T).cpu().double().numpy()
        return NormalEquations(gram, np.einsum("lc,lc->l", self._laser_channels[self._own_rows], products))

    def add(self, part: NormalEquations, weight: float = 1.0) -> None:
        """Adds a part of the samples."""
        self._gram[self._own_rows] += weight * part.gram
        self._right_hand_side[self._own_rows] += weight * part.right_hand_side

    def all_reduce(self) -> None:
        """Gives every process all rows; to be called after the last part."""
        self._group.all_reduce_sum(torch.from_numpy(self._gram), torch.from_numpy(self._right_hand_side))

    @property
    def is_dark(self) -> bool:
        """Whether no laser gives any light in any plane."""
        return not np.any(self._gram)

    def solve(self) -> Floats:
        """The amplitudes (laser,) ≥ 0 for which the sum of the lasers' images is nearest to the target."""
        return _solve_nnls(self._gram * (self._laser_channels @ self._laser_channels.T), self._right_hand_side)


def _solve_nnls(gram: Floats, right_hand_side: Floats) -> Floats:
    """argmin over a ≥ 0 of aᵀGa − 2bᵀa by NNLS on a square root of G, scaled so that its diagonal is 1; 0 for G = 0."""
    if not np.any(gram):
        return np.zeros_like(right_hand_side)
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / scale[:, None] / scale[None, :])
    values = np.maximum(values, _EIGENVALUE_FLOOR * values[-1])
    root = np.sqrt(values)[:, None] * vectors.T
    amplitudes, _ = nnls(root, (vectors.T @ (right_hand_side / scale)) / np.sqrt(values))
    return np.asarray(amplitudes) / scale
