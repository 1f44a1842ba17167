"""The reference executor: the stages of a frame in PyTorch, complex64 or complex128, on the CPU or a torch device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.engine.frame import relay_behind, run_stages
from holoview.model.plan import Plan
from holoview.numerics.fourier import PrunedAxis, PrunedTransform
from holoview.numerics.resample import upsample_nearest
from holoview.optics.frame_inputs import FrameInputs
from holoview.optics.propagate import transfer_function_at
from holoview.optics.slm import phasor, pixel_spectrum
from holoview.optics.source import pixel_wave, plane_wave


@dataclass(frozen=True)
class TorchField:
    """A field (y, x), or a spectrum (rows, columns) in the order of `TorchExecutor.frequencies`.

    pixels_of: wavelength and source of light behind the first modulator, if `values` holds only the first sample of
    each of its pixels. The other samples differ by the phase slope of the illumination.
    """

    values: torch.Tensor
    pixels_of: tuple[int, int] | None = None


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
        self._transforms = [PrunedTransform(_axes(plan, relay, 1)) for relay in (0, 1)]
        self._intensity = [self._zero_intensity() for _ in plan.planes_m]
        self._xyz = torch.zeros(len(plan.planes_m), *plan.grid.shape, 3, dtype=self._real, device=self._device)

    def run(self, wavelength: int) -> None:
        """Compute each plane's intensity at one wavelength, averaged over frames and sources."""
        run_stages(self, wavelength)

    def illuminate(self, wavelength: int, source: int) -> TorchField:
        """The plane wave of unit amplitude that illuminates the first modulator."""
        arguments = (self.plan, wavelength, source, self._dtype, self._device)
        if self._has_plain_pixels:
            return TorchField(pixel_wave(*arguments), (wavelength, source))
        return TorchField(plane_wave(*arguments))

    def modulate(self, field: TorchField, frame: int, modulator: int, wavelength: int) -> TorchField:
        """field × exp(2πi·opd/λ), or × the sampled transmission if effects give one."""
        sampled = self.inputs.transmission(frame, modulator, wavelength)
        if sampled is not None:
            return TorchField(field.values * sampled.to(self._dtype).to(self._device))
        opd = self.inputs.opd_m[frame, modulator].to(self._device)
        pixels = phasor(opd, float(self.plan.system.wavelengths_m[wavelength]), self._dtype)
        samples = pixels if field.pixels_of else upsample_nearest(pixels, self.plan.grid.upsample)
        return TorchField(field.values * samples, field.pixels_of)

    def spectrum(self, field: TorchField, modulator: int) -> TorchField:
        """Forward FFT of the zero-padded field behind a modulator, at the frequencies of the next relay's band."""
        relay = relay_behind(self.plan, modulator)
        if field.pixels_of is None:
            return TorchField(self._transforms[relay].forward(field.values))
        (ky, kx), axes = self.frequencies(relay), _axes(self.plan, relay, self.plan.grid.upsample)
        rows, columns = (
            torch.from_numpy((k - axis.lowest) % axis.padded).to(self._device)
            for k, axis in zip((ky, kx), axes, strict=True)
        )
        repeated = PrunedTransform(axes).forward(field.values)[rows][:, columns]
        one_pixel_y, one_pixel_x = (
            pixel_spectrum(padded, self.plan.grid.upsample, float(slope))[k % padded].to(self._dtype).to(self._device)
            for padded, slope, k in zip(
                self.plan.grid.padded, self.plan.slopes[field.pixels_of[1], field.pixels_of[0]], (ky, kx), strict=True
            )
        )
        return TorchField(repeated * one_pixel_y[:, None] * one_pixel_x)

    def transmit(self, spectrum: TorchField, relay: int, wavelength: int, distance_m: float) -> TorchField:
        """spectrum × transfer function × pupil."""
        return TorchField(spectrum.values * self.transfer(relay, wavelength, distance_m))

    def field(self, spectrum: TorchField, relay: int) -> TorchField:
        """Inverse FFT of the spectrum behind a relay, cropped to the modulator's area."""
        return TorchField(self._transforms[relay].inverse(spectrum.values))

    def clear(self, plane: int) -> None:
        """Set the intensity of a plane to zero."""
        self._intensity[plane] = self._zero_intensity()

    def accumulate(self, field: TorchField, plane: int, weight: float) -> None:
        """Add weight·|field|² to the intensity of a plane."""
        real, imaginary = field.values.real, field.values.imag
        self._intensity[plane] = self._intensity[plane] + weight * (real.square() + imaginary.square())

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
        """Transfer function × pupil at the frequencies of a relay; cached for one wavelength."""
        if wavelength != self._cached_wavelength:
            self._transfers.clear()
            self._cached_wavelength = wavelength
        key = (relay, distance_m)
        if key not in self._transfers:
            ky, kx = (torch.from_numpy(k).to(self._device) for k in self.frequencies(relay))
            pupil = self.inputs.pupils[relay][wavelength]
            precise = self._dtype if pupil is None else torch.complex128
            found = transfer_function_at(self.plan.transfer(relay, wavelength, distance_m), ky, kx, precise)
            if pupil is not None:
                rows, columns = (k % n for k, n in zip((ky, kx), self.plan.grid.padded, strict=True))
                found = (found * pupil.to(self._device)[rows][:, columns]).to(self._dtype)
            self._transfers[key] = found
        return self._transfers[key]

    def frequencies(self, relay: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Signed frequency indices of the rows and of the columns of a relay's spectra: those of `Plan.band`."""
        y, x = self._transforms[relay].axes
        return y.indices, x.indices

    def upload_field(self, values: NDArray[np.complexfloating]) -> TorchField:
        """A field (y, x), or a spectrum of a relay's band, as the input of a single stage."""
        return TorchField(torch.from_numpy(values).to(self._dtype).to(self._device))

    def download_field(self, field: TorchField) -> NDArray[np.complexfloating]:
        """The samples of a field (y, x), or a spectrum, on the host."""
        if field.pixels_of is None:
            return field.values.cpu().numpy()
        wave = [of(self.plan, *field.pixels_of, self._dtype, self._device) for of in (plane_wave, pixel_wave)]
        samples = upsample_nearest(field.values / wave[1], self.plan.grid.upsample) * wave[0]
        return samples.cpu().numpy()

    @property
    def _has_plain_pixels(self) -> bool:
        """Whether the field behind the first modulator follows from one sample for each pixel."""
        grid = self.plan.grid
        return not self.inputs.is_sampled(0) and all(padded % grid.upsample == 0 for padded in grid.padded)

    def _zero_intensity(self) -> torch.Tensor:
        return torch.zeros(self.plan.grid.shape, dtype=self._real, device=self._device)


def _axes(plan: Plan, relay: int, spacing: int) -> tuple[PrunedAxis, PrunedAxis]:
    """The axes of a relay's transform of each `spacing`-th sample."""
    grid, band = plan.grid, plan.band(relay)
    y, x = (
        PrunedAxis.for_band(padded // spacing, offset // spacing, count // spacing, lowest, highest)
        for padded, offset, count, lowest, highest in zip(
            grid.padded, grid.offset, grid.shape, band.lowest, band.highest, strict=True
        )
    )
    return y, x
