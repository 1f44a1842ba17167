"""The reference executor: the stages of a frame in PyTorch, complex64 or complex128, on the CPU or a torch device.

`stage_field` gives the complex field at each of `System.stages`, without the carrier exp(2πi·z/λ) and the powers of the
lasers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.engine.frame import relay_behind, run_stages
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.numerics.fourier import PrunedAxis, PrunedTransform
from holoview.numerics.resample import upsample_nearest
from holoview.optics.bench import (
    PixelAxis,
    has_pixel_spectra,
    modulated,
    pixel_wave,
    plane_wave,
    relay_response,
    spectrum_of_pixels,
)
from holoview.optics.frame_inputs import FrameInputs
from holoview.optics.torch_effects import SampledTransmissions
from holoview.util.errors import UserError, suggest_matches


@dataclass(frozen=True)
class TorchField:
    """A field (y, x), or a spectrum (rows, columns) in the order of `TorchPropagation.frequencies`.

    pixels_of: wavelength and source of light behind the first modulator, if `values` holds only the first sample of
    each of its pixels. The other samples differ by the phase slope of the illumination.
    """

    values: torch.Tensor
    pixels_of: tuple[int, int] | None = None


class ModulatorInputs(Protocol):
    """The patterns of the modulators: the part of `FrameInputs` that the stages need."""

    def path_m(self, frame: int, modulator: int) -> torch.Tensor:
        """Optical path (y, x) of a modulator's pixels, m, without effects on modulators."""

    def is_sampled(self, modulator: int) -> bool:
        """Whether the transmission of a modulator isn't exp(2πi·opd/λ) of its pixels."""

    def transmission(self, frame: int, modulator: int, wavelength: int) -> torch.Tensor | None:
        """The transmission (y, x) of a modulator's samples; None if it is exp(2πi·opd/λ) of its pixels."""


class TorchPropagation(ABC):
    """The stages that light passes, in PyTorch; differentiable with respect to the optical paths of the inputs.

    double: complex128 instead of complex64. device: of torch.

    transforms: between the samples of a field and the band of relay 0 and 1. dtype: of fields.
    """

    def __init__(
        self,
        plan: Plan,
        modulators: ModulatorInputs,
        *,
        double: bool = False,
        device: torch.device | str = "cpu",
    ) -> None:
        self.plan, self._modulators = plan, modulators
        self._device = torch.device(device)
        self.dtype = torch.complex128 if double else torch.complex64
        self.transforms = [PrunedTransform(_axes(plan, relay)) for relay in (0, 1)]

    def illuminate(self, wavelength: int, source: int) -> TorchField:
        """The plane wave of unit amplitude that illuminates the first modulator."""
        arguments = (self.plan, wavelength, source, self.dtype, self._device)
        if has_pixel_spectra(self.plan.grid) and not self._modulators.is_sampled(0):
            return TorchField(pixel_wave(*arguments), (wavelength, source))
        return TorchField(plane_wave(*arguments))

    def modulate(self, field: TorchField, frame: int, modulator: int, wavelength: int) -> TorchField:
        """field × exp(2πi·opd/λ), or × the sampled transmission if effects give one."""
        sampled = self._modulators.transmission(frame, modulator, wavelength)
        if sampled is not None:
            return TorchField(field.values * sampled.to(self.dtype).to(self._device))
        opd, λ = self._modulators.path_m(frame, modulator), float(self.plan.system.wavelengths_m[wavelength])
        upsample = 1 if field.pixels_of else self.plan.grid.upsample
        return TorchField(modulated(field.values, opd.to(self._device), λ, upsample), field.pixels_of)

    def spectrum(self, field: TorchField, modulator: int) -> TorchField:
        """Forward FFT of the zero-padded field behind a modulator, at the frequencies of the next relay's band."""
        relay = relay_behind(self.plan, modulator)
        if field.pixels_of is None:
            return TorchField(self.transforms[relay].forward(field.values))
        (wavelength, source), grid = field.pixels_of, self.plan.grid
        axes = [
            PixelAxis.at(grid, axis, float(self.plan.slopes[source, wavelength, axis]), k, self.dtype, first)
            for axis, (k, first) in enumerate(zip(self._frequency_tensors(relay), grid.offset, strict=True))
        ]
        return TorchField(spectrum_of_pixels(field.values, axes))

    def transmit(self, spectrum: TorchField, relay: int, wavelength: int, distance_m: float) -> TorchField:
        """spectrum × transfer function × pupil."""
        return TorchField(spectrum.values * self.transfer(relay, wavelength, distance_m))

    def field(self, spectrum: TorchField, relay: int) -> TorchField:
        """Inverse FFT of the spectrum behind a relay, cropped to the modulator's area."""
        return TorchField(self.transforms[relay].inverse(spectrum.values))

    @abstractmethod
    def transfer(self, relay: int, wavelength: int, distance_m: float) -> torch.Tensor:
        """Transfer function × pupil at the frequencies of a relay, (rows, columns)."""

    def frequencies(self, relay: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Signed frequency indices of the rows and of the columns of a relay's spectra: those of `Plan.band`."""
        y, x = self.transforms[relay].axes
        return y.indices, x.indices

    def _frequency_tensors(self, relay: int) -> tuple[torch.Tensor, torch.Tensor]:
        ky, kx = (torch.from_numpy(k).to(self._device) for k in self.frequencies(relay))
        return ky, kx


class TorchExecutor(TorchPropagation):
    """Computes a frame in PyTorch. Transfer functions are evaluated in float64.

    double: complex128 instead of complex64. device: name of a torch device.
    """

    def __init__(self, plan: Plan, inputs: FrameInputs, *, double: bool = False, device: str = "cpu") -> None:
        super().__init__(plan, inputs, double=double, device=device)
        self.inputs = inputs
        self._real = torch.float64 if double else torch.float32
        self._transfers: dict[tuple[int, float], torch.Tensor] = {}
        self._cached_wavelength = -1
        self._intensity = [self._zero_intensity() for _ in plan.planes_m]
        self._xyz = torch.zeros(len(plan.planes_m), *plan.grid.shape, 3, dtype=self._real, device=self._device)

    def run(self, wavelength: int) -> None:
        """Compute each plane's intensity at one wavelength, averaged over frames and sources."""
        run_stages(self, wavelength)

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
            self._transfers[key] = self.derived_transfer(relay, wavelength, distance_m)
        return self._transfers[key]

    def derived_transfer(self, relay: int, wavelength: int, distance_m: float) -> torch.Tensor:
        """`transfer` without its cache, which would hold every plane of a long series."""
        pupil, transfer = self.inputs.pupils[relay][wavelength], self.plan.transfer(relay, wavelength, distance_m)
        return relay_response(transfer, *self._frequency_tensors(relay), pupil, self.dtype)

    def upload_field(self, values: NDArray[np.complexfloating]) -> TorchField:
        """A field (y, x), or a spectrum of a relay's band, as the input of a single stage."""
        return TorchField(torch.from_numpy(values).to(self.dtype).to(self._device))

    def download_field(self, field: TorchField) -> NDArray[np.complexfloating]:
        """The samples of a field (y, x), or a spectrum, on the host."""
        if field.pixels_of is None:
            return field.values.cpu().numpy()
        wave = [of(self.plan, *field.pixels_of, self.dtype, self._device) for of in (plane_wave, pixel_wave)]
        samples = upsample_nearest(field.values / wave[1], self.plan.grid.upsample) * wave[0]
        return samples.cpu().numpy()

    def _zero_intensity(self) -> torch.Tensor:
        return torch.zeros(self.plan.grid.shape, dtype=self._real, device=self._device)


def _axes(plan: Plan, relay: int) -> tuple[PrunedAxis, PrunedAxis]:
    """The axes (y, x) of a relay's transform."""
    grid, band = plan.grid, plan.band(relay)
    y, x = (
        PrunedAxis.for_band(padded, offset, count, lowest, highest)
        for padded, offset, count, lowest, highest in zip(
            grid.padded, grid.offset, grid.shape, band.lowest, band.highest, strict=True
        )
    )
    return y, x


# --- the field at each stage ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class StageField:
    """The light of one laser in one frame at a stage.

    values: (y, x) complex128. step: from one sample to the next, (y, x): m, or a direction sine where the light is
    known by direction. is_by_direction: whether it is. wavelength_m: of the light.
    """

    stage: str
    values: NDArray[np.complex128]
    step: tuple[float, float]
    is_by_direction: bool
    wavelength_m: float


def stage_field(
    system: System, drive: Any, stage: str, plane_m: float, *, laser: int = 0, frame: int = 0, source: int = 0
) -> StageField:
    """The field at a stage, in complex128.

    plane_m: the focal plane, on which the stages behind relay 2 depend. laser, frame, source: their indices.

    Raises UserError for a stage that the system doesn't have, and as `make_plan` and `FrameInputs` do.
    """
    stages = system.stages
    if stage not in stages:
        raise UserError("stage", f'"{stage}"', expected=", ".join(stages), remedy=suggest_matches(stage, stages))
    for key, index, count in (
        ("laser", laser, len(system.wavelengths_m)),
        ("frame", frame, system.frames),
        ("source", source, len(system.source.directions_rad)),
    ):
        if not 0 <= index < count:
            raise UserError(key, f"{index + 1}", expected=f"1 to {count}")
    seen = system if stage in ("pupil", "retina") else system.with_(eye=None)
    plan = make_plan(seen, [*system.planes_m, plane_m])  # all planes: padding that follows from them stays the same
    executor = TorchExecutor(plan, FrameInputs(plan, drive), double=True)
    frame *= len(plan.moments)
    λ = float(plan.system.wavelengths_m[laser])
    if stage == "light":
        return _by_place(stage, executor, TorchField(_light(executor, laser, source)), λ)
    field = _behind_modulators(executor, executor.illuminate(laser, source), stage, frame, laser)
    if stage in stages[: stages.index("stop")]:
        return _by_place(stage, executor, field, λ)
    spectrum = executor.spectrum(field, len(plan.system.modulators) - 1)
    passed = executor.transmit(spectrum, 1, laser, 0.0 if stage == "stop" else plane_m)
    if stage in ("plane", "retina"):
        return _by_place(stage, executor, executor.field(passed, 1), λ)
    rows, columns = (np.argsort(k) for k in executor.frequencies(1))
    by_direction = passed.values.numpy()[np.ix_(rows, columns)]
    sine_y, sine_x = (λ * step for step in plan.grid.frequency_step)
    return StageField(stage, by_direction, (sine_y, sine_x), True, λ)


def _by_place(stage: str, executor: TorchExecutor, field: TorchField, wavelength_m: float) -> StageField:
    pitch_m = executor.plan.grid.pitch_m
    values = executor.download_field(field).astype(np.complex128)
    return StageField(stage, values, (pitch_m, pitch_m), False, wavelength_m)


def _light(executor: TorchExecutor, laser: int, source: int) -> torch.Tensor:
    """The light before the first modulator, (y, x): a plane wave with the effects on the source."""
    wave = plane_wave(executor.plan, laser, source, torch.complex128, torch.device("cpu"))
    transmissions = executor.inputs.sampled_transmissions
    return transmissions.source_light(wave, laser) if isinstance(transmissions, SampledTransmissions) else wave


def _behind_modulators(executor: TorchExecutor, light: TorchField, stage: str, frame: int, laser: int) -> TorchField:
    """The field behind the last modulator, or at an earlier stage."""
    system = executor.plan.system
    field = executor.modulate(light, frame, 0, laser)
    if stage == "slm1" or system.gap_m is None:
        return field
    field = executor.field(executor.transmit(executor.spectrum(field, 0), 0, laser, system.gap_m), 0)
    return field if stage == "gap" else executor.modulate(field, frame, 1, laser)
