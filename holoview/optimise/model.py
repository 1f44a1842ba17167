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

from holoview.optics.propagate import transfer_function
from holoview.optics.pupil import pupil
from holoview.optics.slm import phasor, pooled, upsampled
from holoview.optics.source import plane_wave
from holoview.plan import Plan

Tensor = torch.Tensor


@dataclass
class Trace:
    """What the adjoint needs of one (laser, frame, source): the fields at the modulators and at each focal plane."""

    entering: tuple[Tensor, ...]  # field in front of each modulator, (y, x)
    leaving: Tensor  # field behind the last modulator
    seen: list[Tensor]  # field at each focal plane


class Model:
    """Intensities of each laser and frame of a plan, and gradients with respect to the optical-path maps."""

    def __init__(self, plan: Plan, *, double: bool = False, device: str = "cpu") -> None:
        self.plan = plan
        self.device = torch.device(device)
        self.complex = torch.complex128 if double else torch.complex64
        self.real = torch.float64 if double else torch.float32
        self.lasers = [(frame, λ) for frame in range(plan.system.frames) for λ in range(len(plan.system.wavelengths_m))]
        self.lasers = [(frame, λ) for frame, λ in self.lasers if plan.weights[frame, λ] > 0]
        self.sources = len(plan.slopes)
        self._h: dict[tuple[int, int, float], Tensor] = {}
        self._padded = torch.zeros(plan.grid.padded, dtype=self.complex, device=self.device)

    def trace(self, opd_m: Tensor, frame: int, wavelength: int, source: int) -> Trace:
        """Propagates one laser of one source through a frame of opd_m (frame, modulator, y, x)."""
        system = self.plan.system
        field = plane_wave(self.plan, wavelength, source, self.complex, self.device)
        entering = [field]
        field = field * self._pixels(opd_m[frame, 0], wavelength)
        if system.gap_m is not None:
            field = self._through(self._fft(field), 0, wavelength, system.gap_m)
            entering.append(field)
            field = field * self._pixels(opd_m[frame, 1], wavelength)
        spectrum = self._fft(field)
        seen = [self._through(spectrum, 1, wavelength, float(z)) for z in self.plan.planes_m]
        return Trace(tuple(entering), field, seen)

    def intensity(self, traces: list[Trace]) -> Tensor:
        """Mean intensity over sources, (plane, y, x), at unit laser amplitude."""
        total = torch.zeros(len(self.plan.planes_m), *self.plan.grid.shape, dtype=self.real, device=self.device)
        for trace in traces:
            for plane, field in enumerate(trace.seen):
                total[plane].addcmul_(field.real, field.real).addcmul_(field.imag, field.imag)
        return total.div_(len(traces)) if len(traces) > 1 else total

    def backward(
        self, trace: Trace, slope: Tensor, opd_m: Tensor, frame: int, wavelength: int, gradient: Tensor
    ) -> None:
        """Adds ∂L/∂opd of one trace to `gradient` (frame, modulator, y, x), given `slope` = ∂L/∂I (plane, y, x).

        Consumes the trace: its fields are overwritten.
        """
        turn = 2 * math.pi / float(self.plan.system.wavelengths_m[wavelength])
        carried: Tensor | None = None
        for plane, field in enumerate(trace.seen):
            conjugate = field.conj_physical_().mul_(slope[plane])
            spectrum = self._ifft_padded(conjugate)
            h = self._transfer(1, wavelength, float(self.plan.planes_m[plane]))
            carried = spectrum.mul_(h) if carried is None else carried.addcmul_(spectrum, h)
        assert carried is not None
        conjugate = self._fft_cut(carried)
        product = trace.leaving.mul_(conjugate)
        gradient[frame, len(trace.entering) - 1].sub_(pooled(product.imag, self.plan.grid.upsample), alpha=2 * turn)
        if len(trace.entering) == 1:
            return
        conjugate.mul_(self._pixels(opd_m[frame, 1], wavelength))
        spectrum = self._ifft_padded(conjugate).mul_(
            self._transfer(0, wavelength, float(self.plan.system.gap_m or 0.0))
        )
        product = self._fft_cut(spectrum).mul_(trace.entering[0]).mul_(self._pixels(opd_m[frame, 0], wavelength))
        gradient[frame, 0].sub_(pooled(product.imag, self.plan.grid.upsample), alpha=2 * turn)

    def eyebox(self, traces: list[Trace], wavelength: int) -> Tensor:
        """Intensity over the pupil plane of relay 2 (P_y, P_x), zero frequency first, mean over the sources."""
        stop = self._transfer(1, wavelength, float(self.plan.planes_m[0])).abs().square()
        power = torch.stack([self._fft(trace.leaving).abs().square() for trace in traces]).mean(dim=0)
        return power * stop

    def _pixels(self, opd_m: Tensor, wavelength: int) -> Tensor:
        pixels = phasor(opd_m, float(self.plan.system.wavelengths_m[wavelength]), self.complex)
        return upsampled(pixels, self.plan.grid.upsample)

    def _through(self, spectrum: Tensor, relay: int, wavelength: int, distance_m: float) -> Tensor:
        return torch.fft.ifft2(spectrum * self._transfer(relay, wavelength, distance_m))[self.plan.grid.inside].clone()

    def _fft(self, field: Tensor) -> Tensor:
        return torch.fft.fft2(self._pad(field))

    def _ifft_padded(self, conjugate: Tensor) -> Tensor:
        return torch.fft.ifft2(self._pad(conjugate))

    def _fft_cut(self, spectrum: Tensor) -> Tensor:
        return torch.fft.fft2(spectrum)[self.plan.grid.inside].clone()

    def _pad(self, field: Tensor) -> Tensor:
        self._padded[self.plan.grid.inside] = field
        return self._padded

    def _transfer(self, relay: int, wavelength: int, distance_m: float) -> Tensor:
        key = (relay, wavelength, distance_m)
        if key not in self._h:
            h = transfer_function(self.plan.transfer(*key), self.plan.grid, torch.complex128, self.device)
            glass = pupil(self.plan, relay, wavelength, torch.complex128, self.device)
            self._h[key] = (h if glass is None else h * glass).to(self.complex)
        return self._h[key]
