"""The stages of a chain in the compiled passes of `chain_kernels`, each with its adjoint for torch's derivatives.

`engine.frame` lists the stages; `CompiledChain` computes them. What leads from the pixels of an element to their
transmission is small, and torch's. Effects may change the samples of an element: then torch computes these, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from holoview.holograms.optimise.beams import FlatView, KeptRows, padded_rows, row_pitch, strided_view
from holoview.holograms.optimise.chain_executor import ChainExecutor
from holoview.holograms.optimise.chain_kernels import (
    filter_columns,
    modulate,
    power_behind,
    return_to_pixels,
    show_rows,
    slope_rows,
)
from holoview.holograms.optimise.parallel import MIN_SAMPLES_FOR_TEAM, ThreadTeam, thread_count
from holoview.holograms.optimise.vector_fft import LANES, has_fft
from holoview.holograms.optimise.vector_kernels import (
    line_to_band,
    line_to_window,
    transform_columns,
    transform_rows,
    write_phasors,
)
from holoview.light.engine.frame import relay_behind
from holoview.light.engine.torch_executor import TorchField, relay_axes
from holoview.light.model.elements import AmplitudeModulator, ComplexModulator, PhaseModulator, Pixels
from holoview.light.model.plan import Plan
from holoview.light.numerics.fourier import PrunedAxis
from holoview.light.numerics.sampling import ceil_div
from holoview.light.optics.bench import plane_wave
from holoview.light.optics.chain import ChainTransmissions, first_sample, pixel_transmission
from holoview.light.optics.frame_inputs import FrameInputs

Tensor = torch.Tensor
Place = tuple[int, int, int, int, int]
"""Rows and columns of pixels, samples of one along an axis, and the first sample (y, x) in the field."""


def fits_chain_passes(plan: Plan) -> bool:
    """Whether the passes compute a chain: FFTs without factors above 5, and light that fills a vector."""
    axes = [axis for relay in range(len(plan.relays)) for axis in relay_axes(plan, relay)]
    return all(has_fft(axis.padded) and min(axis.count, axis.frequencies) >= LANES for axis in axes)


@dataclass(frozen=True)
class _Unfiltered(TorchField):
    """The field before a relay, in place of its spectrum: the passes of a relay compute both. transfer: H, if known."""

    transfer: Tensor | None = None


class CompiledChain(ChainExecutor):
    """`ChainExecutor` in compiled passes, for a plan that they fit."""

    def __init__(self, plan: Plan, inputs: FrameInputs, *, double: bool = False) -> None:
        super().__init__(plan, inputs, double=double)
        team = ThreadTeam(self._device, thread_count(int(np.prod(plan.grid.padded)), MIN_SAMPLES_FOR_TEAM))
        like = torch.empty(0, dtype=self.dtype)
        self._passes = [_Passes(relay_axes(plan, relay), like, team) for relay in range(len(plan.relays))]

    def illuminate(self, wavelength: int, source: int) -> TorchField:
        """As there."""
        own = (wavelength, source) if self.plan.slopes.any() else (0, 0)  # all are 1 on the axis
        return TorchField(self._kept(self._wave, *own))

    def modulate(self, field: TorchField, frame: int, modulator: int, wavelength: int) -> TorchField:
        """As there."""
        return TorchField(_call(_Modulated, field.values, *self._pixels(frame, modulator, wavelength)))

    def spectrum(self, field: TorchField, modulator: int) -> TorchField:
        """As there, behind the last element; before a relay the field itself."""
        relay = relay_behind(self.plan, modulator)
        if relay < self.plan.way.last:
            return _Unfiltered(field.values)
        return TorchField(_call(_Spectrum, field.values, self._passes[relay]))

    def transmit(self, spectrum: TorchField, relay: int, wavelength: int, plane: int = 0) -> TorchField:
        """As there."""
        if isinstance(spectrum, _Unfiltered):
            return replace(spectrum, transfer=self.transfer(relay, wavelength, plane))
        return super().transmit(spectrum, relay, wavelength, plane)

    def field(self, spectrum: TorchField, relay: int) -> TorchField:
        """As there."""
        if isinstance(spectrum, _Unfiltered):
            return TorchField(_call(_Relayed, spectrum.values, spectrum.transfer, self._passes[relay]))
        return super().field(spectrum, relay)

    def intensities(self, behind: Iterable[tuple[list[TorchField], int]], planes: Sequence[int]) -> Tensor:
        """As there."""
        last, spectra, factors = self.plan.way.last, list[Tensor](), list[list[Tensor]]()
        for of_laser, λ in behind:
            spectra += [spectrum.values for spectrum in of_laser]
            factors += [[self.transfer(last, λ, plane) for plane in planes]] * len(of_laser)
        return _call(_Shown, factors, len(self.plan.slopes), self._passes[last], *spectra)

    def passed_power(self, spectrum: TorchField, wavelength: int) -> Tensor:
        """As there."""
        return _call(_Power, spectrum.values, self.passed(wavelength))

    def derived_transfer(self, relay: int, wavelength: int, plane: int = 0) -> Tensor:
        """As there, in rows for the passes."""
        return _in_rows(super().derived_transfer(relay, wavelength, plane))

    def _wave(self, wavelength: int, source: int) -> Tensor:
        return plane_wave(self.plan, wavelength, source, self.dtype, self._device)

    def _static(self, number: int, wavelength: int) -> Tensor:
        return self._transmissions.sampled_transmission(0, number, wavelength).to(self.dtype)

    @property
    def _transmissions(self) -> ChainTransmissions:
        transmissions = self.inputs.sampled_transmissions
        assert isinstance(transmissions, ChainTransmissions)
        return transmissions

    def _pixels(self, frame: int, number: int, wavelength: int) -> tuple[Tensor, Place]:
        """The transmission (y, x) at a step of the way, of pixels or of samples, and its place in the field."""
        of, grid = self.plan.way.transmissions[number], self.plan.grid
        elements = [e for e in (of.element, *of.beside) if isinstance(e, Pixels)]
        driven, whole = [e for e in elements if e.is_driven], (*grid.shape, 1, 0, 0)
        if not driven:
            return self._kept(self._static, number, wavelength), whole
        places = {(e.pitch_m, e.shape, e.offset_m) for e in elements}
        if self.plan.nominal.effects or len(driven) < 1 + len(of.beside) or len(places) > 1:
            samples = self._transmissions.sampled_transmission(frame, number, wavelength)
            return samples.to(self.dtype).contiguous(), whole
        first, *others = (self._of_pixels(element, frame, wavelength) for element in driven)
        pixels = torch.stack([first, *others]).mean(dim=0) if others else first
        size = round(driven[0].pitch_m / grid.pitch_m)
        shape = (int(pixels.shape[0]), int(pixels.shape[1]))
        return pixels, (*shape, size, *first_sample(self.plan, driven[0], (shape[0] * size, shape[1] * size)))

    def _of_pixels(self, element: Pixels, frame: int, wavelength: int) -> Tensor:
        """The transmission (y, x) of the pixels of an element without effects."""
        sent, λ = self._transmissions.sent(element, frame), float(self.plan.system.wavelengths_m[wavelength])
        if isinstance(element, PhaseModulator):
            return _call(_Phasors, sent, element.stroke_m / λ, self.dtype)
        if isinstance(element, ComplexModulator):
            return pixel_transmission(element, sent, λ).to(self.dtype)
        assert isinstance(element, AmplitudeModulator)
        passing: Tensor = element.amplitude_of(sent).to(self.dtype)
        return passing


# --- passes ----------------------------------------------------------------------------------------------------------


class _Passes:
    """The passes over fields (y, x) before or behind a relay, and its spectra (k_y, k_x), which are `padded_rows`."""

    def __init__(self, axes: tuple[PrunedAxis, PrunedAxis], like: Tensor, team: ThreadTeam) -> None:
        self._y, self._x = axes
        self._like, self._team, self._kept = like, team, KeptRows(like)
        double = like.dtype == torch.complex128
        to_band = [line_to_band(axis, forward=True, double=double) for axis in axes]
        to_window = [line_to_window(axis, forward=False, double=double) for axis in axes]
        self.y_lines, (self._x_to_band, self._x_to_window) = (to_band[0], to_window[0]), (to_band[1], to_window[1])
        self._number = np.float64 if double else np.float32
        self._scale = 1 / (self._y.padded * self._x.padded)

    def room(self, *planes: int) -> Tensor:
        """Room for fields (…, y, x)."""
        return _room(*planes, self._y.count, self._x.count, like=self._like)

    def filtered(self, field: Tensor, transfer: Tensor, sign: int) -> Tensor:
        """C·F⁻¹·H·F·Z of a field, of the conjugate of H where the sign is −1."""
        lines = self._to_lines(field)
        self._filter(lines, transfer, sign, lines, (True, True))
        return self._from_lines(lines)

    def to_spectrum(self, field: Tensor) -> Tensor:
        """F·Z of a field."""
        spectrum = _room(self._y.frequencies, self._x.frequencies, like=self._like)
        self._transform_columns(self._to_lines(field), strided_view(spectrum), self.y_lines[0])
        return spectrum

    def from_spectrum(self, spectrum: Tensor) -> Tensor:
        """Its adjoint."""
        lines = self._lines()
        self._transform_columns(strided_view(_in_rows(spectrum)), lines, self.y_lines[1])
        return self._from_lines(lines)

    def show(self, spectrum: Tensor, transfer: Tensor, field: Tensor, intensity: Tensor, *, adds: bool) -> None:
        """Writes the field of a spectrum behind H, and its intensity, or adds this."""
        lines, (of_field, (step,)), (shown, (shown_step,)) = self._lines(), *map(strided_view, (field, intensity))
        self._filter(strided_view(spectrum), transfer, 1, lines, (False, True))
        views = (lines[0], lines[1][0], of_field, step, shown, shown_step, adds)
        self._over_rows(lambda rows: show_rows(*views, rows, self._x_to_window))

    def add_slopes(self, field: Tensor, slopes: Tensor, transfer: Tensor, out: Tensor) -> None:
        """Adds the adjoint of `show`: of slopes by the intensity (y, x), those by the spectrum."""
        lines, (of_field, (step,)), (own, (own_step,)) = self._lines(), *map(strided_view, (field, slopes.contiguous()))
        views = (of_field, step, own, own_step, lines[0], lines[1][0])
        self._over_rows(lambda rows: slope_rows(*views, rows, self._x_to_band))
        self._filter(lines, transfer, -1, strided_view(out), (True, False))

    def _lines(self) -> FlatView:
        return self._kept.of("lines", self._y.count, self._x.frequencies).flat

    def _to_lines(self, field: Tensor) -> FlatView:
        lines = self._lines()
        self._transform_rows(strided_view(_in_rows(field)), lines, self._x_to_band)
        return lines

    def _from_lines(self, lines: FlatView) -> Tensor:
        field = self.room()
        self._transform_rows(lines, strided_view(field), self._x_to_window)
        return field

    def _transform_rows(self, source: FlatView, target: FlatView, line: Any) -> None:
        (values, (step,)), (out, (out_step,)) = source, target

        def transform(rows: tuple[int, int]) -> None:
            part, to = values[rows[0] * step :], out[rows[0] * out_step :]
            transform_rows(part, (0, 0, step), to, (0, 0, out_step), (1, 1, rows[1] - rows[0]), line)

        self._over_rows(transform)

    def _transform_columns(self, source: FlatView, target: FlatView, line: Any) -> None:
        (values, (step,)), (out, (out_step,)), one = source, target, self._number(1)

        def transform(columns: tuple[int, int]) -> None:
            part, to = values[2 * columns[0] :], out[2 * columns[0] :]
            transform_columns(part, (0, 0, step), to, (0, 0, out_step), (1, 1), columns[1] - columns[0], line, one)

        self._in_parts(transform, self._x.frequencies)

    def _filter(self, source: FlatView, transfer: Tensor, sign: int, target: FlatView, does: tuple[bool, bool]) -> None:
        factors, (factor_step,) = strided_view(transfer)
        scales = (self._number(self._scale), self._number(sign * self._scale))
        views = (source[0], source[1][0], factors, factor_step, scales, target[0], target[1][0])
        self._in_parts(lambda columns: filter_columns(*views, columns, *self.y_lines, does), self._x.frequencies)

    def _over_rows(self, function: Callable[[tuple[int, int]], None]) -> None:
        self._in_parts(function, self._y.count)

    def _in_parts(self, function: Callable[[tuple[int, int]], None], total: int) -> None:
        """Calls a function with parts of some rows or columns, whole vectors each, in the threads of the team."""
        size = ceil_div(ceil_div(total, LANES), self._team.size) * LANES
        self._team.map(function, [(start, min(start + size, total)) for start in range(0, total, size)])


def _room(*sizes: int, like: Tensor) -> Tensor:
    """`padded_rows` of any numbers, to be written."""
    return like.new_empty(*sizes[:-1], row_pitch(sizes[-1]))[..., : sizes[-1]]


def _in_rows(values: Tensor) -> Tensor:
    """The same as `padded_rows`, which it may be already."""
    values, (rows, count) = values.resolve_conj(), values.shape
    pitch = row_pitch(count)
    numbers = values.untyped_storage().nbytes() // values.element_size() - values.storage_offset()
    if values.stride() == (pitch, 1) and numbers >= rows * pitch:
        return values
    padded = padded_rows(rows, count, like=values)
    padded.copy_(values)
    return padded


# --- stages, and their adjoints --------------------------------------------------------------------------------------


def _call(stage: type[torch.autograd.Function], *arguments: Any) -> Tensor:
    result: Tensor = stage.apply(*arguments)  # type: ignore[no-untyped-call]
    return result


class _Phasors(torch.autograd.Function):
    """exp(2πi·turns·drive) (y, x) of a drive in float64."""

    @staticmethod
    def forward(ctx: Any, drive: Tensor, turns: float, dtype: torch.dtype) -> Tensor:
        pixels = torch.empty(drive.shape, dtype=dtype)
        drives, (step,), (out, (out_step,)) = *strided_view(drive.detach().contiguous()), strided_view(pixels)
        shape, first = (1, *drive.shape), np.zeros(1, np.int64)
        write_phasors(drives, 0, (0, 0, step), first, np.array([turns]), out, (0, out_step), shape)
        ctx.save_for_backward(pixels)
        ctx.turns = turns
        return pixels

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slopes: Tensor) -> tuple[Tensor, None, None]:
        (pixels,) = ctx.saved_tensors
        turned = slopes.imag * pixels.real - slopes.real * pixels.imag
        return turned.mul_(2 * np.pi * ctx.turns).double(), None, None


class _Modulated(torch.autograd.Function):
    """A field times the transmission of pixels at a place."""

    @staticmethod
    def forward(ctx: Any, field: Tensor, pixels: Tensor, place: Place) -> Tensor:
        out = _room(*field.shape, like=field)
        _modulate(field, pixels, place, out, conjugates=False)
        ctx.save_for_backward(field, pixels)
        ctx.place = place
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slopes: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        (field, pixels), of_field, of_pixels = ctx.saved_tensors, None, None
        slopes = slopes.resolve_conj()
        if ctx.needs_input_grad[0]:
            of_field = _room(*field.shape, like=field)
            _modulate(slopes, pixels, ctx.place, of_field, conjugates=True)
        if ctx.needs_input_grad[1]:
            of_pixels = torch.empty_like(pixels)
            (own, (step,)), (light, (light_step,)), (out, (out_step,)) = map(strided_view, (slopes, field, of_pixels))
            return_to_pixels(own, step, light, light_step, ctx.place, out, out_step)
        return of_field, of_pixels, None


def _modulate(field: Tensor, pixels: Tensor, place: Place, out: Tensor, *, conjugates: bool) -> None:
    (own, (step,)), (light, (light_step,)), (to, (to_step,)) = map(strided_view, (field, pixels, out))
    modulate(own, step, light, light_step, place, to, to_step, tuple(field.shape), conjugates)


class _Relayed(torch.autograd.Function):
    """The field behind a relay."""

    @staticmethod
    def forward(ctx: Any, field: Tensor, transfer: Tensor, passes: _Passes) -> Tensor:
        ctx.transfer, ctx.passes = transfer, passes
        return passes.filtered(field, transfer, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slopes: Tensor) -> tuple[Tensor, None, None]:
        return ctx.passes.filtered(slopes, ctx.transfer, -1), None, None


class _Spectrum(torch.autograd.Function):
    """The spectrum of a field in the band of a relay."""

    @staticmethod
    def forward(ctx: Any, field: Tensor, passes: _Passes) -> Tensor:
        ctx.passes = passes
        return passes.to_spectrum(field)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slopes: Tensor) -> tuple[Tensor, None]:
        return ctx.passes.from_spectrum(slopes), None


class _Shown(torch.autograd.Function):
    """The intensities (laser, plane, y, x) of spectra of so many sources each, behind transfer functions to planes.

    factors: of each spectrum those to all planes.
    """

    @staticmethod
    def forward(ctx: Any, factors: list[list[Tensor]], sources: int, passes: _Passes, *spectra: Tensor) -> Tensor:
        fields = [passes.room(len(factors[0])) for _ in spectra]
        intensity = torch.empty(len(spectra) // sources, *fields[0].shape, dtype=fields[0].real.dtype)
        for index, (spectrum, to_planes, of_spectrum) in enumerate(zip(spectra, factors, fields, strict=True)):
            laser, source = divmod(index, sources)
            own = _in_rows(spectrum)
            for transfer, field, shown in zip(to_planes, of_spectrum, intensity[laser], strict=True):
                passes.show(own, transfer, field, shown, adds=source > 0)
        ctx.fields, ctx.factors, ctx.passes = fields, factors, passes
        return intensity

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slopes: Tensor) -> tuple[Tensor | None, ...]:
        sources, out = len(ctx.fields) // len(slopes), []
        for index, (to_planes, of_spectrum) in enumerate(zip(ctx.factors, ctx.fields, strict=True)):
            sums = padded_rows(*to_planes[0].shape, like=of_spectrum)
            for transfer, field, own in zip(to_planes, of_spectrum, slopes[index // sources], strict=True):
                ctx.passes.add_slopes(field, own, transfer, sums)
            out.append(sums)
        return None, None, None, *out


class _Power(torch.autograd.Function):
    """|passed·W|² of a spectrum W, for real amplitudes that pass."""

    @staticmethod
    def forward(ctx: Any, spectrum: Tensor, passed: Tensor) -> Tensor:
        ctx.save_for_backward(spectrum, passed)
        powers = torch.empty(spectrum.shape, dtype=passed.dtype)
        (own, (step,)), (amplitudes, (passed_step,)) = strided_view(spectrum.detach()), strided_view(passed)
        power_behind(own, step, amplitudes, passed_step, powers.view(-1).numpy(), tuple(spectrum.shape))
        return powers

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slopes: Tensor) -> tuple[Tensor, None]:
        spectrum, passed = ctx.saved_tensors
        return spectrum * (2 * slopes * passed.square()), None
