"""Tilted plane waves that illuminate the first modulator, one for each direction of the source and wavelength."""

from __future__ import annotations

import torch

from holoview.model.plan import Plan
from holoview.numerics.fourier import phasor_of_turns
from holoview.numerics.resample import centred_indices


def plane_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """exp(2πi·(s_y·y + s_x·x)) at the samples of the first modulator, (y, x) complex with modulus 1.

    The slopes s (turns a sample) are `plan.slopes`; positions count from the grid's centre, (N − 1)/2.
    """
    column, row = wave_axes(plan, wavelength, source, 1)
    return (column[:, None] * row[None, :]).to(dtype).to(device)


def pixel_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """The plane wave at the first sample of each modulator pixel, (rows, columns) complex."""
    column, row = wave_axes(plan, wavelength, source, plan.grid.upsample)
    return (column[:, None] * row[None, :]).to(dtype).to(device)


def wave_axes(plan: Plan, wavelength: int, source: int, stride: int) -> tuple[torch.Tensor, torch.Tensor]:
    """The plane wave at every `stride`-th sample, whose product over the axes (y, x) it is: two complex128 vectors."""
    column, row = (
        phasor_of_turns(centred_indices(n, torch.float64, torch.device("cpu"))[::stride] * float(slope))
        for n, slope in zip(plan.grid.shape, plan.slopes[source, wavelength], strict=True)
    )
    return column, row
