"""Derivative of the loss with respect to a laser's wavelength, at fixed optical paths of the modulators.

A beam's light depends on λ through the modulators' phase 2π·opd/λ, the transfer functions H and pupils P of the relays,
and the phase 2π·n·s of oblique illumination at sample n, with the slope s = sin θ·dx/λ. Let φ = z·φ′ be the phase of H
over a distance z, and c the conjugate gradients that `forward_model` defines: dL = Re Σ c·dx. Then

    ∂L/∂λ = −Σ ∂φ′/∂λ·Im(W·Σ_k z_k·c_Wk) − z_gap·Σ ∂φ′/∂λ·Im(V·c_V)
            + Re Σ ∂(ln P₂)/∂λ·W·c_W + Re Σ ∂(ln P₁)/∂λ·V·c_V + illumination + modulators

with the spectra W behind the last modulator and V at modulator 2. For an eye that is focused δ(λ) further away, z_k is
the distance of the plane and δ, and −Σ ∂δ/∂λ·φ′·Im(W·c_W) is added. The dependence of colour on λ isn't contained here:
`problem` adds it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.optics.slm import phasor
from holoview.optics.source import plane_wave
from holoview.optimise.transfer_functions import TransferFunctions

Tensor = torch.Tensor


@dataclass(frozen=True)
class BeamAdjoint:
    """The spectra of one beam and their conjugate gradients, complex (k_y, k_x) in the bands of the relays.

    wavelength, source: indices in the plan. spectrum: W. spectrum_adjoint: c_W. z_weighted_adjoint: Σ_k z_k·c_Wk with
    the part c_Wk of plane k at distance z_k, without δ. incident_spectrum, incident_adjoint: V and c_V.
    opd_m: optical paths of the modulators in the beam's frame, (modulator, y, x). pixel_products: c·w of each
    modulator, summed over the samples of each pixel, (y, x).
    """

    wavelength: int
    source: int
    spectrum: Tensor
    spectrum_adjoint: Tensor
    z_weighted_adjoint: Tensor
    incident_spectrum: Tensor
    incident_adjoint: Tensor
    opd_m: Tensor
    pixel_products: Sequence[Tensor]


def wavelength_derivative(plan: Plan, transfer_functions: TransferFunctions, beam: BeamAdjoint) -> float:
    """∂L/∂λ (1/m) of the loss through one beam."""
    λ = float(plan.system.wavelengths_m[beam.wavelength])
    phase_derivative = transfer_functions.phase_derivative(1, beam.wavelength)
    z_weighted = beam.z_weighted_adjoint.add(beam.spectrum_adjoint, alpha=float(plan.focus_shift_m[beam.wavelength]))
    total = -_sum(phase_derivative * (z_weighted * beam.spectrum).imag)
    focus = transfer_functions.focus_derivative(beam.wavelength)
    if focus is not None:
        total -= _sum(focus * (beam.spectrum_adjoint * beam.spectrum).imag)
    total += _pupil_term(transfer_functions, 1, beam.wavelength, beam.spectrum_adjoint * beam.spectrum)
    gap_m = plan.system.gap_m
    if gap_m is not None:
        product = beam.incident_spectrum.mul(beam.incident_adjoint)
        total -= gap_m * _sum(transfer_functions.phase_derivative(0, beam.wavelength) * product.imag)
        total += _pupil_term(transfer_functions, 0, beam.wavelength, product)
    total += _illumination_term(plan, transfer_functions, beam, λ)
    pairs = zip(beam.pixel_products, beam.opd_m, strict=True)
    return total + 2 * math.pi * sum(_sum(product.imag * opd) for product, opd in pairs) / λ**2


def _pupil_term(transfer_functions: TransferFunctions, relay: int, wavelength: int, product: Tensor) -> float:
    derivative = transfer_functions.log_pupil_derivative(relay, wavelength)
    return 0.0 if derivative is None else _sum((derivative * product).real)


def _illumination_term(plan: Plan, transfer_functions: TransferFunctions, beam: BeamAdjoint, λ: float) -> float:
    """The part of the illumination: its phase 2π·s·n has ∂s/∂λ = −s/λ at sample n, counted from the grid's centre."""
    slopes = plan.slopes[beam.source, beam.wavelength]
    if not slopes.any():
        return 0.0
    dtype, device = beam.spectrum.dtype, beam.spectrum.device
    adjoint = beam.incident_adjoint
    if plan.system.gap_m is not None:
        adjoint = adjoint * transfer_functions.across_gap(beam.wavelength)
    y, x = (axis.undisplaced_gap for axis in transfer_functions.axes)
    field_adjoint = x.forward_transposed(y.forward_transposed(adjoint, 0), 1)
    pixels = upsample_nearest(phasor(beam.opd_m[0], λ, dtype), plan.grid.upsample)
    product = field_adjoint * plane_wave(plan, beam.wavelength, beam.source, dtype, device) * pixels
    rows, columns = (torch.arange(n, dtype=torch.float64) - (n - 1) / 2 for n in plan.grid.shape)
    turns = (slopes[0] * rows[:, None] + slopes[1] * columns[None, :]).to(product.imag)
    return 2 * math.pi / λ * _sum(turns * product.imag)


def _sum(values: Tensor) -> float:
    return float(values.sum())
