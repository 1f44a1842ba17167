"""Illumination: a plane wave with its own phase slope for each source direction and wavelength."""

from __future__ import annotations

import math

import torch

from holoview.model.plan import Plan


def plane_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """exp(2πi·(s_y·y + s_x·x)) on the first modulator, shape (y, x), with |field| = 1.

    The slopes s (turns a sample) come from the plan; positions count from the grid's centre, (N − 1)/2.
    """
    return _wave(plan, wavelength, source, 1).to(dtype).to(device)


def pixel_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """The plane wave at the first sample of each modulator pixel, (rows, columns)."""
    return _wave(plan, wavelength, source, plan.grid.upsample).to(dtype).to(device)


def _wave(plan: Plan, wavelength: int, source: int, every: int) -> torch.Tensor:
    """The wave at every so many samples, complex128: a product of a column and a row."""
    sides = []
    for n, slope in zip(plan.grid.shape, plan.slopes[source, wavelength], strict=True):
        turns = (torch.arange(0, n, every, dtype=torch.float64) - (n - 1) / 2) * float(slope)
        phase = (2 * math.pi) * torch.remainder(turns, 1.0)
        sides.append(torch.polar(torch.ones_like(phase), phase))
    return sides[0][:, None] * sides[1][None, :]
