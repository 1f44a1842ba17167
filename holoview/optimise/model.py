"""Forward model and its adjoint for optimisation, looped over lasers so that one padded field is in memory at a time.

The chain of a laser in a frame, with F the FFT of the zero-padded field and C the cut to the modulator's area:

    u = s·p₁,  v = C F⁻¹ H_gap F u,  w = v·p₂,  E_k = C F⁻¹ H_k F w,  I_k = |E_k|²,    p_m = exp(2πi·opd_m/λ)

Writing g_x = ∂L/∂Re x + i·∂L/∂Im x, the adjoint runs it backwards:

    g_E = 2·E·∂L/∂I,  g_w = C F⁻¹ Σ_k conj(H_k) F g_E,  ∂L/∂opd₂ = (2π/λ)·Im(g_w·conj(w)),  g_v = g_w·conj(p₂), …

Conjugate gradients are carried instead (conj(g_E) and so on), so that conj(H) is never formed: F conj(g) uses F⁻¹.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from holoview.optics.propagate import relay_response
from holoview.optics.pupil import pupil
from holoview.optics.slm import phasor, pooled
from holoview.optics.source import plane_wave
from holoview.plan import Plan

Tensor = torch.Tensor


@dataclass
class Trace:
    """What the adjoint needs of one (laser, frame, source)."""

    pixels: tuple[Tensor, ...]  # exp(2πi·opd/λ) of each modulator, a value a pixel
    leaving: tuple[Tensor, ...]  # field behind each modulator, (y, x)
    seen: list[Tensor]  # field at each focal plane, (y, x)


class Model:
    """Intensities of each laser and frame of a plan, and gradients with respect to the optical-path maps."""

    def __init__(self, plan: Plan, *, double: bool = False, device: str = "cpu") -> None:
        self.plan = plan
        self.device = torch.device(device)
        self.complex = torch.complex128 if double else torch.complex64
        self.real = torch.float64 if double else torch.float32
        lasers = [(frame, λ) for frame in range(plan.system.frames) for λ in range(len(plan.system.wavelengths_m))]
        self.lasers = [(frame, λ) for frame, λ in lasers if plan.weights[frame, λ] > 0]
        self.sources = len(plan.slopes)
        self._h: dict[tuple[int, int, float], Tensor] = {}
        # Scratch grids: fresh allocations of this size cost as much as the FFT itself. _padded stays zero outside.
        self._padded = torch.zeros(plan.grid.padded, dtype=self.complex, device=self.device)
        self._spectrum, self._work, self._other = (torch.empty_like(self._padded) for _ in range(3))

    def trace(self, opd_m: Tensor, frame: int, wavelength: int, source: int) -> Trace:
        """Propagates one laser of one source through a frame of opd_m (frame, modulator, y, x)."""
        λ = float(self.plan.system.wavelengths_m[wavelength])
        pixels = tuple(phasor(opd, λ, self.complex) for opd in opd_m[frame])
        field = self._modulated(plane_wave(self.plan, wavelength, source, self.complex, self.device), pixels[0])
        leaving = [field]
        if self.plan.system.gap_m is not None:
            self._fft(field)
            leaving.append(self._modulated(self._through(0, wavelength, self.plan.system.gap_m), pixels[1]))
        self._fft(leaving[-1])
        seen = [self._through(1, wavelength, float(z)) for z in self.plan.planes_m]
        return Trace(pixels, tuple(leaving), seen)

    def intensity(self, traces: list[Trace]) -> Tensor:
        """Mean intensity over sources, (plane, y, x), at unit laser amplitude."""
        total = torch.zeros(len(self.plan.planes_m), *self.plan.grid.shape, dtype=self.real, device=self.device)
        for trace in traces:
            for plane, field in enumerate(trace.seen):
                total[plane].addcmul_(field.real, field.real).addcmul_(field.imag, field.imag)
        return total.div_(len(traces)) if len(traces) > 1 else total

    def backward(self, trace: Trace, slope: Tensor, frame: int, wavelength: int, gradient: Tensor) -> None:
        """Adds ∂L/∂opd of one trace to `gradient` (frame, modulator, y, x), given `slope` = ∂L/∂I (plane, y, x).

        Consumes the trace: its fields are overwritten.
        """
        carried = self._spectrum.zero_()
        for plane, field in enumerate(trace.seen):
            spectrum = self._ifft_padded(field.conj_physical_().mul_(slope[plane]))
            carried.addcmul_(spectrum, self._transfer(1, wavelength, float(self.plan.planes_m[plane])))
        conjugate = self._fft_cut(carried)
        last = len(trace.leaving) - 1
        self._add_gradient(gradient[frame, last], trace.leaving[last].mul_(conjugate), wavelength)
        if last == 0:
            return
        gap = self._transfer(0, wavelength, float(self.plan.system.gap_m or 0.0))
        spectrum = self._ifft_padded(self._modulated(conjugate, trace.pixels[1])).mul_(gap)
        self._add_gradient(gradient[frame, 0], trace.leaving[0].mul_(self._fft_cut(spectrum)), wavelength)

    def _add_gradient(self, gradient: Tensor, product: Tensor, wavelength: int) -> None:
        """∂L/∂opd = −2·(2π/λ)·Im(conj(g)·field), summed over the samples of each pixel."""
        turn = 2 * math.pi / float(self.plan.system.wavelengths_m[wavelength])
        gradient.sub_(pooled(product.imag, self.plan.grid.upsample), alpha=2 * turn)

    def _modulated(self, field: Tensor, pixels: Tensor) -> Tensor:
        """`field` (y, x), overwritten, times the modulator's pixels, each a square of equal samples."""
        rows, columns = pixels.shape
        factor = self.plan.grid.upsample
        field.view(rows, factor, columns, factor).mul_(pixels[:, None, :, None])
        return field

    def _through(self, relay: int, wavelength: int, distance_m: float) -> Tensor:
        """The field behind a relay, from the spectrum that `_fft` left."""
        torch.mul(self._spectrum, self._transfer(relay, wavelength, distance_m), out=self._work)
        return torch.fft.ifft2(self._work, out=self._other)[self.plan.grid.inside].clone()

    def _fft(self, field: Tensor) -> None:
        torch.fft.fft2(self._pad(field), out=self._spectrum)

    def _ifft_padded(self, conjugate: Tensor) -> Tensor:
        return torch.fft.ifft2(self._pad(conjugate), out=self._work)

    def _fft_cut(self, spectrum: Tensor) -> Tensor:
        return torch.fft.fft2(spectrum, out=self._other)[self.plan.grid.inside].clone()

    def _pad(self, field: Tensor) -> Tensor:
        self._padded[self.plan.grid.inside] = field
        return self._padded

    def _transfer(self, relay: int, wavelength: int, distance_m: float) -> Tensor:
        key = (relay, wavelength, distance_m)
        if key not in self._h:
            glass = pupil(self.plan, relay, wavelength, torch.complex128, self.device)
            self._h[key] = relay_response(self.plan.transfer(*key), self.plan.grid, glass, self.complex, self.device)
        return self._h[key]
