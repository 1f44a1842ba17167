"""Illumination: a plane wave with its own phase slope for each source direction and wavelength."""

from __future__ import annotations

import math

import torch

from holoview.plan import Plan


def plane_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """exp(2πi·(s_y·y + s_x·x)) on the first modulator, shape (y, x), with |field| = 1.

    The slopes s (turns a sample) come from the plan; positions count from the grid's centre, (N − 1)/2.
    """
    slopes = plan.slopes[source, wavelength]
    y, x = (_turns(n, float(slope), device) for n, slope in zip(plan.grid.shape, slopes, strict=True))
    phase = 2 * math.pi * (y[:, None] + x[None, :])
    return torch.polar(torch.ones_like(phase), phase).to(dtype)


def _turns(n: int, slope: float, device: torch.device) -> torch.Tensor:
    turns = (torch.arange(n, dtype=torch.float64) - (n - 1) / 2) * slope
    return torch.remainder(turns, 1.0).to(device)
