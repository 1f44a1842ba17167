"""A baseline of the optimiser as in textbooks; a faster one is in `holoview.evidence.benchmark.autograd_loop`."""

from __future__ import annotations

import math

import torch

from holoview.evidence.benchmark.autograd_loop import Autograd, Tensor


class Textbook(Autograd):
    """Propagation as a function of field, distance and wavelength: each FFT between two shifts, H computed each time.

    H is the transfer function. There is a forward FFT for each plane.
    """

    def _intensities(self, wavelength: int, drive: Tensor) -> list[Tensor]:
        λ = self.wavelengths_m[wavelength]
        field = self.phasor(0, λ, drive)
        if self.system.gap_m is not None:
            field = self._propagated(field, λ, self.system.gap_m) * self.phasor(1, λ, drive)
        return [self._propagated(field, λ, z).abs() ** 2 for z in self.planes_m]

    def _propagated(self, field: Tensor, λ: float, distance_m: float) -> Tensor:
        fy, fx = (torch.fft.fftshift(torch.fft.fftfreq(n, self.pitch_m)) for n in self.shape)
        a = (λ * fy[:, None]) ** 2 + (λ * fx[None, :]) ** 2
        phase = (2 * math.pi * distance_m / λ) * torch.sqrt((1 - a).clamp_min(0))
        h = torch.where(a < 1, torch.exp(1j * phase), 0)
        spectrum = torch.fft.fftshift(torch.fft.fft2(torch.fft.fftshift(field)))
        return torch.fft.ifftshift(torch.fft.ifft2(torch.fft.ifftshift(spectrum * h)))
