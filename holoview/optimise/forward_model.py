"""Forward model and its adjoint for optimisation: plane by plane, so that few fields are in memory at a time.

A beam is one laser of one frame from one source direction. Its chain, with F the FFT, p_m = exp(2πi·opd_m/λ) a value a
pixel, B the pixel's shape and the brackets what lies on the modulator's area:

    V = B·H_gap·F[s·p₁],  w = [F⁻¹V]·p₂,  W = F w,  E_k = [F⁻¹ H_k W],  I_k = |E_k|²          (one modulator: W = V)

The first FFT is one of pixels, not of samples: the spectrum of an upsampled pattern is that of its pixels, repeated.
A linear form dL = Re Σ c·dx is carried backwards, c being the conjugate of the gradient of x, which spares conj(H):

    c_E = ∂L/∂I·conj(E)·2,  c_W = Σ_k H_k·F⁻¹c_E,  c_w = F c_W,  ∂L/∂opd₂ = −(2π/λ)·Im(c_w·w),  c_V = F⁻¹(c_w·p₂), …

with products c·w summed over the samples of each pixel.

`forward` makes every W; then each plane is seen (`see`) and answered (`answer`) in turn; `finish` ends at the patterns
and, where they are asked for, at the wavelengths (`chromatic`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from holoview.model.plan import Plan
from holoview.optics.slm import fold_spectrum, phasor, sum_pool
from holoview.optimise.level_gradients import LevelSteps, secant_gradient
from holoview.optimise.transfer_functions import TransferFunctions
from holoview.optimise.wavelength_gradient import beam_wavelength_gradient

Tensor = torch.Tensor


@dataclass(frozen=True)
class CoherentBeam:
    """One source direction of a laser (counted in `Model.lasers`) that is on in a frame."""

    laser: int
    frame: int
    wavelength: int
    source: int


class ForwardModel:
    """Intensities of each laser and frame of a plan, and gradients with respect to the optical-path maps.

    lasers: (frame, wavelength) of every laser that is on. keep: whether the fields of one plane are kept for `answer`,
    or propagated to it a second time, which costs a third more FFTs and saves a padded field a beam.
    """

    def __init__(self, plan: Plan, *, double: bool = False, device: str = "cpu", keep_fields: bool = True) -> None:
        self.plan = plan
        self.device = torch.device(device)
        self.complex_dtype = torch.complex128 if double else torch.complex64
        self.real_dtype = torch.float64 if double else torch.float32
        lasers = [(frame, λ) for frame in range(plan.system.frames) for λ in range(len(plan.system.wavelengths_m))]
        self.lasers = [(frame, λ) for frame, λ in lasers if plan.weights[frame, λ] > 0]
        self.source_count = len(plan.slopes)
        self.beams = [
            CoherentBeam(i, *laser, s) for i, laser in enumerate(self.lasers) for s in range(self.source_count)
        ]
        self.has_second_modulator = plan.system.gap_m is not None
        self.keeps_fields = keep_fields
        count = len(self.beams)
        # An FFT's result is copied to where it stays and given back at once: then the next one finds the same memory in
        # the processor's cache, which saves more than the copy costs.
        self.spectra = self._zero_fields(count)  # W of each beam
        self._exit_fields = self._zero_fields(count if self.has_second_modulator else 0)  # w of each beam
        self._plane_fields = self._zero_fields(count if keep_fields else 1)  # E of each beam at the present plane
        self.adjoint_spectra = self._zero_fields(count)  # c_W of each beam
        self._scratch = self._zero_fields(1)[0]
        self._real_scratch = torch.empty(plan.grid.shape, dtype=self.real_dtype, device=self.device)
        self.z_weighted_adjoint: Tensor | None = (
            None  # Σ z_k·(share of plane k in c_W), for the gradient of the wavelengths
        )
        self.set_plan(plan)

    def set_plan(self, plan: Plan) -> None:
        """Goes on with a plan of the same grid, lasers and planes, but other wavelengths."""
        assert plan.grid == self.plan.grid
        self.plan = plan
        self.__dict__.pop("transfer_functions", None)  # frees its memory before the next ones are built
        self.transfer_functions = TransferFunctions(plan, self.complex_dtype, self.device)

    def forward(self, opd_m: Tensor, *, wavelength_gradient: bool = False) -> None:
        """Spectra behind the last modulator for optical paths (frame, modulator, y, x), m.

        chromatic: also carry what `finish` needs for the gradient with respect to the wavelengths.
        """
        self.opd_m, self._phasors = opd_m, []
        self.z_weighted_adjoint = self._zero_fields(len(self.beams)) if wavelength_gradient else None
        for i, beam in enumerate(self.beams):
            λ = float(self.plan.system.wavelengths_m[beam.wavelength])
            first, *rest = (phasor(opd, λ, self.complex_dtype) for opd in opd_m[beam.frame])
            wave = self.transfer_functions.illumination(beam.wavelength, beam.source)
            self._phasors.append((first if wave is None else first * wave, *rest))
            self.incident_spectrum(i, self._scratch if self.has_second_modulator else self.spectra[i])
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
        """Carries ∂L/∂intensity (laser, y, x) of the plane that was seen last back to the spectra."""
        for i, beam in enumerate(self.beams):
            field = self._plane_fields[i][self.plan.grid.inside] if self.keeps_fields else self._field_at(i, plane)
            if beam.source == 0:
                torch.neg(intensity_gradient[beam.laser], out=self._real_scratch)
            field.real.mul_(intensity_gradient[beam.laser])
            field.imag.mul_(self._real_scratch)
            seen = self._plane_fields[i if self.keeps_fields else 0]
            self._zero_outside(seen)
            share = 2.0 / self.source_count
            back = torch.fft.ifft2(seen)
            self.adjoint_spectra[i].addcmul_(back, self._plane_transfer(i, plane), value=share)
            if self.z_weighted_adjoint is not None:
                self.z_weighted_adjoint[i].addcmul_(
                    back, self._plane_transfer(i, plane), value=share * float(self.plan.planes_m[plane])
                )
            del back

    def accumulate_gradients(
        self, path_gradient: Tensor, wavelength_gradient: Tensor | None = None, level_steps: LevelSteps | None = None
    ) -> None:
        """Adds ∂L/∂opd to `gradient` (frame, modulator, y, x), and ∂L/∂λ to `chromatic` (wavelength,) float64.

        With `jumps`, the slope to each pixel's neighbouring level takes the place of ∂L/∂opd.
        """
        for i, beam in enumerate(self.beams):
            arriving = self.adjoint_spectra[i]
            products: list[Tensor] = []
            if self.has_second_modulator:
                conjugate = torch.fft.fft2(self.adjoint_spectra[i])
                product = self._exit_fields[i].mul_(conjugate)[self.plan.grid.inside]
                products.append(sum_pool(product, self.plan.grid.upsample))
                self._modulate(conjugate, self._phasors[i][1])
                arriving = torch.fft.ifft2(conjugate)
            first = torch.mul(
                arriving, self.transfer_functions.from_first_modulator(beam.wavelength, beam.source), out=self._scratch
            )
            pixels = torch.fft.fft2(fold_spectrum(first, self.plan.grid.upsample))[self._active_area]
            products.insert(0, pixels.mul_(self._phasors[i][0]))
            λ = float(self.plan.system.wavelengths_m[beam.wavelength])
            for modulator, product in enumerate(products):
                if level_steps is None:
                    path_gradient[beam.frame, modulator].sub_(product.imag, alpha=2 * math.pi / λ)
                else:
                    jump_m, cost = (
                        level_steps.path_m[beam.frame, modulator],
                        float(level_steps.curvature[beam.laser, modulator]),
                    )
                    path_gradient[beam.frame, modulator] += secant_gradient(
                        product, jump_m, λ, cost / self.source_count
                    )
            if wavelength_gradient is not None:
                pairs = zip(products, self.opd_m[beam.frame], strict=True)
                turned = sum(float((product.imag * opd).sum()) for product, opd in pairs)
                wavelength_gradient[beam.wavelength] += (
                    beam_wavelength_gradient(self, i, arriving) + 2 * math.pi * turned / λ**2
                )

    def incident_spectrum(self, i: int, out: Tensor) -> Tensor:
        """V: the spectrum that arrives at modulator 2, or behind the only one, (P_y, P_x)."""
        beam, upsample = self.beams[i], self.plan.grid.upsample
        rows, columns = (p // upsample for p in self.plan.grid.padded)
        pixels = torch.zeros(rows, columns, dtype=self.complex_dtype, device=self.device)
        pixels[self._active_area] = self._phasors[i][0]
        spectrum = torch.fft.fft2(pixels)[None, :, None, :]
        response = self.transfer_functions.from_first_modulator(beam.wavelength, beam.source)
        tiles = (upsample, rows, upsample, columns)
        torch.mul(response.view(tiles), spectrum, out=out.view(tiles))
        return out

    def _field_at(self, i: int, plane: int) -> Tensor:
        torch.mul(self.spectra[i], self._plane_transfer(i, plane), out=self._scratch)
        place = i if self.keeps_fields else 0
        self._plane_fields[place].copy_(torch.fft.ifft2(self._scratch))
        return self._plane_fields[place][self.plan.grid.inside]

    def _plane_transfer(self, i: int, plane: int) -> Tensor:
        return self.transfer_functions.to_plane(self.beams[i].wavelength, plane)

    def _modulate(self, field: Tensor, pixels: Tensor) -> None:
        """A padded field times a modulator's pixels, each a square of equal samples; zero outside."""
        upsample, inside = self.plan.grid.upsample, self.plan.grid.inside
        line = pixels.repeat_interleave(upsample, dim=1)[:, None, :]
        field[inside[0]].view(len(pixels), upsample, -1)[..., inside[1]].mul_(line)
        self._zero_outside(field)

    def _zero_outside(self, field: Tensor) -> None:
        rows, columns = self.plan.grid.inside
        field[: rows.start].zero_()
        field[rows.stop :].zero_()
        field[rows, : columns.start].zero_()
        field[rows, columns.stop :].zero_()

    @property
    def _active_area(self) -> tuple[slice, slice]:
        """Where the modulator's pixels lie in a padded grid of pixels."""
        upsample = self.plan.grid.upsample
        rows, columns = (slice(s.start // upsample, s.stop // upsample) for s in self.plan.grid.inside)
        return rows, columns

    def _zero_fields(self, count: int) -> Tensor:
        return torch.zeros(count, *self.plan.grid.padded, dtype=self.complex_dtype, device=self.device)
