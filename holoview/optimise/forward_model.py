"""Wave propagation from patterns to intensities at each focal plane, and its hand-written adjoint.

A beam is one laser of one frame from one source direction. With the FFT F, the modulators' pixels
p_m = exp(2πi·opd_m/λ), the illumination s, the spectrum B of a pixel's shape, the transfer functions H, and brackets
for what lies on the modulator's area:

    V = B·H_gap·F[s·p₁],  w = [F⁻¹V]·p₂,  W = F w,  E_k = [F⁻¹ H_k W],  I_k = |E_k|²          (one modulator: W = V)

The first FFT is one of pixels, not of samples: the spectrum of an upsampled pattern is that of its pixels, repeated.

The adjoint carries conjugate gradients c, defined by dL = Re Σ c·dx, from the planes back to the modulators. They need
the H themselves where gradients would need their conjugates:

    c_E = ∂L/∂I·conj(E)·2,  c_W = Σ_k H_k·F⁻¹c_E,  c_w = F c_W,  ∂L/∂opd₂ = −(2π/λ)·Im(c_w·w),  c_V = F⁻¹(c_w·p₂), …

with products c·w summed over the samples of each pixel.

An evaluation calls `forward` once, `plane_intensity` and then `backpropagate_plane` for one plane after the other, so
that the fields of only one plane are in memory, and at last `accumulate_gradients`.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

import torch

from holoview.model.plan import Plan
from holoview.numerics.image_region import zero_outside
from holoview.optics.slm import fold_spectrum, phasor, sum_pool
from holoview.optimise.lasers import lit_lasers
from holoview.optimise.level_gradients import LevelSteps, secant_gradient
from holoview.optimise.transfer_functions import TransferFunctions
from holoview.optimise.wavelength_gradient import BeamAdjoint, wavelength_derivative

Tensor = torch.Tensor


@dataclass(frozen=True)
class CoherentBeam:
    """The light of one laser from one source direction. laser: index in `ForwardModel.lasers`; others: in the plan."""

    laser: int
    frame: int
    wavelength: int
    source: int


class ForwardModel:
    """Intensities of each laser and frame of a plan, and gradients with respect to the optical-path maps.

    lasers: (frame, wavelength) of every laser that is on. double: compute in complex128 instead of complex64.
    keep_fields: keep the fields of all beams at the present plane for `backpropagate_plane`. Otherwise they are
    propagated a second time, which costs a third more FFTs and saves one padded field a beam.
    """

    transfer_functions: TransferFunctions

    def __init__(self, plan: Plan, *, double: bool = False, device: str = "cpu", keep_fields: bool = True) -> None:
        self.plan = plan
        self.device = torch.device(device)
        self.complex_dtype = torch.complex128 if double else torch.complex64
        self.real_dtype = torch.float64 if double else torch.float32
        self.lasers = lit_lasers(plan)
        self.source_count = len(plan.slopes)
        self.beams = [
            CoherentBeam(i, *laser, s) for i, laser in enumerate(self.lasers) for s in range(self.source_count)
        ]
        self.has_second_modulator = plan.system.gap_m is not None
        self.keeps_fields = keep_fields
        count = len(self.beams)
        # An FFT's result is copied into these buffers and released at once: the next FFT then gets the same memory,
        # which is still in the processor's cache. That saves more than the copy costs.
        self.spectra = self._zero_fields(count)  # W of each beam
        self._exit_fields = self._zero_fields(count if self.has_second_modulator else 0)  # w of each beam
        self._plane_fields = self._zero_fields(count if keep_fields else 1)  # E of each beam at the present plane
        self.adjoint_spectra = self._zero_fields(count)  # c_W of each beam
        self._scratch = self._zero_fields(1)[0]
        self._real_scratch = torch.empty(plan.grid.shape, dtype=self.real_dtype, device=self.device)
        self.z_weighted_adjoint: Tensor | None = None  # Σ z_k·(part of plane k in c_W) of each beam, for ∂L/∂λ
        self.set_plan(plan)

    def set_plan(self, plan: Plan) -> None:
        """Changes to a plan of the same grid, lasers and planes, but other wavelengths."""
        assert plan.grid == self.plan.grid
        self.plan = plan
        with suppress(AttributeError):  # there are none yet in a new model
            del self.transfer_functions  # frees their memory before the next ones take it
        self.transfer_functions = TransferFunctions(plan, self.complex_dtype, self.device)

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Computes the spectra behind the last modulator for optical paths (frame, modulator, y, x), m.

        wavelength_gradient: also prepare what `accumulate_gradients` needs for the gradient of the wavelengths.
        """
        self.opd_m, self._phasors = opd_m, []
        self.z_weighted_adjoint = self._zero_fields(len(self.beams)) if wavelength_gradient else None
        for i, beam in enumerate(self.beams):
            λ = float(self.plan.system.wavelengths_m[beam.wavelength])
            first, *rest = (phasor(opd, λ, self.complex_dtype) for opd in opd_m[beam.frame])
            wave = self.transfer_functions.illumination(beam.wavelength, beam.source)
            self._phasors.append((first if wave is None else first * wave, *rest))
            self._incident_spectrum(i, self._scratch if self.has_second_modulator else self.spectra[i])
            if self.has_second_modulator:
                self._exit_fields[i].copy_(torch.fft.ifft2(self._scratch))
                self._modulate(self._exit_fields[i], rest[0])
                self.spectra[i].copy_(torch.fft.fft2(self._exit_fields[i]))
        self.adjoint_spectra.zero_()

    def plane_intensity(self, plane: int, out: Tensor) -> None:
        """Writes the intensity of every laser at a focal plane, mean over sources, unit amplitude: (laser, y, x)."""
        for i, beam in enumerate(self.beams):
            field = self._field_at(i, plane)
            total = out[beam.laser]
            if beam.source == 0:
                torch.mul(field.real, field.real, out=total)
            else:
                total.addcmul_(field.real, field.real)
            total.addcmul_(field.imag, field.imag)
            if beam.source == self.source_count - 1 > 0:
                total.div_(self.source_count)

    def backpropagate_plane(self, plane: int, intensity_gradient: Tensor) -> None:
        """Adds a plane's part to c_W: ∂L/∂intensity (laser, y, x) of the plane whose intensity was computed last."""
        for i, beam in enumerate(self.beams):
            field = self._plane_fields[i][self.plan.grid.inside] if self.keeps_fields else self._field_at(i, plane)
            if beam.source == 0:
                torch.neg(intensity_gradient[beam.laser], out=self._real_scratch)
            field.real.mul_(intensity_gradient[beam.laser])  # in place: E becomes ∂L/∂I·conj(E)
            field.imag.mul_(self._real_scratch)
            padded_field = self._plane_fields[i if self.keeps_fields else 0]
            zero_outside(padded_field, *self.plan.grid.inside)
            factor = 2.0 / self.source_count
            adjoint, transfer = torch.fft.ifft2(padded_field), self._plane_transfer(i, plane)
            self.adjoint_spectra[i].addcmul_(adjoint, transfer, value=factor)
            if self.z_weighted_adjoint is not None:
                factor *= float(self.plan.planes_m[plane])
                self.z_weighted_adjoint[i].addcmul_(adjoint, transfer, value=factor)
            del adjoint  # its memory is for the next FFT

    def accumulate_gradients(
        self, path_gradient: Tensor, wavelength_gradient: Tensor | None = None, level_steps: LevelSteps | None = None
    ) -> None:
        """Adds ∂L/∂opd to `path_gradient` (frame, modulator, y, x), ∂L/∂λ to `wavelength_gradient` (wavelength,) f64.

        With `level_steps`, the secant to each pixel's neighbouring level takes the place of ∂L/∂opd.
        """
        for i, beam in enumerate(self.beams):
            pixel_products, incident_adjoint = self._backpropagate_beam(i)
            self._add_path_gradient(path_gradient, beam, pixel_products, level_steps)
            if wavelength_gradient is not None:
                derivative = self._wavelength_derivative(i, pixel_products, incident_adjoint)
                wavelength_gradient[beam.wavelength] += derivative

    def _backpropagate_beam(self, i: int) -> tuple[list[Tensor], Tensor]:
        """Products c·w (y, x) of each modulator, summed over the samples of a pixel; and c_V. Overwrites w."""
        beam, upsample = self.beams[i], self.plan.grid.upsample
        incident_adjoint = self.adjoint_spectra[i]
        later_products: list[Tensor] = []
        if self.has_second_modulator:
            adjoint = torch.fft.fft2(self.adjoint_spectra[i])
            product = self._exit_fields[i].mul_(adjoint)[self.plan.grid.inside]
            later_products.append(sum_pool(product, upsample))
            self._modulate(adjoint, self._phasors[i][1])
            incident_adjoint = torch.fft.ifft2(adjoint)
        transfer = self.transfer_functions.from_first_modulator(beam.wavelength, beam.source)
        first_adjoint = torch.mul(incident_adjoint, transfer, out=self._scratch)
        pixels = torch.fft.fft2(fold_spectrum(first_adjoint, upsample))[self._active_area]
        return [pixels.mul_(self._phasors[i][0]), *later_products], incident_adjoint

    def _add_path_gradient(
        self, path_gradient: Tensor, beam: CoherentBeam, pixel_products: list[Tensor], level_steps: LevelSteps | None
    ) -> None:
        λ = float(self.plan.system.wavelengths_m[beam.wavelength])
        for modulator, product in enumerate(pixel_products):
            if level_steps is None:
                path_gradient[beam.frame, modulator].sub_(product.imag, alpha=2 * math.pi / λ)
            else:
                step_m = level_steps.path_m[beam.frame, modulator]
                curvature = float(level_steps.curvature[beam.laser, modulator]) / self.source_count
                path_gradient[beam.frame, modulator] += secant_gradient(product, step_m, λ, curvature)

    def _wavelength_derivative(self, i: int, pixel_products: list[Tensor], incident_adjoint: Tensor) -> float:
        assert self.z_weighted_adjoint is not None
        beam = self.beams[i]
        incident = self._incident_spectrum(i, self._scratch) if self.has_second_modulator else self.spectra[i]
        fields = BeamAdjoint(
            wavelength=beam.wavelength,
            source=beam.source,
            spectrum=self.spectra[i],
            spectrum_adjoint=self.adjoint_spectra[i],
            z_weighted_adjoint=self.z_weighted_adjoint[i],
            incident_spectrum=incident,
            incident_adjoint=incident_adjoint,
            opd_m=self.opd_m[beam.frame],
            pixel_products=pixel_products,
        )
        return wavelength_derivative(self.plan, self.transfer_functions, fields)

    def _incident_spectrum(self, i: int, out: Tensor) -> Tensor:
        """Writes V to `out` (P_y, P_x): the spectrum incident on modulator 2, or behind the only one."""
        beam, upsample = self.beams[i], self.plan.grid.upsample
        rows, columns = (p // upsample for p in self.plan.grid.padded)
        pixels = torch.zeros(rows, columns, dtype=self.complex_dtype, device=self.device)
        pixels[self._active_area] = self._phasors[i][0]
        spectrum = torch.fft.fft2(pixels)[None, :, None, :]
        transfer = self.transfer_functions.from_first_modulator(beam.wavelength, beam.source)
        tiles = (upsample, rows, upsample, columns)
        torch.mul(transfer.view(tiles), spectrum, out=out.view(tiles))
        return out

    def _field_at(self, i: int, plane: int) -> Tensor:
        """E of a beam at a plane (y, x): a view of the padded field, which `backpropagate_plane` overwrites."""
        torch.mul(self.spectra[i], self._plane_transfer(i, plane), out=self._scratch)
        buffer = self._plane_fields[i if self.keeps_fields else 0]
        buffer.copy_(torch.fft.ifft2(self._scratch))
        return buffer[self.plan.grid.inside]

    def _plane_transfer(self, i: int, plane: int) -> Tensor:
        return self.transfer_functions.to_plane(self.beams[i].wavelength, plane)

    def _modulate(self, field: Tensor, pixels: Tensor) -> None:
        """Multiplies a padded field by a modulator's pixels, each a square of equal samples; zero outside. In place."""
        upsample, inside = self.plan.grid.upsample, self.plan.grid.inside
        pixel_rows = pixels.repeat_interleave(upsample, dim=1)[:, None, :]
        field[inside[0]].view(len(pixels), upsample, -1)[..., inside[1]].mul_(pixel_rows)
        zero_outside(field, *inside)

    @property
    def _active_area(self) -> tuple[slice, slice]:
        """The modulator's pixels in a padded grid of pixels."""
        upsample = self.plan.grid.upsample
        rows, columns = (slice(s.start // upsample, s.stop // upsample) for s in self.plan.grid.inside)
        return rows, columns

    def _zero_fields(self, count: int) -> Tensor:
        return torch.zeros(count, *self.plan.grid.padded, dtype=self.complex_dtype, device=self.device)
