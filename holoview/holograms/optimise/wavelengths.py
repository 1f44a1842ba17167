"""Wavelengths as variables: projection onto the allowed range and spacing, and the derivative of the loss.

A beam's light depends on λ through the modulators' phase 2π·opd/λ, the transfer functions H and pupils P of the relays,
and the phase 2π·n·s of oblique illumination at sample n, with the slope s = sin θ·dx/λ. Let φ = z·φ′ be the phase of H
over a distance z, and c the conjugate gradients that `forward_model` defines: dL = Re Σ c·dx. Then, at fixed optical
paths of the modulators,

    ∂L/∂λ = −Σ ∂φ′/∂λ·Im(W·Σ_k z_k·c_Wk) − z_gap·Σ ∂φ′/∂λ·Im(V·c_V)
            + Re Σ ∂(ln P₂)/∂λ·W·c_W + Re Σ ∂(ln P₁)/∂λ·V·c_V + illumination + modulators

with the spectra W behind the last modulator and V at modulator 2. For an eye that is focused δ(λ) further away, z_k is
the distance of the plane and δ, and −Σ ∂δ/∂λ·φ′·Im(W·c_W) is added. `problem` adds the derivative of the colour.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.holograms.optimise.adam import Adam, sqrt_decay
from holoview.holograms.optimise.beams import TransferFunctions
from holoview.holograms.optimise.settings import LossSpace, Settings
from holoview.light.colour import observer_weight_derivatives, observer_weights
from holoview.light.model.plan import Plan
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.optics.bench import plane_wave
from holoview.light.optics.slm import phasor
from holoview.util.errors import UserError

Tensor = torch.Tensor
Floats = NDArray[np.float64]

_MIN_STEPS = 8  # in a run; short ones take a step more often than they solve for amplitudes


class FreeWavelengths:
    """Wavelengths (wavelength,), m, that move in the first half of a run where they are free, and else stay.

    adjusted: whether they were projected onto the allowed ones at the start.
    """

    def __init__(self, wavelengths_m: Floats, settings: Settings) -> None:
        self.settings, self.values_m = settings, np.array(wavelengths_m)
        self.adam = Adam(torch.from_numpy(self.values_m.copy()), settings.betas)
        if "wavelengths" in settings.free:
            self.values_m = project_wavelengths(self.values_m, settings)
        self.adjusted = bool(np.any(self.values_m != wavelengths_m))

    @property
    def iterations(self) -> int:
        """Iterations in which wavelengths move: the first half. Patterns begin the second half with full steps."""
        return self.settings.iterations // 2 if "wavelengths" in self.settings.free else 0

    def are_due(self, iteration: int) -> bool:
        """Whether they take a step in an iteration."""
        every = max(1, min(self.settings.amplitudes_every, self.iterations // _MIN_STEPS))
        return iteration % every == 0 and 0 < iteration < self.iterations

    def step(self, gradient: Floats, iteration: int) -> None:
        """A step of Adam against ∂L/∂λ (wavelength,), inside the range and apart."""
        step = self.adam.unit_step(torch.from_numpy(gradient)).numpy()
        scale = sqrt_decay(iteration, self.iterations)
        self.values_m = project_wavelengths(
            self.values_m - scale * self.settings.wavelength_step_m * step, self.settings
        )

    def pattern_step_scale(self, iteration: int) -> float:
        """The patterns' step over the first one: it falls to zero, twice where wavelengths move in the first half."""
        first_half, total = self.iterations, self.settings.iterations
        if iteration < first_half:
            return sqrt_decay(iteration, first_half)
        return sqrt_decay(iteration - first_half, total - first_half)

    def moments(self) -> NDArray[np.floating]:
        """Adam's two moments (2, wavelength)."""
        return torch.stack([self.adam.first_moment, self.adam.second_moment]).numpy()

    def load(self, tensors: Mapping[str, NDArray[np.floating]], steps: str, index: int) -> None:
        """Takes wavelengths and moments of a checkpoint, and Adam's number of steps: an entry of its tensor `steps`."""
        self.values_m, self.adam.step_count = tensors["wavelengths"].astype(np.float64), int(tensors[steps][index])
        self.adam.first_moment, self.adam.second_moment = torch.from_numpy(tensors["wavelength_moments"].copy())


def project_wavelengths(wavelengths_m: Floats, settings: Settings) -> Floats:
    """The nearest wavelengths (least squares) inside the range and at least the spacing apart, in the same order.

    For sorted wavelengths x_i and spacing s, x_i − i·s must not fall: the nearest such sequence is an isotonic
    regression. Raises UserError when the range has no room for so many.
    """
    low, high = settings.wavelength_range_m
    count, spacing = len(wavelengths_m), settings.wavelength_spacing_m
    if (count - 1) * spacing > high - low:
        raise UserError(
            "wavelength range",
            f"{low * 1e9:g} to {high * 1e9:g} nm for {count} lasers {spacing * 1e9:g} nm apart",
            expected=f"at least {(count - 1) * spacing * 1e9:g} nm",
            remedy="widen the range or lower the spacing",
        )
    from scipy import optimize  # slow start: most optimisations leave the wavelengths as they are

    order = np.argsort(wavelengths_m, kind="stable")
    offsets = spacing * np.arange(count)
    monotone = optimize.isotonic_regression(wavelengths_m[order] - offsets).x.clip(low, high - (count - 1) * spacing)
    projected = np.empty(count)
    projected[order] = monotone + offsets
    return projected


def check_wavelength_search(observer: str, settings: Settings) -> None:
    """Raises UserError for a range of wavelengths where the observer has no data."""
    try:
        observer_weights(observer, settings.wavelength_range_m)
    except UserError as error:
        raise error.inside("wavelength range: ") from error


def channel_wavelength_derivatives(loss: LossSpace, wavelengths_m: Floats, observer: str) -> Floats:
    """∂(channels of unit intensity)/∂λ, (wavelength, channel), 1/m, from the observer's table.

    Zero for a monochrome camera, to which all wavelengths are equally bright.
    """
    if loss.ignores_wavelength:
        return np.zeros((len(wavelengths_m), len(loss.matrix)))
    derivatives: Floats = observer_weight_derivatives(observer, wavelengths_m) @ loss.matrix.T
    return derivatives


# --- the derivative of the loss --------------------------------------------------------------------------------------


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
