"""Angular-spectrum propagation: the transfer function of a Plan's `Transfer`, evaluated in float64.

H = exp(−2πi·(z/λ)·A/(1 + √(1 − A))), A = |λu|² (Goodman, Introduction to Fourier Optics, 3rd ed., eq. 3-74, without the
carrier exp(2πi·z/λ)). This form has no cancellation at small A, where √(1 − A) − 1 would lose every digit.
"""

from __future__ import annotations

import math

import torch

from holoview.grid import frequency_indices
from holoview.plan import Grid, Transfer


def transfer_function(transfer: Transfer, grid: Grid, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """H at every frequency of the padded grid, (P_y, P_x) complex, zero where the support stops the light."""
    ky, kx = (torch.from_numpy(frequency_indices(p)).to(device) for p in grid.padded)
    step_y, step_x = transfer.sine_step
    a = (step_y * ky.double()).square()[:, None] + (step_x * kx.double()).square()[None, :]
    turns = -transfer.waves * a / (1 + torch.sqrt((1 - a).clamp_min(0)))
    phase = (2 * math.pi) * torch.remainder(turns, 1.0)
    return torch.polar(support_mask(transfer, kx.abs()).double(), phase).to(dtype)


def support_mask(transfer: Transfer, abs_kx: torch.Tensor) -> torch.Tensor:
    """(P_y, P_x) bool: which frequencies pass, from the plan's rows of (smallest, largest) |k_x|."""
    rows = torch.from_numpy(transfer.support).to(abs_kx.device)
    return (abs_kx[None, :] >= rows[:, :1]) & (abs_kx[None, :] <= rows[:, 1:])
