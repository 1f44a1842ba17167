"""Gradients for modulators with few phase levels: secants to the neighbouring level instead of the derivative.

The drive stays a continuous number and the modulator shows its nearest level, as with a straight-through estimator
(Bengio et al., arXiv:1308.3432). But the derivative ∂L/∂opd at the level shown says little about the next level, π or
more away, because the pixel's field turns as exp(iφ). The loss is nearly linear in the pixel's *field*, so that the
adjoint predicts the true change: with dL = Re(c·dp) at a pixel that shows p = exp(2πi·opd/λ) and P = c·p, a step that
turns the pixel's phase by φ = 2π·step/λ gives

    ΔL ≈ Σ_beams Re(P·(exp(iφ) − 1)) + s·κ·|exp(iφ) − 1|²

The secant ΔL/step replaces ∂L/∂opd, to which it tends for small steps. The neighbour is the level on the same side of
the shown one as the drive: if both neighbours are worse, the drive is pulled back to the level; otherwise it leaves.

The second term is the change of the loss that the pixel causes by itself: κ is the diagonal of the Gauss–Newton matrix
for a random field of unit mean intensity. Its weight s rises as the square of the progress, so that early in a run many
pixels can change together, and late in it they settle.

PSNR (dB) in comparison with straight-through, 96 × 128 pixels, 8 wavelengths, 60 iterations:
docs/optimiser-evidence.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from holoview.light.model.bench_parts import Modulator

Tensor = torch.Tensor

_FINAL_CURVATURE_WEIGHT = 0.3  # s at the end


@dataclass(frozen=True)
class LevelSteps:
    """The steps to neighbouring levels, and the part of the loss that each step costs by itself.

    path_m: optical path (m) from each pixel's level to its neighbour, (frame, modulator, y, x); 0 on continuous
    modulators. curvature: s·κ of each laser at each modulator, (laser, modulator).
    """

    path_m: Tensor
    curvature: Tensor


def steps_to_neighbour_level(drive: Tensor, modulators: tuple[Modulator, ...]) -> Tensor | None:
    """The signed step (stroke fraction) from the level shown to the neighbour on the drive's side.

    drive (frame, modulator, y, x) in 0…1. A drive exactly on a level looks upwards, on the last level downwards, so
    that the step is 0 only on modulators without levels. None if no modulator has levels.
    """
    if all(modulator.levels is None for modulator in modulators):
        return None
    steps = torch.zeros_like(drive)
    for i, modulator in enumerate(modulators):
        if modulator.levels is not None:
            levels = torch.tensor(modulator.levels, dtype=drive.dtype, device=drive.device)
            steps[:, i] = _step_to_neighbour(drive[:, i], levels)
    return steps


def _step_to_neighbour(drive: Tensor, levels: Tensor) -> Tensor:
    below = torch.bucketize(drive.contiguous(), levels[1:-1].contiguous(), right=True)
    low, high = levels[below], levels[below + 1]
    shows_low = drive <= (low + high) / 2
    return torch.where(shows_low, high - low, low - high)


def gauss_newton_diagonal(weight_squared: float, upsample: int, sample_count: int, source_count: int = 1) -> float:
    """κ of one laser: the mean ΔL/|Δp|² when one pixel's field changes by Δp and the images are random.

        κ = 2·w²·u² / (sample_count·source_count)

    L is the mean of squared residuals over planes, channels and `sample_count` samples. weight_squared: w², the mean
    over channels of the squared intensity that the laser adds to a channel. A pixel of u² samples (u = upsample) of
    unit field spreads the energy u² over a plane, where it interferes with a field E of unit mean intensity:
    Σ (2·w·Re(E*·ΔE))² = 2·w²·u²·|Δp|² in each plane. The `source_count` sources that share the intensity interfere
    independently, which divides the mean by their number.
    """
    return 2.0 * upsample**2 * weight_squared / (sample_count * source_count)


def curvature_weight(progress: float) -> float:
    """The weight s of κ after a fraction `progress` (0…1) of the iterations."""
    return _FINAL_CURVATURE_WEIGHT * progress**2


def secant_gradient(product: Tensor, step_m: Tensor, wavelength_m: float, curvature: float) -> Tensor:
    """The replacement of ∂L/∂opd for one beam (1/m), real, for pixels whose neighbouring level is `step_m` away.

    product: complex P, summed over the samples of each pixel; step_m: of its shape; curvature: s·κ. The derivative
    −(2π/λ)·Im P for small steps, the secant from half a turn on, and between them a mean weighted by sin²(φ/2): pixels
    that can nearly reach every phase do better when they move freely.
    """
    half_phase = (math.pi / wavelength_m) * step_m
    rad_per_m = 2 * math.pi / wavelength_m
    # sin(φ/2)/step = (π/λ)·sinc: finite at 0
    secant = torch.sinc(half_phase / math.pi) * (
        (product.real - 2 * curvature) * torch.sin(half_phase) + product.imag * torch.cos(half_phase)
    )
    secant_weight = torch.sin(half_phase.abs().clamp_max(math.pi / 2)).square()
    return torch.lerp(product.imag, secant, secant_weight).mul_(-rad_per_m)
