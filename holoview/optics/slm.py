"""Phase modulator: drive → quantised optical path → complex transmission; its square pixels on the simulation grid.

The phase is 2π·opd/λ. The optical path of a drive doesn't depend on the wavelength, so that the phase scales as 1/λ.
"""

from __future__ import annotations

import math

import torch

from holoview.model.bench_parts import Modulator
from holoview.numerics.sampling import pixel_spectrum as spectrum_of_pixel


def optical_path(drive: torch.Tensor, modulator: Modulator) -> torch.Tensor:
    """The optical path (m) of a drive in 0…1 of the stroke, any shape, at the nearest level of the modulator."""
    return nearest_level(drive, modulator) * modulator.stroke_m


def nearest_level(drive: torch.Tensor, modulator: Modulator) -> torch.Tensor:
    """The stroke fraction of the level nearest to the drive, any shape; the drive itself for a continuous modulator.

    The gradient is that of the identity, the straight-through estimator (Bengio et al., arXiv:1308.3432).
    """
    if modulator.levels is None:
        return drive
    levels = _levels(drive, modulator)
    shown = levels[level_numbers(drive, modulator)]
    return drive + (shown - drive).detach() if drive.requires_grad else shown


def level_numbers(drive: torch.Tensor, modulator: Modulator) -> torch.Tensor:
    """The index of the level nearest to the drive, in rising order of optical path; for a modulator with levels."""
    levels = _levels(drive, modulator)
    return torch.bucketize(drive.detach().contiguous(), (levels[1:] + levels[:-1]) / 2)


def _levels(drive: torch.Tensor, modulator: Modulator) -> torch.Tensor:
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
    return torch.from_numpy(spectrum_of_pixel(padded, upsample, slope))


def sum_pool(samples: torch.Tensor, factor: int) -> torch.Tensor:
    """The adjoint of `upsample_nearest`: sums of the samples of each pixel, in the last two axes; real or complex."""
    lines = summed([samples[..., i::factor, :] for i in range(factor)])
    return summed([lines[..., i::factor] for i in range(factor)])


def fold_spectrum(spectrum: torch.Tensor, factor: int) -> torch.Tensor:
    """The adjoint of repeating a spectrum `factor` times along each of the last two axes: the sum of its copies."""
    rows = summed(list(spectrum.chunk(factor, dim=-2)))
    return summed(list(rows.chunk(factor, dim=-1)))


def summed(parts: list[torch.Tensor]) -> torch.Tensor:
    """The sum of tensors of equal shape; several times as fast as `sum` over a strided axis of complex numbers."""
    if len(parts) == 1:
        return parts[0]
    total = parts[0] + parts[1]
    for part in parts[2:]:
        total += part
    return total
