"""Laser amplitudes in closed form: the image is linear in them, so they are a non-negative least-squares problem.

    minimise Σ_{plane, channel, pixel} (Σ_j a_j·M_jc·I_j − T_c)²   over a ≥ 0

Only the Gram matrix G_ij = (I_i·I_j)(M_i·M_j) and b_i = Σ_c M_ic (I_i·T_c) are needed, added up plane by plane. Of a
team, every process fills the rows of its lasers.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

from holoview.optimise.process_group import SINGLE_PROCESS, ProcessGroup

Tensor = torch.Tensor
Floats = NDArray[np.float64]

# Intensities of close wavelengths are nearly parallel, and a float32 Gram matrix of them isn't positive definite:
# its eigenvalues are kept above this share of the largest.
_EIGEN_FLOOR = 1e-6


class AmplitudeLeastSquares:
    """Gathers the planes; colours (laser, channel) are those of unit amplitude and intensity, of everybody's lasers."""

    def __init__(self, laser_channels: Floats, group: ProcessGroup = SINGLE_PROCESS) -> None:
        self._laser_channels, self._group = laser_channels, group
        self._own_rows = group.shard(len(laser_channels))
        self._gram, self._right_hand_side = (
            np.zeros((len(laser_channels), len(laser_channels))),
            np.zeros(len(laser_channels)),
        )

    def add_plane(self, intensity: Tensor, target: Tensor, weight: float = 1.0) -> None:
        """Adds a plane: intensity (own laser, …) at unit amplitude and target (channel, …) of equal trailing shape."""
        images, wanted = intensity.flatten(1), target.flatten(1)
        for theirs, others in self._group.broadcast_shards(images, len(self._laser_channels)):
            self._gram[self._own_rows, theirs] += weight * (images @ others.T).cpu().double().numpy()
        seen = (images @ wanted.T).cpu().double().numpy()
        self._right_hand_side[self._own_rows] += weight * np.einsum(
            "lc,lc->l", self._laser_channels[self._own_rows], seen
        )

    def all_reduce(self) -> None:
        """Gives everybody all rows, when all planes are there."""
        self._group.all_reduce_sum(torch.from_numpy(self._gram), torch.from_numpy(self._right_hand_side))

    @property
    def is_dark(self) -> bool:
        """Whether no laser gives any light in any plane."""
        return not np.any(self._gram)

    def solve(self) -> Floats:
        """Amplitudes (laser,) ≥ 0 that bring the sum of the lasers' images nearest to the target."""
        return _solve_nnls(self._gram * (self._laser_channels @ self._laser_channels.T), self._right_hand_side)


def _solve_nnls(gram: Floats, right_hand_side: Floats) -> Floats:
    """argmin over a ≥ 0 of aᵀGa − 2bᵀa, by NNLS on a square root of G, in units where G's diagonal is 1.

    Where no laser gives any light, none is on.
    """
    if not np.any(gram):
        return np.zeros_like(right_hand_side)
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / scale[:, None] / scale[None, :])
    values = np.maximum(values, _EIGEN_FLOOR * values[-1])
    root = np.sqrt(values)[:, None] * vectors.T
    amplitudes, _ = nnls(root, (vectors.T @ (right_hand_side / scale)) / np.sqrt(values))
    return np.asarray(amplitudes) / scale
