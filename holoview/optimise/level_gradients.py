"""Gradients for modulators with few levels: secants to the neighbouring level instead of tangents.

The drive stays a continuous number and what is shown is always its nearest level, as with a straight-through estimator
(Bengio et al., arXiv:1308.3432). But ∂L/∂opd at the level shown says little about the next level, π or more away: the
pixel's field turns as exp(iφ). The loss is nearly linear in the pixel's *field*, so the adjoint tells the true change:
with dL = Re(c·dp) at a pixel that shows p = exp(2πi·opd/λ) and P = c·p, a jump that turns the pixel by φ gives

    ΔL ≈ Σ_beams Re(P·(exp(iφ) − 1)) + s·κ·|exp(iφ) − 1|²,      φ = 2π·jump/λ

and ΔL/jump takes the place of ∂L/∂opd, to which it tends for small jumps. The neighbour is the one on whose side the
drive lies; a level better than both neighbours therefore pulls the drive back to it, and one that isn't is left.
The second term is what a change costs by itself: κ is the diagonal of the Gauss–Newton matrix, in a random field of
unit mean intensity. Its share s rises as the square of the progress: first pixels can change together, then settle.

PSNR (dB) against straight-through, 96 x 128 pixels, 8 wavelengths, 60 iterations: docs/optimiser.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from holoview.model.system import Modulator

Tensor = torch.Tensor


_FINAL_CURVATURE_WEIGHT = 0.3


@dataclass(frozen=True)
class LevelSteps:
    """The optical path (m) to each pixel's neighbouring level, (frame, modulator, y, x), 0 on continuous modulators;
    and κ of each laser at each modulator (laser, modulator), times its present share."""

    path_m: Tensor
    curvature: Tensor


def steps_to_neighbour_level(drive: Tensor, modulators: tuple[Modulator, ...]) -> Tensor | None:
    """The signed way (stroke fraction) from the level shown to the neighbour on the drive's side; None without levels.

    drive (frame, modulator, y, x) in 0…1. A drive on a level looks upwards, on the last level downwards: never 0, but
    on modulators without levels.
    """
    if all(modulator.levels is None for modulator in modulators):
        return None
    jumps = torch.zeros_like(drive)
    for i, modulator in enumerate(modulators):
        if modulator.levels is not None:
            levels = torch.tensor(modulator.levels, dtype=drive.dtype, device=drive.device)
            jumps[:, i] = _step_to_neighbour(drive[:, i], levels)
    return jumps


def _step_to_neighbour(drive: Tensor, levels: Tensor) -> Tensor:
    below = torch.bucketize(drive.contiguous(), levels[1:-1].contiguous(), right=True)
    low, high = levels[below], levels[below + 1]
    shows_low = drive <= (low + high) / 2
    return torch.where(shows_low, high - low, low - high)


def gauss_newton_diagonal(weight_squared: float, upsample: int, sample_count: int, source_count: int = 1) -> float:
    """κ of one laser: ΔL = κ·|Δp|² on average, when a pixel's field alone changes by Δp and its images were random.

    L is the mean over planes, channels and `samples` of squared residuals; weight_squared: mean over channels of the
    squared intensity that the laser brings there. A pixel of u² samples of unit field spreads energy u² over a plane,
    where it beats with unit intensity: Σ (2·w·Re(E*·ΔE))² = 2·w²·u²·|Δp|² a plane, with E the field there. Sources that
    share the intensity beat independently: their mean has that much less.
    """
    return 2.0 * upsample**2 * weight_squared / (sample_count * source_count)


def curvature_weight(progress: float) -> float:
    """The share of a jump's own cost that counts, at progress 0…1."""
    return _FINAL_CURVATURE_WEIGHT * progress**2


def secant_gradient(product: Tensor, step_m: Tensor, wavelength_m: float, curvature: float) -> Tensor:
    """∂L/∂opd of one beam (1/m), real, for pixels whose neighbouring level is jump_m away.

    product: complex P, summed over the samples of each pixel; jump_m of its shape; cost: s·κ. The tangent,
    −(2π/λ)·Im P, for small jumps, the secant from half a turn on, and between them a mean weighted by sin²(φ/2): pixels
    that can nearly reach every phase do better when they move freely.
    """
    half = (math.pi / wavelength_m) * step_m
    turn = 2 * math.pi / wavelength_m
    # sin(φ/2)/jump = (π/λ)·sinc: finite at 0
    secant = torch.sinc(half / math.pi) * (
        (product.real - 2 * curvature) * torch.sin(half) + product.imag * torch.cos(half)
    )
    share = torch.sin(half.abs().clamp_max(math.pi / 2)).square()
    return torch.lerp(product.imag, secant, share).mul_(-turn)
