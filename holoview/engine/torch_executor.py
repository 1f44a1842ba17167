"""The reference executor: the stages of a frame in PyTorch, complex64 or complex128, on the CPU or a torch device."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.engine.frame import run_stages
from holoview.model.plan import Plan
from holoview.numerics.resample import upsample_nearest
from holoview.optics.frame_inputs import FrameInputs
from holoview.optics.propagate import relay_transfer_function
from holoview.optics.slm import phasor
from holoview.optics.source import plane_wave


class TorchExecutor:
    """Computes a frame in PyTorch. Transfer functions are evaluated in float64.

    double: complex128 instead of complex64. device: name of a torch device.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, *, double: bool = False, device: str = "cpu") -> None:
        self.plan = plan
        self.inputs = inputs
        self._device = torch.device(device)
        self._dtype = torch.complex128 if double else torch.complex64
        self._real = torch.float64 if double else torch.float32
        self._transfers: dict[tuple[int, float], torch.Tensor] = {}
        self._cached_wavelength = -1
        self._intensity = [self._zero_intensity() for _ in plan.planes_m]
        self._xyz = torch.zeros(len(plan.planes_m), *plan.grid.shape, 3, dtype=self._real, device=self._device)

    def run(self, wavelength: int) -> None:
        """Compute each plane's intensity at one wavelength, averaged over frames and sources."""
        run_stages(self, wavelength)

    def illuminate(self, wavelength: int, source: int) -> torch.Tensor:
        """The plane wave of unit amplitude that illuminates the first modulator, (y, x)."""
        return plane_wave(self.plan, wavelength, source, self._dtype, self._device)

    def modulate(self, field: torch.Tensor, frame: int, modulator: int, wavelength: int) -> torch.Tensor:
        """field × exp(2πi·opd/λ), or × the sampled transmission if effects give one, (y, x)."""
        sampled = self.inputs.transmission(frame, modulator, wavelength)
        if sampled is not None:
            return field * sampled.to(self._dtype).to(self._device)
        opd = self.inputs.opd_m[frame, modulator].to(self._device)
        pixels = phasor(opd, float(self.plan.system.wavelengths_m[wavelength]), self._dtype)
        return field * upsample_nearest(pixels, self.plan.grid.upsample)

    def spectrum(self, field: torch.Tensor) -> torch.Tensor:
        """Forward FFT of the zero-padded field, (P_y, P_x)."""
        padded = torch.zeros(self.plan.grid.padded, dtype=self._dtype, device=self._device)
        padded[self.plan.grid.inside] = field
        return torch.fft.fft2(padded)

    def transmit(self, spectrum: torch.Tensor, relay: int, wavelength: int, distance_m: float) -> torch.Tensor:
        """spectrum × transfer function × pupil, (P_y, P_x)."""
        return spectrum * self.transfer(relay, wavelength, distance_m)

    def field(self, spectrum: torch.Tensor) -> torch.Tensor:
        """Inverse FFT, cropped to the modulator's area, (y, x)."""
        return torch.fft.ifft2(spectrum)[self.plan.grid.inside]

    def clear(self, plane: int) -> None:
        """Set the intensity of a plane to zero."""
        self._intensity[plane] = self._zero_intensity()

    def accumulate(self, field: torch.Tensor, plane: int, weight: float) -> None:
        """Add weight·|field|² to the intensity of a plane."""
        self._intensity[plane] = self._intensity[plane] + weight * (field.real.square() + field.imag.square())

    def intensity(self, plane: int) -> NDArray[np.floating]:
        """The accumulated intensity of a plane, (y, x)."""
        return self._intensity[plane].detach().cpu().numpy()

    def clear_xyz(self) -> None:
        """Set the XYZ of all planes to zero."""
        self._xyz.zero_()

    def composite(self, wavelength: int) -> None:
        """Add each plane's intensity at this wavelength, times the observer's response, to its XYZ."""
        for plane, intensity in enumerate(self._intensity):
            for channel, weight in enumerate(self.plan.colour_weights[wavelength].tolist()):
                self._xyz[plane, ..., channel].add_(intensity.detach(), alpha=weight)

    def xyz(self) -> NDArray[np.floating]:
        """CIE XYZ (plane, y, x, 3) of the wavelengths composited so far."""
        return self._xyz.cpu().numpy().copy()

    def intensity_tensor(self) -> torch.Tensor:
        """Intensity (plane, wavelength, y, x), differentiable with respect to the optical paths of the inputs."""
        stacks = []
        for wavelength in range(len(self.plan.system.wavelengths_m)):
            self.run(wavelength)
            stacks.append(torch.stack(self._intensity))
        return torch.stack(stacks, dim=1)

    def transfer(self, relay: int, wavelength: int, distance_m: float) -> torch.Tensor:
        """Transfer function × pupil of a relay, (P_y, P_x); cached for the frames and sources of one wavelength."""
        if wavelength != self._cached_wavelength:
            self._transfers.clear()
            self._cached_wavelength = wavelength
        key = (relay, distance_m)
        if key not in self._transfers:
            step = self.plan.transfer(relay, wavelength, distance_m)
            pupil = self.inputs.pupils[relay][wavelength]
            self._transfers[key] = relay_transfer_function(step, self.plan.grid, pupil, self._dtype, self._device)
        return self._transfers[key]

    def _zero_intensity(self) -> torch.Tensor:
        return torch.zeros(self.plan.grid.shape, dtype=self._real, device=self._device)
