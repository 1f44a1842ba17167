"""Laser amplitudes in closed form: the image is linear in them, so they are a non-negative least-squares problem.

    minimise Σ_{plane, channel, pixel} (Σ_j a_j·M_jc·I_j − T_c)²   over a ≥ 0

Only the Gram matrix G_ij = (I_i·I_j)(M_i·M_j) and b_i = Σ_c M_ic (I_i·T_c) are needed.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

Tensor = torch.Tensor

# Intensities of close wavelengths are nearly parallel, and a float32 Gram matrix of them isn't positive definite:
# its eigenvalues are kept above this share of the largest.
_EIGEN_FLOOR = 1e-6


def solve_amplitudes(intensities: list[Tensor], colours: Tensor, target: Tensor) -> NDArray[np.float64]:
    """Amplitudes (laser,) ≥ 0 that bring the sum of the lasers' images nearest to the target.

    intensities: one (plane, y, x) a laser at unit amplitude; colours (laser, channel); target (plane, channel, y, x).
    """
    count, planes = len(intensities), len(target)
    gram, right = np.zeros((count, count)), np.zeros(count)
    weights = colours.double().cpu().numpy()
    for plane in range(planes):
        images = torch.stack([intensity[plane].flatten() for intensity in intensities])
        wanted = target[plane].flatten(1)
        gram += (images @ images.T).double().cpu().numpy()
        right += np.einsum("lc,lc->l", weights, (images @ wanted.T).double().cpu().numpy())
    return _non_negative(gram * (weights @ weights.T), right)


def _non_negative(gram: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """argmin over a ≥ 0 of aᵀGa − 2bᵀa, by NNLS on a square root of G, in units where G's diagonal is 1.

    Where no laser gives any light, none is on.
    """
    if not np.any(gram):
        return np.zeros_like(right)
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / scale[:, None] / scale[None, :])
    values = np.maximum(values, _EIGEN_FLOOR * values[-1])
    root = np.sqrt(values)[:, None] * vectors.T
    amplitudes, _ = nnls(root, (vectors.T @ (right / scale)) / np.sqrt(values))
    return np.asarray(amplitudes) / scale
