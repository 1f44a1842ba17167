"""The optimiser's rival: the same bench and loss in plain PyTorch, differentiated by autograd, with torch's Adam.

`Autograd` is the loss, the image and the step; `StoredLoop` the usual way to propagate: no FFT shifts, H computed once
in float64 with the stops in it, and one forward FFT for all planes. H is the transfer function. On a processor it loops
over wavelengths and planes, which is faster there than a batch; on a card all are one batch.

`ChainLoop` is the rival of a chain of elements, whose light both compute by the same stages, with H kept: there Adam's
step, the amplitudes and the choice of planes are compared, not the propagation.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import nnls

from holoview.holograms.optimise.chain_loop import ChainLight, ChainProblem
from holoview.holograms.optimise.propagation import TORCH_KERNELS
from holoview.holograms.optimise.settings import Settings
from holoview.light.colour import observer_weights, xyz_to_linear_srgb
from holoview.light.model.elements import ComplexModulator, PhaseModulator
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.optics.propagate import support_mask

Tensor = torch.Tensor


@dataclass(frozen=True)
class Work:
    """A test case: a bench of one frame, a target focal stack (plane, y, x, 3), a first drive (1, modulator, y, x).

    Of a chain a bench of any frames, and the first patterns by the names of elements. device: of torch, on which both
    compute.
    """

    system: System
    stack: NDArray[np.float32]
    drive: Any
    device: str = "cpu"


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
        self.device = torch.device(work.device)
        self.target = torch.from_numpy(work.stack).movedim(-1, 1).contiguous().to(self.device)
        self.drive = torch.tensor(work.drive[0], device=self.device, requires_grad=True)
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
        loss.backward()  # type: ignore[no-untyped-call]
        self.adam.step()
        with torch.no_grad():
            self.drive.clamp_(0, 1)

    def loss(self, drive: Tensor) -> Tensor:
        return self.loss_of(self.intensities(drive))

    def light(self) -> Tensor:
        """The intensities of the present patterns."""
        return self.intensities(self.drive)

    def loss_of(self, intensities: Tensor) -> Tensor:
        return torch.nn.functional.mse_loss(self.image(intensities), self.target)

    def wait(self) -> None:
        """Waits until a card has made the last step."""
        float(self.drive.detach().sum())

    def intensities(self, drive: Tensor) -> Tensor:
        """Intensity (wavelength, plane, y, x) of each laser at unit amplitude."""
        stacks = [torch.stack(self._intensities(i, drive)) for i in range(len(self.wavelengths_m))]
        return torch.stack(stacks)

    def image(self, intensities: Tensor) -> Tensor:
        """Linear sRGB (plane, channel, y, x)."""
        weights = torch.from_numpy(self.colours * self.amplitudes[:, None]).to(self.target)
        return torch.einsum("lc,lzyx->zcyx", weights, intensities)

    def phasor(self, modulator: int, λ: float | Tensor, drive: Tensor) -> Tensor:
        """Transmission of a modulator on the simulation grid; wavelengths (wavelength, 1, 1) give one for each."""
        phase = (2 * math.pi * self.strokes_m[modulator] / λ) * drive[modulator]
        pixels = torch.polar(torch.ones_like(phase), phase)
        return pixels.repeat_interleave(self.upsample, dim=-2).repeat_interleave(self.upsample, dim=-1)

    def solve_amplitudes(self, intensities: Tensor) -> None:
        """Sets the amplitudes to argmin over a ≥ 0 of |Σ a·colour·intensity − target|²."""
        light, targets = intensities.detach().flatten(1).double(), self.target.movedim(1, 0).flatten(1).double()
        gram = (light @ light.T).cpu().numpy() * (self.colours @ self.colours.T)
        right = np.einsum("lc,lc->l", self.colours, (light @ targets.T).cpu().numpy())
        root = np.linalg.cholesky(gram).T
        self.amplitudes = np.asarray(nnls(root, np.linalg.solve(root.T, right))[0])

    def psnr_db(self, intensities: Tensor) -> float:
        """PSNR (dB) of linear sRGB clipped to 0…1, mean over planes, as `IterationState.psnr_db`."""
        errors = (self.image(intensities.detach()).clamp(0, 1) - self.target.clamp(0, 1)).square().mean(dim=(1, 2, 3))
        return float(-10 * torch.log10(errors).mean())

    @abstractmethod
    def _intensities(self, wavelength: int, drive: Tensor) -> list[Tensor]:
        """Intensity (y, x) of one laser at each plane."""


class StoredLoop(Autograd):
    """Stores all transfer functions, and computes the spectrum behind the last modulator once for all planes."""

    def __init__(self, work: Work, rate_rad: float = 1.0, betas: tuple[float, float] = (0.9, 0.99)) -> None:
        super().__init__(work, rate_rad, betas)
        self._plan, gap_m, count = make_plan(self.system), self.system.gap_m, len(self.wavelengths_m)
        self._gaps = [] if gap_m is None else [self._transfer(0, i, 0, gap_m) for i in range(count)]
        self._relays = [[self._transfer(1, i, k, z) for k, z in enumerate(self.planes_m)] for i in range(count)]
        self.is_batched = self.device.type != "cpu"

    def intensities(self, drive: Tensor) -> Tensor:
        if not self.is_batched:
            return super().intensities(drive)
        λ = torch.tensor(self.wavelengths_m, device=self.device)[:, None, None]
        spectrum = torch.fft.fft2(self.phasor(0, λ, drive))
        if self._gaps:
            field = torch.fft.ifft2(spectrum * self._batch[0])
            spectrum = torch.fft.fft2(field * self.phasor(1, λ, drive))
        fields = torch.fft.ifft2(spectrum[:, None] * self._batch[1])
        return fields.real.square() + fields.imag.square()

    @cached_property
    def _batch(self) -> tuple[Tensor, Tensor]:
        """H of the gap (wavelength, y, x), empty without one, and to the planes (wavelength, plane, y, x)."""
        gaps = torch.stack(self._gaps) if self._gaps else torch.empty(0)
        return gaps, torch.stack([torch.stack(relays) for relays in self._relays])

    def _intensities(self, wavelength: int, drive: Tensor) -> list[Tensor]:
        λ = self.wavelengths_m[wavelength]
        spectrum = torch.fft.fft2(self.phasor(0, λ, drive))
        if self._gaps:
            field = torch.fft.ifft2(spectrum * self._gaps[wavelength])
            spectrum = torch.fft.fft2(field * self.phasor(1, λ, drive))
        fields = [torch.fft.ifft2(spectrum * h) for h in self._relays[wavelength]]
        return [field.real.square() + field.imag.square() for field in fields]

    def _transfer(self, relay: int, wavelength: int, plane: int, distance_m: float) -> Tensor:
        """H (y, x), zero outside the relay's stops."""
        λ = self.wavelengths_m[wavelength]
        fy, fx = (torch.fft.fftfreq(n, self.pitch_m, dtype=torch.float64) for n in self.shape)
        a = (λ * fy[:, None]).square() + (λ * fx[None, :]).square()
        phase = (2 * math.pi * distance_m / λ) * torch.sqrt((1 - a).clamp_min(0))
        kx = torch.fft.fftfreq(self.shape[1], 1 / self.shape[1]).round().long()
        passes = (a < 1) & support_mask(self._plan.transfer(relay, wavelength, plane), kx)
        return torch.where(passes, torch.polar(torch.ones_like(phase), phase), 0).to(torch.complex64).to(self.device)


class ChainLoop:
    """Minimises the same error over a focal stack of a chain by torch's Adam on the patterns of all its elements.

    rate_rad, betas: as of `Autograd`. Amplitudes and complex numbers, which have no phase at a wavelength, move by a
    fifth of this number, as they do beside the phases of the optimiser.
    """

    def __init__(self, work: Work, rate_rad: float = 1.0, betas: tuple[float, float] = (0.9, 0.99)) -> None:
        system, device = work.system, torch.device(work.device)
        self._problem = ChainProblem(system, work.stack, Settings(), work.device, kernels=TORCH_KERNELS)
        self._amplitudes = np.array(system.amplitudes)
        middle_m, groups = float(np.median(system.wavelengths_m)), []
        self._elements = dict(zip(system.element_names, system.elements, strict=True))
        self._variables: dict[str, Tensor] = {}
        for name, patterns in work.drive.items():
            own = torch.from_numpy(np.array(patterns)).to(device)
            variable = torch.view_as_real(own).clone() if own.is_complex() else own
            element = self._elements[name]
            turn = 2 * math.pi * element.stroke_m / middle_m if isinstance(element, PhaseModulator) else 5.0
            self._variables[name] = variable
            if not getattr(element, "held", False):
                groups.append({"params": [variable.requires_grad_()], "lr": rate_rad / turn})
        self._adam = torch.optim.Adam(groups, betas=betas, eps=1e-20)

    def light(self) -> ChainLight:
        """The light of all lasers at unit amplitude for the present patterns."""
        return self._problem.evaluate(self.patterns(), self._amplitudes)

    def patterns(self) -> dict[str, Tensor]:
        """The present patterns (frame, y, x) by the names of elements."""
        return {
            name: torch.view_as_complex(own) if isinstance(self._elements[name], ComplexModulator) else own
            for name, own in self._variables.items()
        }

    def loss_of(self, light: ChainLight) -> Tensor:
        """The loss of a light, with its graph."""
        return self._problem.loss(light, self._amplitudes)[0]

    def move(self, loss: Tensor) -> None:
        """Takes Adam's step for a loss, inside the ranges of the patterns."""
        self._adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._adam.step()
        with torch.no_grad():
            for name, own in self._variables.items():
                if isinstance(self._elements[name], ComplexModulator):
                    own /= torch.linalg.vector_norm(own, dim=-1, keepdim=True).clamp_min(1.0)
                else:
                    own.clamp_(0, 1)

    def wait(self) -> None:
        """Waits until a card has made the last step."""
        float(torch.stack([own.detach().sum() for own in self._variables.values()]).sum())

    def solve_amplitudes(self, light: ChainLight) -> None:
        """Sets the amplitudes to the best ones for a light."""
        self._amplitudes = self._problem.solved_amplitudes(light.intensity)

    def psnr_db(self, light: ChainLight) -> float:
        """PSNR (dB) as `IterationState.psnr_db`."""
        return self._problem.objective.psnr_db(self._problem.loss(light, self._amplitudes)[1])
