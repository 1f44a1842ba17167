"""Phase modulator: drive → quantised optical path → complex transmission; its square pixels on the simulation grid.

The phase is 2π·opd/λ. The optical path of a drive doesn't depend on the wavelength, so that the phase scales as 1/λ.

The first diffraction order of a modulator, |f| ≤ 1/(2·pitch), which is the eyebox, divided into blocks.

Whatever the pattern, a pixel of u samples sends power in proportion to (sin(πuf)/(u·sin(πf)))² into the frequency f
(cycles a sample), which is sinc² for large u. The envelope is divided out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.model.bench_parts import Modulator
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.sampling import frequency_indices
from holoview.light.numerics.sampling import pixel_spectrum as spectrum_of_pixel


class HasLevels(Protocol):
    """What has levels: fractions 0…1 that can be shown; None: continuous."""

    @property
    def levels(self) -> NDArray[np.float64] | None: ...


def optical_path(drive: torch.Tensor, modulator: Modulator) -> torch.Tensor:
    """The optical path (m) of a drive in 0…1 of the stroke, any shape, at the nearest level of the modulator."""
    return nearest_level(drive, modulator) * modulator.stroke_m


def nearest_level(drive: torch.Tensor, modulator: HasLevels) -> torch.Tensor:
    """The stroke fraction of the level nearest to the drive, any shape; the drive itself for a continuous modulator.

    The gradient is that of the identity, the straight-through estimator (Bengio et al., arXiv:1308.3432).
    """
    if modulator.levels is None:
        return drive
    levels = _levels(drive, modulator)
    shown = levels[level_numbers(drive, modulator)]
    return drive + (shown - drive).detach() if drive.requires_grad else shown


def level_numbers(drive: torch.Tensor, modulator: HasLevels) -> torch.Tensor:
    """The index of the level nearest to the drive, in rising order of optical path; for a modulator with levels."""
    levels = _levels(drive, modulator)
    return torch.bucketize(drive.detach().contiguous(), (levels[1:] + levels[:-1]) / 2)


def _levels(drive: torch.Tensor, modulator: HasLevels) -> torch.Tensor:
    assert modulator.levels is not None
    return torch.as_tensor(modulator.levels.copy(), dtype=drive.dtype, device=drive.device)


def phasor(opd_m: torch.Tensor, wavelength_m: float | torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """exp(2πi·opd/λ) in a complex dtype, of the shape of `opd_m`; a tensor of wavelengths is broadcast.

    The turns are reduced modulo 1 in the precision of `opd_m`; sine and cosine are computed in that of `dtype`.
    """
    phase = (2 * math.pi) * torch.remainder(opd_m * (1.0 / wavelength_m), 1.0)
    phase = phase.to(torch.float64 if dtype == torch.complex128 else torch.float32)
    return torch.complex(torch.cos(phase), torch.sin(phase))


def pixel_spectrum(padded: int, upsample: int, slope: float) -> torch.Tensor:
    """The spectrum of one pixel along an axis, (padded,) complex128: Σ_j exp(2πi·j·(slope − k/padded)), j < upsample.

    padded: length of the FFT of samples.
    slope: phase slope of the illumination, turns a sample.

    The FFT of an upsampled pattern is the FFT of its pixels, repeated `upsample` times, times this spectrum: a quarter
    of the work for upsample = 2.
    """
    return torch.tensor(spectrum_of_pixel(padded, upsample, slope))


def sum_pool(samples: torch.Tensor, factor: int) -> torch.Tensor:
    """The adjoint of `upsample_nearest`: sums of the samples of each pixel, in the last two axes; real or complex."""
    lines = summed([samples[..., i::factor, :] for i in range(factor)])
    return summed([lines[..., i::factor] for i in range(factor)])


def summed(parts: list[torch.Tensor]) -> torch.Tensor:
    """The sum of tensors of equal shape; several times as fast as `sum` over a strided axis of complex numbers."""
    if len(parts) == 1:
        return parts[0]
    total = parts[0] + parts[1]
    for part in parts[2:]:
        total += part
    return total


# --- the first order --------------------------------------------------------------------------------------------------


Floats = NDArray[np.float64]

EYEBOX_BLOCKS = 8
"""Number of blocks along each side of the eyebox."""


@dataclass(frozen=True)
class FirstOrder:
    """The bins of the first order in the spectrum of a padded grid, for each axis (y, x).

    bins: FFT bins of the order, from its lower edge upwards.
    envelopes: power envelope of the pixels at these bins.
    """

    bins: tuple[NDArray[np.int64], NDArray[np.int64]]
    envelopes: tuple[Floats, Floats]

    def block_matrix(self, axis: int, blocks: int = EYEBOX_BLOCKS) -> Floats:
        """The matrix (block, bin) from powers along an axis to means over blocks, with the envelope divided out.

        Block sizes differ by one bin where `blocks` doesn't divide the number of bins, which it can't exceed.
        """
        count = len(self.bins[axis])
        blocks = min(blocks, count)
        edges = np.arange(blocks + 1) * count // blocks
        matrix = np.zeros((blocks, count))
        for block, (start, stop) in enumerate(pairwise(edges)):
            matrix[block, start:stop] = 1.0 / (stop - start)
        return matrix / self.envelopes[axis]


def eyebox_order(plan: Plan) -> FirstOrder:
    """The first order of the finest pixels of a bench, which is its eyebox."""
    return first_order(replace(plan.grid, upsample=round(plan.way.finest_m / plan.grid.pitch_m)))


def first_order(grid: Grid) -> FirstOrder:
    """The bins of the first order and their envelope for a simulation grid."""
    bins, envelopes = [], []
    for padded in grid.padded:
        count = padded // grid.upsample
        bins.append((np.arange(count) - count // 2) % padded)
        cycles = frequency_indices(padded)[bins[-1]] / padded
        envelopes.append((np.sinc(grid.upsample * cycles) / np.sinc(cycles)) ** 2)
    return FirstOrder((bins[0], bins[1]), (envelopes[0], envelopes[1]))
