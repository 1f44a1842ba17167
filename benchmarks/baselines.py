"""Baselines of the optimiser: the same bench and loss in plain PyTorch, differentiated by autograd.

Textbook  each FFT between two shifts; H computed at each propagation; a forward FFT for each plane
Cached    no shifts; H computed once in float64; one forward FFT for all planes

H is the transfer function. Both loop over wavelengths and planes, which is faster on a CPU than a batch.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.colour import observer_weights, xyz_to_linear_srgb
from holoview.model.system import System

Tensor = torch.Tensor


@dataclass(frozen=True)
class Work:
    """A test case: a bench of one frame, a target focal stack (plane, y, x, 3), a first drive (1, modulator, y, x)."""

    system: System
    stack: NDArray[np.float32]
    drive: NDArray[np.float32]


class Autograd(ABC):
    """Minimises the mean squared error of linear sRGB over a focal stack by Adam on the drive; no padding.

    The drive is clipped to 0…1.
    rate_rad: Adam's step as a phase at the middle wavelength, as in `holoview.Settings`.
    """

    def __init__(self, work: Work, rate_rad: float = 1.0, betas: tuple[float, float] = (0.9, 0.99)) -> None:
        system = work.system
        assert system.sampling.propagation == "periodic"
        self.system, self.upsample = system, system.sampling.upsample
        self.pitch_m = system.modulators[0].pitch_m / self.upsample
        self.shape = tuple(n * self.upsample for n in system.modulators[0].shape)
        self.wavelengths_m = [float(λ) for λ in system.wavelengths_m]
        self.planes_m = [float(z) for z in system.planes_m]
        self.strokes_m = [modulator.stroke_m for modulator in system.modulators]
        self.colours = xyz_to_linear_srgb(observer_weights(system.observer, system.wavelengths_m))
        self.amplitudes = np.array(system.amplitudes[0])
        self.target = torch.from_numpy(work.stack).movedim(-1, 1).contiguous()
        self.drive = torch.tensor(work.drive[0], requires_grad=True)
        turn = 2 * math.pi * self.strokes_m[0] / float(np.median(system.wavelengths_m))
        self.adam = torch.optim.Adam([self.drive], lr=rate_rad / turn, betas=betas, eps=1e-20)

    def step(self) -> float:
        """Make one iteration (loss, gradient, Adam's step) and return the loss before the step."""
        loss = self.loss(self.drive)
        self.move(loss)
        return loss.item()

    def move(self, loss: Tensor) -> None:
        """Take Adam's step for a loss."""
        self.adam.zero_grad()
        loss.backward()
        self.adam.step()
        with torch.no_grad():
            self.drive.clamp_(0, 1)

    def loss(self, drive: Tensor) -> Tensor:
        return torch.nn.functional.mse_loss(self.image(self.intensities(drive)), self.target)

    def intensities(self, drive: Tensor) -> Tensor:
        """Intensity (wavelength, plane, y, x) of each laser at unit amplitude."""
        stacks = [torch.stack(self._intensities(i, drive)) for i in range(len(self.wavelengths_m))]
        return torch.stack(stacks)

    def image(self, intensities: Tensor) -> Tensor:
        """Linear sRGB (plane, channel, y, x)."""
        weights = torch.from_numpy(self.colours * self.amplitudes[:, None]).float()
        return torch.einsum("lc,lzyx->zcyx", weights, intensities)

    def phasor(self, modulator: int, λ: float, drive: Tensor) -> Tensor:
        """Transmission of a modulator on the simulation grid."""
        phase = (2 * math.pi * self.strokes_m[modulator] / λ) * drive[modulator]
        pixels = torch.polar(torch.ones_like(phase), phase)
        return pixels.repeat_interleave(self.upsample, dim=-2).repeat_interleave(self.upsample, dim=-1)

    @abstractmethod
    def _intensities(self, wavelength: int, drive: Tensor) -> list[Tensor]:
        """Intensity (y, x) of one laser at each plane."""


class Textbook(Autograd):
    """Angular-spectrum propagation as a function of field, distance and wavelength."""

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


class Cached(Autograd):
    """Stores all transfer functions, and computes the spectrum behind the last modulator once for all planes."""

    def __init__(self, work: Work, rate_rad: float = 1.0, betas: tuple[float, float] = (0.9, 0.99)) -> None:
        super().__init__(work, rate_rad, betas)
        gap_m = self.system.gap_m
        self._gaps = [] if gap_m is None else [self._transfer(λ, gap_m) for λ in self.wavelengths_m]
        self._relays = [[self._transfer(λ, z) for z in self.planes_m] for λ in self.wavelengths_m]

    def _intensities(self, wavelength: int, drive: Tensor) -> list[Tensor]:
        λ = self.wavelengths_m[wavelength]
        spectrum = torch.fft.fft2(self.phasor(0, λ, drive))
        if self._gaps:
            field = torch.fft.ifft2(spectrum * self._gaps[wavelength])
            spectrum = torch.fft.fft2(field * self.phasor(1, λ, drive))
        fields = [torch.fft.ifft2(spectrum * h) for h in self._relays[wavelength]]
        return [field.real.square() + field.imag.square() for field in fields]

    def _transfer(self, λ: float, distance_m: float) -> Tensor:
        fy, fx = (torch.fft.fftfreq(n, self.pitch_m, dtype=torch.float64) for n in self.shape)
        a = (λ * fy[:, None]).square() + (λ * fx[None, :]).square()
        phase = (2 * math.pi * distance_m / λ) * torch.sqrt((1 - a).clamp_min(0))
        return torch.where(a < 1, torch.polar(torch.ones_like(phase), phase), 0).to(torch.complex64)
