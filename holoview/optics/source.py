"""Tilted plane waves that illuminate the first modulator, one for each direction of the source and wavelength."""

from __future__ import annotations

import torch

from holoview.model.plan import Plan
from holoview.numerics.phasor import phasor_of_turns
from holoview.numerics.resample import centred_indices


def plane_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """exp(2πi·(s_y·y + s_x·x)) at the samples of the first modulator, (y, x) complex with modulus 1.

    The slopes s (turns a sample) are `plan.slopes`; positions count from the grid's centre, (N − 1)/2.
    """
    return _wave(plan, wavelength, source, 1).to(dtype).to(device)


def pixel_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """The plane wave at the first sample of each modulator pixel, (rows, columns) complex."""
    return _wave(plan, wavelength, source, plan.grid.upsample).to(dtype).to(device)


def _wave(plan: Plan, wavelength: int, source: int, stride: int) -> torch.Tensor:
    """The wave at every `stride`-th sample, complex128: the product of a column and a row."""
    column, row = (
        phasor_of_turns(centred_indices(n, torch.float64, torch.device("cpu"))[::stride] * float(slope))
        for n, slope in zip(plan.grid.shape, plan.slopes[source, wavelength], strict=True)
    )
    return column[:, None] * row[None, :]
