"""The reference executor: the stages of a frame in PyTorch, complex64 or complex128, on the CPU or a torch device.

`stage_field` gives the complex field at each of `System.stages`, without the carrier exp(2πi·z/λ) and the powers of the
lasers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from holoview.light.engine.frame import light_along, relay_behind, run_stages
from holoview.light.model.passband import Transfer
from holoview.light.model.plan import Beam, Plan, make_plan
from holoview.light.model.system import System
from holoview.light.numerics.fourier import PrunedAxis, PrunedTransform
from holoview.light.numerics.resample import upsample_nearest
from holoview.light.optics.bench import (
    PixelAxis,
    has_pixel_spectra,
    modulated,
    pixel_wave,
    plane_wave,
    relay_response,
    spectrum_of_pixels,
)
from holoview.light.optics.chain import ChainTransmissions
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.light.optics.torch_effects import SampledTransmissions
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
        self.transforms = [PrunedTransform(relay_axes(plan, relay)) for relay in range(len(plan.relays))]

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

    def transmit(self, spectrum: TorchField, relay: int, wavelength: int, plane: int = 0) -> TorchField:
        """spectrum × transfer function × pupil, over the gap (0) or to a plane (1)."""
        return TorchField(spectrum.values * self.transfer(relay, wavelength, plane))

    def field(self, spectrum: TorchField, relay: int) -> TorchField:
        """Inverse FFT of the spectrum behind a relay, cropped to the modulator's area."""
        return TorchField(self.transforms[relay].inverse(spectrum.values))

    @abstractmethod
    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> torch.Tensor:
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
    measures_power: keep `power_behind`, which takes one pass over each spectrum behind the last modulator.
    """

    def __init__(
        self,
        plan: Plan,
        inputs: FrameInputs,
        *,
        double: bool = False,
        device: str = "cpu",
        measures_power: bool = False,
    ) -> None:
        super().__init__(plan, inputs, double=double, device=device)
        self.inputs = inputs
        self.power_behind = np.zeros(len(plan.system.wavelengths_m)) if measures_power else None
        self._real = torch.float64 if double else torch.float32
        self._transfers: dict[tuple[int, int], torch.Tensor] = {}
        self._cached_wavelength = -1
        self._intensity: dict[int, torch.Tensor] = {}  # of each plane

    def run(self, wavelength: int) -> None:
        """Compute each plane's intensity at one wavelength, averaged over frames and sources."""
        if self.power_behind is None:
            run_stages(self, wavelength)
            return
        passed, powers = self.passed_amplitude(wavelength), list[float]()
        run_stages(
            self, wavelength, lambda spectrum, weight: powers.append(weight * spectrum_power(spectrum.values, passed))
        )
        self.power_behind[wavelength] = sum(powers) / math.prod(self.plan.grid.padded)

    def clear(self, plane: int) -> None:
        """Set the intensity of a plane to zero."""
        self._intensity[plane] = torch.zeros(self.plan.grid.shape, dtype=self._real, device=self._device)

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
        for plane, intensity in self._intensity.items():
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
            stacks.append(torch.stack([self._intensity[plane] for plane in range(len(self.plan.planes))]))
        return torch.stack(stacks, dim=1)

    @cached_property
    def _xyz(self) -> torch.Tensor:
        shape = len(self.plan.planes), *self.plan.grid.shape, 3
        return torch.zeros(shape, dtype=self._real, device=self._device)

    def transfer(self, relay: int, wavelength: int, plane: int = 0) -> torch.Tensor:
        """Transfer function × pupil at the frequencies of a relay; cached for one wavelength."""
        if wavelength != self._cached_wavelength:
            self._transfers.clear()
            self._cached_wavelength = wavelength
        key = (relay, plane)
        if key not in self._transfers:
            self._transfers[key] = self.derived_transfer(relay, wavelength, plane)
        return self._transfers[key]

    def derived_transfer(self, relay: int, wavelength: int, plane: int = 0) -> torch.Tensor:
        """`transfer` without its cache, which would hold every plane of a long series."""
        return self._response(self.plan.transfer(relay, wavelength, plane), relay, wavelength)

    def stops(self, wavelength: int, relay: int | None = None) -> torch.Tensor:
        """Stops × pupil of a relay, the last if None, at its frequencies, (rows, columns); of an eye its pupil's
        function alone."""
        relay = self.plan.way.last if relay is None else relay
        return self._response(self.plan.stops(relay, wavelength), relay, wavelength)

    def passed_amplitude(self, wavelength: int) -> torch.Tensor | None:
        """|Amplitude| that the last relay's stops and an eye's pupil pass at its frequencies, (rows, columns); None
        where all pass whole."""
        last = self.plan.way.last
        mask = torch.from_numpy(self.plan.passing(wavelength, *self.frequencies(last))).to(self._device, self._real)
        (ky, kx), pupil = self._frequency_tensors(last), self.inputs.pupils[last][wavelength]
        if pupil is None:
            return None if mask.all() else mask
        return mask * pupil.detach().to(ky.device)[ky][:, kx].abs().to(self._real)

    def _response(self, transfer: Transfer, relay: int, wavelength: int) -> torch.Tensor:
        pupil = self.inputs.pupils[relay][wavelength]
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


def spectrum_power(spectrum: torch.Tensor, passed: torch.Tensor | None) -> float:
    """Σ|passed·spectrum|² of (rows, columns); the rows are summed in double precision."""
    values = spectrum.detach() if passed is None else spectrum.detach() * passed
    return float(torch.linalg.vector_norm(torch.view_as_real(values), dim=(1, 2)).double().square().sum())


def relay_axes(plan: Plan, relay: int) -> tuple[PrunedAxis, PrunedAxis]:
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
    """The coherent light of one laser in one frame at a stage.

    values: (y, x) complex128; at "stop" and "pupil", phases count from the axis: the middle of the field.
    step: from one sample to the next, (y, x): m, or a direction sine where the light is known by direction.
    is_by_direction: whether it is. wavelength_m: of the light. origin: of the first sample, (y, x) from the axis, as
    `step`.
    share: of the light of the laser, frame and direction that was asked for, which effects may split into samples that
    add in intensity; `values` are then those of the central one. note: the same in words; empty without such effects.
    """

    stage: str
    values: NDArray[np.complex128]
    step: tuple[float, float]
    is_by_direction: bool
    wavelength_m: float
    origin: tuple[float, float]
    share: float = 1.0
    note: str = ""


def stage_field(
    system: System, drive: Any, stage: str, plane_m: float, *, laser: int = 0, frame: int = 0, source: int = 0
) -> StageField:
    """The field at a stage, in complex128.

    plane_m: the nominal focal plane, on which the stages behind relay 2 depend. laser, frame, source: indices of those
    of the system.

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
    beam, share = plan.central_beam(laser, frame, source)
    values = beam_at_stage(executor, beam, stage)
    is_by_direction = stage in ("stop", "pupil")
    λ, grid = float(plan.system.wavelengths_m[beam.wavelength]), plan.grid
    step_y, step_x = (λ * df for df in grid.frequency_step) if is_by_direction else (grid.pitch_m,) * 2
    first = (
        [k.min() for k in executor.frequencies(plan.way.last)] if is_by_direction else [(1 - n) / 2 for n in grid.shape]
    )
    origin = (float(first[0]) * step_y, float(first[1]) * step_x)
    note = _sample_note(plan, laser, frame, source, share)
    return StageField(stage, values, (step_y, step_x), is_by_direction, λ, origin, share, note)


def stage_xyz(system: System, drive: Any, stage: str, plane_m: float) -> NDArray[np.float64]:
    """XYZ (y, x, 3) of the intensity at a stage: the mean over frames and sources, of all lasers with their powers.

    stage, plane_m: as of `stage_field`. An eye doesn't count. Raises UserError as `stage_field` does.
    """
    stages = system.stages
    if stage not in stages:
        raise UserError("stage", f'"{stage}"', expected=", ".join(stages), remedy=suggest_matches(stage, stages))
    plan = make_plan(system.with_(eye=None), [*system.planes_m, plane_m])
    executor = TorchExecutor(plan, FrameInputs(plan, drive))
    total = np.zeros((1, 1, 3))
    for beam in plan.beams(range(len(plan.lasers))):
        power = beam.weight * np.abs(beam_at_stage(executor, beam, stage)) ** 2
        total = total + power[..., None] * plan.colour_weights[beam.wavelength]
    return total


def beam_at_stage(executor: TorchExecutor, beam: Beam, stage: str) -> NDArray[np.complex128]:
    """The field (y, x) of a beam at a stage, behind relay 2 on the way to the last plane."""
    wavelength = beam.wavelength
    if stage == "light":
        return executor.download_field(TorchField(_light(executor, beam))).astype(np.complex128)
    for landmark, field in light_along(executor, wavelength, beam.frame, beam.source):
        if landmark == stage or (stage, landmark) == ("field", "slm1"):
            return executor.download_field(field).astype(np.complex128)
    if stage == "stop":
        return _by_direction(executor, field.values * executor.stops(wavelength))
    last = executor.plan.way.last
    seen = executor.transmit(field, last, wavelength, len(executor.plan.planes) - 1)
    if stage == "pupil":
        return _by_direction(executor, seen.values)
    return executor.download_field(executor.field(seen, last)).astype(np.complex128)


def _by_direction(executor: TorchExecutor, spectrum: torch.Tensor) -> NDArray[np.complex128]:
    """A spectrum behind relay 2 in rising order of frequency, its phase counted from the middle of the field.

    The transform counts from the padded grid's first sample, so that the middle m of the field adds −k·m/P turns.
    """
    grid, values = executor.plan.grid, spectrum.numpy()
    for axis, k in enumerate(executor.frequencies(executor.plan.way.last)):
        middle = grid.offset[axis] + (grid.shape[axis] - 1) / 2
        phase = np.exp(2j * np.pi * np.remainder(k * middle / grid.padded[axis], 1.0))
        values = np.take(values * np.expand_dims(phase, 1 - axis), np.argsort(k), axis=axis)
    return values.astype(np.complex128)


def _light(executor: TorchExecutor, beam: Beam) -> torch.Tensor:
    """The light before the first modulator, (y, x): a plane wave with the effects on the source."""
    wave = plane_wave(executor.plan, beam.wavelength, beam.source, torch.complex128, torch.device("cpu"))
    transmissions = executor.inputs.sampled_transmissions
    if isinstance(transmissions, SampledTransmissions | ChainTransmissions):
        return transmissions.source_light(wave, beam.wavelength)
    return wave


def _sample_note(plan: Plan, laser: int, frame: int, source: int, share: float) -> str:
    """What a field is a sample of, in words; empty where it is all light of the laser, frame and direction."""
    parts = [
        f"{len(split.indices)} {what}"
        for split, what in (
            (plan.lasers[laser], "spectral lines"),
            (plan.directions[source], "points of the source"),
            (plan.frames[frame], "samples of the exposure"),
        )
        if len(split.indices) > 1
    ]
    if not parts:
        return ""
    return f"one sample of {' × '.join(parts)}, which add in intensity; it has {100 * share:.2g} % of the light"
