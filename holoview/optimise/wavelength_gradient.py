"""The gradient with respect to a wavelength, of all but the modulators, from what the adjoint carries.

A beam's light depends on λ through the modulators' phase 2π·opd/λ (`Model.finish` has it), the transfer functions, the
pupils, and the phase slope sin θ·dx/λ of oblique illumination. With dL = Re Σ c·dx, and φ = z·φ₁(f) the phase of H:

    ∂L/∂λ = −Σ φ₁′·Im(W·Σ_k z_k·c_k) − z_gap·Σ φ₁′·Im(V·c_V) + Re Σ (ln P)′·W·c_W + …

Colour depends on λ as well: `objective` has that.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

from holoview.numerics.resample import upsample_nearest
from holoview.optics.slm import phasor
from holoview.optics.source import plane_wave

if TYPE_CHECKING:
    from holoview.optimise.forward_model import ForwardModel

Tensor = torch.Tensor


def beam_wavelength_gradient(model: ForwardModel, i: int, incident_adjoint: Tensor) -> float:
    """∂L/∂λ (1/m) of beam i but for its modulators; arriving (P_y, P_x): c_V, of the spectrum at modulator 2."""
    beam, responses = model.beams[i], model.transfer_functions
    assert model.z_weighted_adjoint is not None
    total = -_sum_to_float(
        responses.phase_derivative(beam.wavelength) * (model.z_weighted_adjoint[i] * model.spectra[i]).imag
    )
    total += _pupil_term(model, 1, beam.wavelength, model.adjoint_spectra[i] * model.spectra[i])
    gap_m = model.plan.system.gap_m
    if gap_m is not None:
        product = model.incident_spectrum(i, torch.empty_like(incident_adjoint)).mul_(incident_adjoint)
        total -= gap_m * _sum_to_float(responses.phase_derivative(beam.wavelength) * product.imag)
        total += _pupil_term(model, 0, beam.wavelength, product)
    return total + _oblique_illumination_term(model, i, incident_adjoint)


def _pupil_term(model: ForwardModel, relay: int, wavelength: int, product: Tensor) -> float:
    slope = model.transfer_functions.log_pupil_derivative(relay, wavelength)
    return 0.0 if slope is None else _sum_to_float((slope * product).real)


def _oblique_illumination_term(model: ForwardModel, i: int, arriving: Tensor) -> float:
    """Through the illumination: its phase 2π·s·n has ∂s/∂λ = −s/λ at sample n, counted from the grid's centre."""
    beam, plan = model.beams[i], model.plan
    slopes = plan.slopes[beam.source, beam.wavelength]
    if not slopes.any():
        return 0.0
    λ = float(plan.system.wavelengths_m[beam.wavelength])
    gap_m = plan.system.gap_m
    back = arriving if gap_m is None else arriving * model.transfer_functions.across_gap(beam.wavelength)
    conjugate = torch.fft.fft2(back)[plan.grid.inside]
    pixels = upsample_nearest(phasor(model.opd_m[beam.frame, 0], λ, model.complex_dtype), plan.grid.upsample)
    product = conjugate * plane_wave(plan, beam.wavelength, beam.source, model.complex_dtype, model.device) * pixels
    rows, columns = (torch.arange(n, dtype=torch.float64) - (n - 1) / 2 for n in plan.grid.shape)
    turns = (slopes[0] * rows[:, None] + slopes[1] * columns[None, :]).to(product.imag)
    return 2 * math.pi / λ * _sum_to_float(turns * product.imag)


def _sum_to_float(values: Tensor) -> float:
    return float(values.sum())
