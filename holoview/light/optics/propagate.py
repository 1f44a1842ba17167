"""The action of a relay on a spectrum: free space with the relay's stops, and pupils, evaluated in float64.

    H = exp(−2πi·[(z/λ)·A/(1 + √(1 − A)) + u·d]),  A = |λu|²

Goodman, Introduction to Fourier Optics, 3rd ed., eq. 3-74, without the carrier exp(2πi·z/λ), and with a displacement d
of the picture. This form has no cancellation at small A, where √(1 − A) − 1 would lose all digits.
"""

from __future__ import annotations

import math

import torch

from holoview.light.model.bench_parts import Relay
from holoview.light.model.eye import Eye
from holoview.light.model.passband import Transfer
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.fourier import phasor_of_turns
from holoview.light.numerics.sampling import frequency_indices
from holoview.light.numerics.surfaces import zernike_sum

_ROWS = 32
"""Rows of H that are evaluated at a time: few enough for a processor's cache, which halves the time."""


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
    return free_space(transfer.waves, transfer.sine_step, ky, kx, dtype)


def free_space(
    waves: float, sine_step: tuple[float, float], ky: torch.Tensor, kx: torch.Tensor, dtype: torch.dtype
) -> torch.Tensor:
    """H (A, B) complex without stops at rows ky (A,) and columns kx (B,) of signed frequency indices.

    waves: z/λ, below 0 for the way back. sine_step: direction sines (y, x) between neighbouring frequencies.
    """
    ky, kx = ky.abs(), kx.abs()
    lowest = int(ky.min()), int(kx.min())
    sine_y, sine_x = (
        torch.arange(low, int(k.max()) + 1, device=k.device).double() * step
        for low, k, step in zip(lowest, (ky, kx), sine_step, strict=True)
    )
    quadrant = torch.empty(len(sine_y), len(sine_x), dtype=dtype, device=ky.device)
    for first in range(0, len(sine_y), _ROWS):
        rows = slice(first, first + _ROWS)
        a = sine_y[rows].square()[:, None] + sine_x.square()
        quadrant[rows] = phasor_of_turns(-waves * a / (1 + torch.sqrt((1 - a).clamp_min(0))))
    return quadrant[ky - lowest[0]][:, kx - lowest[1]]


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


def support_mask(transfer: Transfer, kx: torch.Tensor, chosen: torch.Tensor | slice = slice(None)) -> torch.Tensor:
    """Which frequencies pass, (A, B) bool, from the rows (smallest |k_x|, lowest k_x, highest k_x) of the support.

    kx: signed indices of the columns, (B,).
    chosen: indices (A,) of the rows; all by default.
    """
    smallest, lowest, highest = torch.tensor(transfer.support, device=kx.device)[chosen].T[..., None]
    kx = kx.to(smallest.dtype)  # of 32 bits, which are compared twice as fast
    return (kx.abs() >= smallest) & (kx >= lowest) & (kx <= highest)


# --- pupils ----------------------------------------------------------------------------------------------------------

_STILES_CRAWFORD = 0.05e6  # 1/m²


def nominal_pupil(
    plan: Plan, relay: int, wavelength: int, dtype: torch.dtype, device: torch.device, nominal: Relay | None = None
) -> torch.Tensor | None:
    """The pupil (P_y, P_x) of a relay without effects, in `fftfreq` order; None where light is only stopped.

    nominal: the relay before effects changed its stops; that of `plan.nominal` when None.

    pupil = w·exp(−(s/na)²)·exp(2πi·opd/λ) with opd = Σ_j c_j·Z_j over the pupil, the direction sine s = |λu|, the
    aperture `na` of the apodisation, and Zernike terms Z_j with unit r.m.s. over the pupil in Noll's order (J. Opt.
    Soc. Am. 66, 207 (1976)). Stops are in the plan's support; w is 1, or with `Plan.has_weighted_stops` the share of a
    frequency's cell that passes.

    It is fixed in direction sines: in frequency its radius shrinks with the wavelength. Its optical path, in metres,
    doesn't depend on the wavelength. The Zernike terms are over the nominal stops, beyond which they go on: effects
    that move a stop or make it wider leave the glass as it is.
    """
    description, weights = plan.relays[relay], plan.stop_weights(relay, wavelength)
    has_glass = bool(description.aberration_m) or description.apodisation_na is not None
    if not has_glass:
        return None if weights is None else torch.from_numpy(weights).to(device).to(dtype)
    λ = float(plan.system.wavelengths_m[wavelength])
    sine_y, sine_x = direction_sines(plan.grid, λ, device)
    sine = torch.hypot(sine_y, sine_x)
    amplitude = torch.ones_like(sine) if weights is None else torch.from_numpy(weights).to(device)
    if description.apodisation_na is not None:
        amplitude = amplitude * torch.exp(-((sine / description.apodisation_na) ** 2))
    stops = nominal or plan.nominal.way.relays[relay]
    radius = stops.pupil_radius_sine(λ, plan.nominal.way.orders_m[relay])
    sine_y, sine_x = (s - centre for s, centre in zip((sine_y, sine_x), stops.centre_na, strict=True))
    opd = zernike_sum(description.aberration_m, torch.hypot(sine_y, sine_x) / radius, torch.atan2(sine_y, sine_x))
    return torch.polar(amplitude, 2 * math.pi * torch.remainder(opd / λ, 1.0)).to(dtype)


# What the pupil of an eye does beyond stopping light: its cylinder, its Zernike terms, the Stiles–Crawford effect.
#
# pupil = 10^(−ρ·r²/2)·exp(2πi·opd/λ),  r = f·|s − s₀|
#
# with the focal length f of the eyepiece, the direction sine s and that of the pupil's centre s₀. The effect weights
# intensity by 10^(−ρ·r²), ρ = 0.05/mm² (Applegate & Lakshminarayanan, J. Opt. Soc. Am. A 10, 1611 (1993)), so that the
# amplitude has half the exponent. For coherent light the integrated effect is disputed (Vohnsen & Rativa 2011;
# Westheimer 2013).


def eye_pupil(plan: Plan, wavelength: int, eye: Eye | None) -> torch.Tensor | None:
    """The pupil function (P_y, P_x) complex128 of an eye, on the grid of a plan, in `fftfreq` order.

    Without the stop itself, which is in the plan's support; None where it only stops light. Beside its cylinder and its
    Zernike terms it has the Stiles–Crawford effect,

        pupil = 10^(−ρ·r²/2)·exp(2πi·opd/λ),  r = f·|s − s₀|

    with the focal length f of the eyepiece, the direction sine s and that of the pupil's centre s₀. The effect weights
    intensity by 10^(−ρ·r²), ρ = 0.05/mm² (Applegate & Lakshminarayanan, J. Opt. Soc. Am. A 10, 1611 (1993)), so that
    the amplitude has half the exponent. For coherent light the integrated effect is disputed (Vohnsen & Rativa 2011;
    Westheimer 2013).
    """
    if eye is None or not eye.has_pupil_function:
        return None
    λ = float(plan.system.wavelengths_m[wavelength])
    sine_y, sine_x = (
        sines - centre for sines, centre in zip(direction_sines(plan.grid, λ), eye.pupil_centre_na, strict=True)
    )
    sine, angle = torch.hypot(sine_y, sine_x), torch.atan2(sine_y, sine_x)
    amplitude = torch.ones_like(sine)
    if eye.stiles_crawford:
        amplitude = 10.0 ** (-0.5 * _STILES_CRAWFORD * (eye.eyepiece_m * sine) ** 2)
    terms = eye.prescription.aberration_m
    opd = _cylinder_path(eye, sine, angle) + zernike_sum(terms, sine / eye.pupil_na(plan.nominal.field_m), angle)
    return torch.polar(amplitude, 2 * math.pi * torch.remainder(opd / λ, 1.0))


def _cylinder_path(eye: Eye, sine: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
    """Optical path of a cylinder without its mean sphere, which is in the distance, m.

    The eye is focused by C·(sin²(θ − α) − ½) dioptres further away in the meridian θ, that is −f²·C·(…) of z nearer to
    the modulator, so that the path of free space, −z·s²/2, lacks ½·f²·C·(…)·s². The angle θ runs from x to y, which
    points downwards: clockwise in the picture.
    """
    p = eye.prescription
    turned = torch.cos(2 * (angle - math.radians(p.axis_deg)))
    return -0.25 * p.cylinder_dpt * (eye.eyepiece_m * sine) ** 2 * turned
