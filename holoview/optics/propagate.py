"""Angular-spectrum transfer functions of free space with the stops of a relay, evaluated in float64.

    H = exp(−2πi·[(z/λ)·A/(1 + √(1 − A)) + u·d]),  A = |λu|²

Goodman, Introduction to Fourier Optics, 3rd ed., eq. 3-74, without the carrier exp(2πi·z/λ), and with a displacement d
of the picture. This form has no cancellation at small A, where √(1 − A) − 1 would lose all digits.
"""

from __future__ import annotations

import math

import torch

from holoview.model.plan import Grid
from holoview.model.transfer import Transfer
from holoview.numerics.fft_grid import frequency_indices
from holoview.numerics.phasor import phasor_of_turns


def direction_sines(
    grid: Grid, wavelength_m: float, device: torch.device | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Direction sines λu of the padded grid's frequencies, (P_y, 1) and (1, P_x) float64 in `fftfreq` order."""
    y, x = (
        torch.from_numpy(frequency_indices(p)).to(device).double() * (wavelength_m * step)
        for p, step in zip(grid.padded, grid.frequency_step, strict=True)
    )
    return y[:, None], x[None, :]


def transfer_function(transfer: Transfer, grid: Grid, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    """H at every frequency of the padded grid, (P_y, P_x) complex in `fftfreq` order; zero outside the support."""
    ky, kx = (torch.from_numpy(frequency_indices(p)).to(device) for p in grid.padded)
    return transfer_function_at(transfer, ky, kx, dtype)


def transfer_function_at(transfer: Transfer, ky: torch.Tensor, kx: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """H at rows ky (A,) and columns kx (B,) of signed frequency indices, (A, B) complex."""
    return stopped(free_space_at(transfer, ky, kx, dtype), transfer, ky, kx)


def free_space_at(transfer: Transfer, ky: torch.Tensor, kx: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """H (A, B) complex without stops and displacement, which is even in both frequencies: gathered from a quadrant."""
    ky, kx = ky.abs(), kx.abs()
    sine_y, sine_x = (
        torch.arange(int(k.max()) + 1, device=k.device).double() * step
        for k, step in zip((ky, kx), transfer.sine_step, strict=True)
    )
    a = sine_y.square()[:, None] + sine_x.square()[None, :]
    quadrant = phasor_of_turns(-transfer.waves * a / (1 + torch.sqrt((1 - a).clamp_min(0)))).to(dtype)
    return quadrant[ky][:, kx]


def stopped(whole: torch.Tensor, transfer: Transfer, ky: torch.Tensor, kx: torch.Tensor) -> torch.Tensor:
    """H from that of free space (A, B): with the stops and the displacement of a transfer."""
    dtype = whole.dtype
    mask = support_mask(transfer, kx, chosen=ky % len(transfer.support))
    displacement = [
        phasor_of_turns(-turns * k.double()).to(dtype) if turns else None
        for k, turns in zip((ky, kx), transfer.shift_turns, strict=True)
    ]
    whole = whole * mask
    if displacement[0] is not None:
        whole = whole * displacement[0][:, None]
    return whole if displacement[1] is None else whole * displacement[1]


def phase_per_metre(wavelength_m: float, grid: Grid) -> torch.Tensor:
    """Phase of H per metre of distance, −2π·(1 − √(1 − A))/λ, rad/m, (P_y, P_x) float64; without evanescent waves."""
    sine_y, sine_x = direction_sines(grid, wavelength_m)
    a = sine_y.square() + sine_x.square()
    return (-2 * math.pi / wavelength_m) * a / (1 + torch.sqrt((1 - a).clamp_min(0)))


def phase_wavelength_derivative(wavelength_m: float, grid: Grid) -> torch.Tensor:
    """∂(phase of H)/∂λ per metre of distance, rad/m², (P_y, P_x) float64; zero for evanescent waves.

    The phase is −2πz·(1 − r)/λ with r = √(1 − A), so that its derivative is −(2πz/λ²)·(1 − r)/r.
    """
    sine_y, sine_x = direction_sines(grid, wavelength_m)
    a = sine_y.square() + sine_x.square()
    root = torch.sqrt((1 - a).clamp_min(torch.finfo(torch.float64).eps))
    return torch.where(a < 1, (-2 * math.pi / wavelength_m**2) * a / (root * (1 + root)), 0)


def relay_transfer_function(
    transfer: Transfer, grid: Grid, pupil: torch.Tensor | None, dtype: torch.dtype, device: torch.device
) -> torch.Tensor:
    """H · pupil, (P_y, P_x) complex: the factor of a spectrum that propagates through a relay. pupil: None means 1."""
    if pupil is None:
        return transfer_function(transfer, grid, dtype, device)
    return (transfer_function(transfer, grid, torch.complex128, device) * pupil.to(device)).to(dtype)


def support_mask(transfer: Transfer, kx: torch.Tensor, chosen: torch.Tensor | slice = slice(None)) -> torch.Tensor:
    """Which frequencies pass, (A, B) bool, from the rows (smallest |k_x|, lowest k_x, highest k_x) of the support.

    kx: signed indices of the columns, (B,).
    chosen: indices (A,) of the rows; all by default.
    """
    smallest, lowest, highest = torch.from_numpy(transfer.support).to(kx.device)[chosen].T[..., None]
    return (kx.abs() >= smallest) & (kx >= lowest) & (kx <= highest)
