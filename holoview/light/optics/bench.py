"""The optical bench in torch, element by element: light from the laser through modulators and relays, differentiable.

    s·t₁ ─▶ V = F[s·t₁] ─▶ E₁ = F⁻¹[V·H₁P₁] ─▶ W = F[E₁·t₂] ─▶ E = F⁻¹[W·H₂P₂]          (one modulator: W = V)

s is the illumination, t₁ and t₂ are the complex transmissions of the modulators, H₁ and H₂ the transfer functions of
free space over the gap and to a plane, P₁ and P₂ the pupils of the relays, F is the discrete Fourier transform.

The elements stand here, and their order in `engine.frame.spectrum_behind_modulators`. All predictions in torch follow
from both: those of the reference executor (`engine.torch_executor`), of the near field of captures
(`captures.camera_model`), which diagnosis and calibration fit, and of the optimiser's model with effects
(`optimise.forward_model.AutogradModel`). Each of them chooses its precision, which frequencies it computes, and which
results it keeps. The optimiser's model without effects (`ForwardModel` there) has its own chain with an adjoint by
hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.model.eye import Eye
from holoview.light.model.passband import Transfer
from holoview.light.model.plan import Grid, Plan
from holoview.light.numerics.fourier import PrunedAxis, phasor_of_turns
from holoview.light.numerics.resample import centred_indices, upsample_nearest
from holoview.light.optics.chain import fourier_kernel
from holoview.light.optics.propagate import eye_pupil, nominal_pupil, transfer_function_at
from holoview.light.optics.slm import optical_path, phasor, pixel_spectrum
from holoview.light.optics.torch_effects import effects_pupil

Tensor = torch.Tensor


# --- the laser and the modulators -------------------------------------------------------------------------------------


def plane_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """s = exp(2πi·(s_y·y + s_x·x)) at the samples of the first modulator, (y, x) complex with modulus 1.

    The slopes s_y and s_x (turns a sample) are `plan.slopes`; positions count from the grid's centre, (N − 1)/2.
    """
    column, row = wave_axes(plan, wavelength, source, 1)
    return (column[:, None] * row[None, :]).to(dtype).to(device)


def pixel_wave(plan: Plan, wavelength: int, source: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """The plane wave at the first sample of each modulator pixel, (rows, columns) complex."""
    column, row = wave_axes(plan, wavelength, source, plan.grid.upsample)
    return (column[:, None] * row[None, :]).to(dtype).to(device)


def wave_axes(plan: Plan, wavelength: int, source: int, stride: int) -> tuple[Tensor, Tensor]:
    """Two complex128 vectors (y, x) whose outer product is the plane wave at every `stride`-th sample."""
    column, row = (
        phasor_of_turns(centred_indices(n, torch.float64, torch.device("cpu"))[::stride] * float(slope))
        for n, slope in zip(plan.grid.shape, plan.slopes[source, wavelength], strict=True)
    )
    return column, row


def drive_tensor(drive: NDArray[np.generic]) -> Tensor:
    """A drive of any shape and real type as a float64 tensor, a copy."""
    return torch.from_numpy(np.array(drive, order="C")).double()


def exposure_optical_paths(plan: Plan, drive: Tensor) -> Tensor:
    """Optical paths (frame, modulator, y, x) of a drive in m, for all frames of `plan.system`.

    They have the strokes of `plan.system` and the factors `plan.moments`, but no effects on modulators.
    """
    modulators = plan.system.modulators
    paths = torch.stack([optical_path(drive[:, i], modulator) for i, modulator in enumerate(modulators)], dim=1)
    if plan.moments == (1.0,):
        return paths
    factors = torch.tensor(plan.moments, dtype=paths.dtype, device=paths.device)
    return (paths[:, None] * factors[:, None, None, None]).flatten(0, 1)


def illuminated(plan: Plan, wavelength: int, source: int, transmission: Tensor) -> Tensor:
    """s·t₁: the field behind the first modulator, of pixels or of samples as its transmission is."""
    if not plan.slopes[source, wavelength].any():
        return transmission
    wave = pixel_wave if tuple(transmission.shape) == plan.system.modulators[0].shape else plane_wave
    return transmission * wave(plan, wavelength, source, transmission.dtype, transmission.device)


def modulated(field: Tensor, opd_m: Tensor, wavelength_m: float, upsample: int) -> Tensor:
    """field·exp(2πi·opd/λ) (y, x) for the optical paths of a modulator's pixels, (rows, columns) in m.

    upsample: samples of the field per pixel and axis; 1 for a field of pixels.
    """
    pixels = phasor(opd_m, wavelength_m, field.dtype)
    return field * (pixels if upsample == 1 else upsample_nearest(pixels, upsample))


# --- spectra ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PixelAxis:
    """From the pixels of the first modulator to chosen frequencies of its samples' spectrum, along one axis.

    The FFT of an upsampled pattern is the FFT of its pixels, repeated `upsample` times, times the spectrum of one
    pixel: a quarter of the work for upsample = 2.

    pixels: FFT of one number per pixel. entries: its entry for each frequency. shape: the spectrum of one pixel there.
    """

    pixels: PrunedAxis
    entries: Tensor
    shape: Tensor

    @staticmethod
    def at(
        grid: Grid, axis: int, slope: float, frequencies: Tensor, dtype: torch.dtype, first_sample: int = 0
    ) -> PixelAxis:
        """The axis (0: y, 1: x) of a grid, for signed frequency indices (n,).

        slope: of the illumination, turns a sample. first_sample: where the field begins in the padded grid.
        """
        padded, upsample = grid.padded[axis], grid.upsample
        period = padded // upsample
        shape = pixel_spectrum(padded, upsample, slope).to(dtype).to(frequencies.device)[frequencies]
        pixels = PrunedAxis(period, first_sample // upsample, grid.shape[axis] // upsample, 0, period)
        return PixelAxis(pixels, frequencies % period, shape)

    def forward(self, light: Tensor, dim: int) -> Tensor:
        """The spectrum along an axis of light that is given by one number per pixel."""
        shape = self.shape if dim == -1 else self.shape[:, None]
        return self.pixels.forward(light, dim).index_select(dim, self.entries) * shape


def has_pixel_spectra(grid: Grid) -> bool:
    """Whether the FFT of samples follows from one of pixels: a whole number of pixels fills the padded grid."""
    return all(padded % grid.upsample == 0 for padded in grid.padded)


def spectrum_of_pixels(light: Tensor, axes: Sequence[PixelAxis]) -> Tensor:
    """F[s·t₁] (rows, columns) of light at the first sample of each pixel, (y, x). axes: y and x."""
    y, x = axes
    return y.forward(x.forward(light, -1), -2)


# --- relays -----------------------------------------------------------------------------------------------------------


def relay_response(transfer: Transfer, ky: Tensor, kx: Tensor, pupil: Tensor | None, dtype: torch.dtype) -> Tensor:
    """H·P at rows ky (A,) and columns kx (B,) of signed frequency indices, (A, B) complex.

    pupil: at all frequencies of the padded grid, in `fftfreq` order; None where light is only stopped.
    """
    if pupil is None:
        return transfer_function_at(transfer, ky, kx, dtype)
    found = transfer_function_at(transfer, ky, kx, torch.complex128)
    return (found * pupil.to(found.device)[ky][:, kx]).to(dtype)


def pupil_with_effects(plan: Plan, relay: int, wavelength: int, eye: Eye | None = None) -> Tensor | None:
    """The pupil (P_y, P_x) complex128 of a relay with its effects, behind relay 2 also that of the eye.

    None where light is only stopped. eye: that of the plan when None.
    """
    pupil = pupil_without_effects(plan, relay, wavelength, eye)
    return _product(pupil, effects_pupil(plan, relay, wavelength)) if plan.nominal.effects else pupil


def pupil_without_effects(plan: Plan, relay: int, wavelength: int, eye: Eye | None = None) -> Tensor | None:
    """The same without effects; of a Fourier element its kernel."""
    if (fourier := plan.way.kernel(relay)) is not None:
        return fourier_kernel(plan, fourier, wavelength)
    pupil = nominal_pupil(plan, relay, wavelength, torch.complex128, torch.device("cpu"))
    if relay != plan.way.last:
        return pupil
    return _product(pupil, eye_pupil(plan, wavelength, eye or plan.nominal.eye))


def _product(first: Tensor | None, second: Tensor | None) -> Tensor | None:
    """The product of two pupils, of which None passes everything."""
    if first is None or second is None:
        return second if first is None else first
    return first * second
