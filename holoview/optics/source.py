"""Illumination: a plane wave with its own phase slope for each source direction and wavelength."""

from __future__ import annotations

import math

import torch

from holoview.plan import Plan


def plane_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """exp(2πi·(s_y·y + s_x·x)) on the first modulator, shape (y, x), with |field| = 1.

    The slopes s (turns a sample) come from the plan; positions count from the grid's centre, (N − 1)/2.
    """
    sides = zip(plan.grid.shape, plan.slopes[source, wavelength], strict=True)
    y, x = (_wave(n, float(slope), device) for n, slope in sides)
    return (y[:, None] * x[None, :]).to(dtype)


def _wave(n: int, slope: float, device: torch.device) -> torch.Tensor:
    """exp(2πi·slope·position) along one side, (n,) complex128: the wave over both sides is a product of two."""
    turns = (torch.arange(n, dtype=torch.float64) - (n - 1) / 2) * slope
    phase = (2 * math.pi) * torch.remainder(turns, 1.0)
    return torch.polar(torch.ones_like(phase), phase).to(device)
