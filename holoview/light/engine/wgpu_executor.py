"""The WebGPU executor: `run` computes a wavelength by fused kernels; each stage also has a kernel of its own.

Both use the same WGSL functions. The single stages exist for tests and benchmarks, which compare them with those of the
TorchExecutor one by one. They work on two padded fields: in place, except `transmit`, which writes to the other field,
so that the last spectrum stays valid for the next plane. Stages are only recorded; reading an intensity submits them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.compositor import Compositor
from holoview.light.engine.frame import relay_behind
from holoview.light.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.light.engine.fused_kernels import FusedKernels, frame_shape
from holoview.light.engine.shader_structs import (
    GRID,
    MODULATOR,
    PLANE_WAVE,
    PROPAGATION,
    WEIGHT,
    ShaderInputs,
    UniformValues,
    complex64,
    dense_transmission,
    modulator_uniform,
    plane_wave_uniform,
    propagation_uniform,
    support_table,
)
from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.fft import FftPlan
from holoview.light.gpu.line_fft import Strategy
from holoview.light.gpu.recorder import CommandRecorder, Dispatch
from holoview.light.gpu.shader import GeneratedWgsl, WgslStruct, link
from holoview.light.gpu.tune import remembered_strategy
from holoview.light.model.plan import Plan
from holoview.light.numerics.sampling import ceil_div

_WORKGROUP = 64


@dataclass(frozen=True)
class GpuField:
    """One of the executor's two padded fields, in space or as a spectrum in the order of the FFT.

    relay: of a spectrum, the relay that it enters or leaves; of its frequencies only those of the relay's band count.
    """

    index: int
    relay: int | None = None


class WgpuExecutor:
    """Computes a frame on a device. Raises UserError if the grid exceeds the device's limits.

    strategy: of the FFTs of single stages. Buffers of their tables have as labels what they hold: `wave WAVELENGTH
    SOURCE`, `dense FRAME MODULATOR WAVELENGTH`, `transmit`, `support RELAY WAVELENGTH PLANE`, `pupil RELAY WAVELENGTH`.
    single_stages: whether nothing but these is going to be asked for. measures_power: keep `power_behind`, of
    plans with more than one modulator; what is kept for all planes is read back for each wavelength.
    """

    def __init__(
        self,
        plan: Plan,
        inputs: ShaderInputs,
        device: Device,
        *,
        strategy: Strategy = "passes",
        single_stages: bool = False,
        measures_power: bool = False,
    ) -> None:
        self.plan, self.inputs, self.device, self._strategy = plan, inputs, device, strategy
        if not single_stages:
            _ = self.fused  # now, so that a grid beyond the device's limits is refused where another can be chosen
        self._compositor = Compositor(device, plan.grid.shape)
        planes = range(len(plan.planes))
        self._intensity = [self._compositor.intensity_buffer(1, f"intensity of plane {i}") for i in planes]
        self._xyz = [self._compositor.xyz_buffer(f"XYZ of plane {i}") for i in planes]
        self._buffers: dict[Hashable, Buffer] = {}
        self._dispatches: dict[Hashable, Dispatch] = {}
        self._recorder: CommandRecorder | None = None
        self.power_behind: NDArray[np.float64] | None = None
        if measures_power and self.fused.layout.shape.places > 1:
            self.power_behind = np.zeros(len(plan.system.wavelengths_m))

    @cached_property
    def fused(self) -> FusedFrame:
        """The fused kernels."""
        strategy = remembered_strategy(self.device, self.plan.grid.padded)
        shape = frame_shape(self.plan, has_plain_pixels=not self.inputs.is_sampled(0))
        kernels = FusedKernels(self.device, shape)  # not those that a device keeps, which would outlive it
        return FusedFrame(self.plan, self.inputs, self.device, strategy=strategy, fused_kernels=kernels)

    def run(self, wavelength: int) -> None:
        """Compute each plane's intensity at one wavelength, averaged over frames and sources."""
        sources = range(len(self.plan.slopes))
        spans = [WavelengthSpan(frame, source, wavelength) for frame in self.plan.lit(wavelength) for source in sources]
        for plane in range(len(self._intensity) if not spans else 0):
            self.clear(plane)
        for number, span in enumerate(spans):
            kept = self.fused.record_light(self._recording(), span)
            weight = float(self.plan.weights[span.frame, wavelength])
            if self.power_behind is not None:
                self.power_behind[wavelength] += weight * self._power(kept, wavelength)
            for plane, intensity in enumerate(self._intensity):
                self.submit()  # since set_plane affects all recorded work that isn't submitted
                self.fused.tables.set_plane(plane, [wavelength])
                target = BufferRegion(intensity)
                self.fused.record_intensity(
                    self._recording(), span, kept, target, weight=weight, accumulates=number > 0
                )
        if self.plan.way.is_chain:
            self.submit()
            self.fused.trim(0)  # since no wavelength is computed twice

    def _power(self, kept: BufferRegion, wavelength: int) -> float:
        """The power in the recorded spectrum behind the last place that the last relay's stops and an eye pass."""
        self.submit()
        ky, kx, spectrum = self.fused.download_spectrum(kept)
        pupil = self.inputs.pupils[self.plan.way.last][wavelength]
        passed = self.plan.passing(wavelength, ky, kx).astype(np.float32)
        if pupil is not None:
            passed *= np.abs(complex64(pupil)[np.ix_(ky, kx)])
        parts = (spectrum.real * passed, spectrum.imag * passed)
        rows = sum(np.einsum("yx,yx->y", part, part) for part in parts)
        return float(np.sum(rows, dtype=np.float64)) / math.prod(self.plan.grid.padded)

    # --- stage by stage ---------------------------------------------------------------------------------------------

    def illuminate(self, wavelength: int, source: int) -> GpuField:
        """The plane wave that illuminates the first modulator."""
        key = ("wave", wavelength, source)
        wave = self._uniform(key, PLANE_WAVE, lambda: plane_wave_uniform(self.plan, wavelength, source))
        self._record_stage(key, "stage/illuminate.wgsl", PLANE_WAVE, [wave], [self._fields[0]], self.plan.grid.padded)
        return GpuField(0)

    def modulate(self, field: GpuField, frame: int, modulator: int, wavelength: int) -> GpuField:
        """field × exp(2πi·opd/λ), or × the sampled transmission if effects give one; zero outside the modulator."""
        values = partial(modulator_uniform, self.plan, modulator, wavelength)
        uniform = self._uniform(("modulator", modulator, wavelength), MODULATOR, values)
        stroke_m = 1.0 if self.plan.way.is_chain else self.plan.system.modulators[modulator].stroke_m
        is_dense, opd, table = self.inputs.is_sampled(modulator), self._no_table, self._no_table
        if is_dense:
            frame = self.inputs.shown_first(frame, modulator)
            samples = partial(dense_transmission, self.inputs, frame, [modulator], wavelength)
            table = self._stored(("dense", frame, modulator, wavelength), samples)
        else:
            strokes = partial(self.inputs.stroke_fractions, frame, modulator, stroke_m)
            opd = self._stored(("opd", frame, modulator), strokes)
        key = ("modulate", frame, modulator, wavelength, field.index)
        buffers = [opd, table, self._fields[field.index]]
        constants = {"is_dense": is_dense}
        self._record_stage(key, "stage/modulate.wgsl", MODULATOR, [uniform], buffers, self.plan.grid.padded, constants)
        return field

    def spectrum(self, field: GpuField, modulator: int) -> GpuField:
        """Forward FFT; only the modulator's rows are transformed along x, since the others are zero."""
        self._fft.forward(self._recording(), self._fields[field.index], rows=self._rows)
        return GpuField(field.index, relay_behind(self.plan, modulator))

    def transmit(self, spectrum: GpuField, relay: int, wavelength: int, plane: int = 0) -> GpuField:
        """spectrum × transfer function × pupil, written to the other field."""
        step = self.plan.transfer(relay, wavelength, plane)
        key = ("transmit", relay, wavelength, plane, spectrum.index)
        propagation = self._uniform(key[:4], PROPAGATION, lambda: propagation_uniform(step))
        support = self._stored(("support", *key[1:4]), lambda: support_table(step, self.plan.grid))
        pupil = self.inputs.pupils[relay][wavelength]
        pupil_table = self._no_table
        if pupil is not None:
            samples = partial(complex64, pupil)
            pupil_table = self._stored(("pupil", relay, wavelength), samples)
        target = 1 - spectrum.index
        buffers = [*self._frequencies, support, pupil_table, self._fields[spectrum.index], self._fields[target]]
        constants = {"has_pupil": pupil is not None}
        padded = self.plan.grid.padded
        self._record_stage(key, "stage/transmit.wgsl", PROPAGATION, [propagation], buffers, padded, constants)
        return GpuField(target, relay)

    def field(self, spectrum: GpuField, relay: int) -> GpuField:
        """Inverse FFT; only the modulator's rows are valid."""
        self._fft.inverse(self._recording(), self._fields[spectrum.index], rows=self._rows)
        return GpuField(spectrum.index)

    def clear(self, plane: int) -> None:
        """Set the intensity of a plane to zero."""
        self._recording().clear(self._intensity[plane])

    def accumulate(self, field: GpuField, plane: int, weight: float) -> None:
        """Add weight·|field|² to the intensity of a plane."""
        self.add_intensity(field, BufferRegion(self._intensity[plane]), weight)

    def add_intensity(self, field: GpuField, to: BufferRegion, weight: float, *, accumulates: bool = True) -> None:
        """Add weight·|field|² to an intensity in a buffer of several, or store it there."""
        first = to.first * self._compositor.intensity_bytes // np.dtype(np.float32).itemsize
        params = self._uniform(("weight", weight, first), WEIGHT, lambda: {"weight": weight, "first": first})
        key = ("accumulate", field.index, to, weight, accumulates)
        buffers, constants = [self._fields[field.index], to.buffer], {"accumulates": accumulates}
        self._record_stage(key, "stage/accumulate.wgsl", WEIGHT, [params], buffers, self.plan.grid.shape, constants)

    def set_aside(self, field: GpuField) -> None:
        """Keep a field as it is: what is recorded from now on is computed in other memory."""
        self._fields[field.index] = self._new_field(field.index)
        self._dispatches = {}

    # --- results ----------------------------------------------------------------------------------------------------

    def intensity(self, plane: int) -> NDArray[np.floating]:
        """The accumulated intensity of a plane, (y, x) float32; submits the recorded work."""
        self.submit()
        return self.device.download(self._intensity[plane], np.float32, self.plan.grid.shape)

    def clear_xyz(self) -> None:
        """Set the XYZ of all planes to zero."""
        for buffer in self._xyz:
            self._recording().clear(buffer)

    def composite(self, wavelength: int) -> None:
        """Add each plane's intensity at this wavelength, times the observer's response, to its XYZ."""
        self.submit()  # since the weights affect all recorded work that isn't submitted
        term = (0, self.plan.colour_weights[wavelength])
        for intensity, xyz in zip(self._intensity, self._xyz, strict=True):
            self._compositor.composite(self._recording(), intensity, [term], xyz, base=xyz)

    def xyz(self) -> NDArray[np.floating]:
        """XYZ (plane, y, x, 3) float32; submits the recorded work."""
        self.submit()
        return np.stack([self._compositor.download_xyz(xyz) for xyz in self._xyz])

    @property
    def compositor(self) -> Compositor:
        """What adds intensities to XYZ."""
        return self._compositor

    def xyz_buffer(self, plane: int) -> Buffer:
        """XYZ of a plane, f32 (y, x, 4), on the device."""
        return self._xyz[plane]

    def submit(self, wait: bool = False) -> None:
        """Submit the recorded work; with `wait`, return after it has run."""
        if self._recorder is not None:
            self._recorder.submit(wait=wait)
            self._recorder = None

    def upload_field(self, values: NDArray[np.complexfloating], *, relay: int | None = None) -> GpuField:
        """Upload a field (y, x), or a spectrum of a relay's band, as the input of a single stage."""
        self.submit()
        padded = np.zeros(self.plan.grid.padded, np.complex64)
        if relay is None:
            padded[self.plan.grid.inside] = values
        else:
            padded[self._band_positions(relay)] = values
        self.device.write(self._fields[0], self._fft.pack(padded))
        return GpuField(0, relay)

    def download_field(self, field: GpuField) -> NDArray[np.complexfloating]:
        """A field (y, x), or a spectrum (rows, columns) of a relay's band, on the host.

        Frequencies are in rising order, or in the order of numpy.fft along an axis of which all frequencies pass.
        """
        self.submit()
        padded = self._fft.download(self._fields[field.index])[0]
        return padded[self.plan.grid.inside if field.relay is None else self._band_positions(field.relay)]

    def _band_positions(self, relay: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where the padded fields hold the frequencies of a relay's band: rows (A, 1) and columns (1, B)."""
        band, orders = self.plan.band(relay), (self._fft.frequency_y, self._fft.frequency_x)
        rows, columns = (
            np.argsort(order % n)[(np.arange(n) if high - low + 1 >= n else np.arange(low, high + 1)) % n]
            for order, n, low, high in zip(orders, self.plan.grid.padded, band.lowest, band.highest, strict=True)
        )
        return rows[:, None], columns[None, :]

    # --- resources of the single stages -----------------------------------------------------------------------------

    @cached_property
    def _fft(self) -> FftPlan:
        return FftPlan(self.device, self.plan.grid.padded, strategy=self._strategy)

    @cached_property
    def _fields(self) -> list[Buffer]:
        return [self._new_field(i) for i in (0, 1)]

    @property
    def field_bytes(self) -> int:
        """Memory of a padded field."""
        return self._fft.buffer_bytes

    def _new_field(self, index: int) -> Buffer:
        size = " x ".join(map(str, reversed(self.plan.grid.padded)))
        return self.device.buffer(self.field_bytes, f"padded field {index}, {size}")

    @cached_property
    def _frequencies(self) -> list[Buffer]:
        orders = (self._fft.frequency_y, self._fft.frequency_x)
        return [self.device.upload(np.ascontiguousarray(f, dtype=np.int32), "frequencies") for f in orders]

    @cached_property
    def _no_table(self) -> Buffer:
        return self.device.upload(np.zeros(1, np.complex64), "no table")

    @cached_property
    def _grid(self) -> Buffer:
        grid = self.plan.grid
        pairs = {"padded": grid.padded, "shape": grid.shape, "offset": grid.offset}
        return self.device.uniform(GRID.pack(**pairs, stride=self._fft.stride, upsample=grid.upsample), "grid")

    @property
    def _rows(self) -> tuple[int, int]:
        return self.plan.grid.offset[0], self.plan.grid.shape[0]

    def _recording(self) -> CommandRecorder:
        if self._recorder is None:
            self._recorder = CommandRecorder(self.device, "frame")
        return self._recorder

    def _uniform(self, key: tuple[Hashable, ...], struct: WgslStruct, values: Callable[[], UniformValues]) -> Buffer:
        """The uniform buffer of a key; its values are computed at the first call only."""
        if key not in self._buffers:
            self._buffers[key] = self.device.uniform(struct.pack(**values()), _label(key))
        return self._buffers[key]

    def _stored(self, key: tuple[Hashable, ...], array: Callable[[], NDArray[np.generic]]) -> Buffer:
        """The storage buffer of a key; its array is computed at the first call only."""
        if key not in self._buffers:
            self._buffers[key] = self.device.upload(np.ascontiguousarray(array()), _label(key))
        return self._buffers[key]

    def _record_stage(
        self,
        key: Hashable,
        shader: str,
        struct: WgslStruct,
        uniforms: Sequence[Buffer],
        buffers: Sequence[Buffer],
        shape: tuple[int, int],
        constants: dict[str, bool] | None = None,
    ) -> None:
        """Record a stage with one invocation for each of `shape` (y, x) samples; its buffers are bound once per key."""
        if key not in self._dispatches:
            source = link(GeneratedWgsl("Grid", GRID.wgsl), GeneratedWgsl(struct.name, struct.wgsl), shader)
            pipeline = self.device.pipeline(source, constants)
            workgroups = (ceil_div(shape[1], _WORKGROUP), shape[0], 1)
            groups = [[self._grid, *uniforms], list(buffers)]
            self._dispatches[key] = Dispatch.bind(self.device, pipeline, groups, workgroups)
        self._recording().add(self._dispatches[key])


def _label(key: tuple[Hashable, ...]) -> str:
    """The label of the buffer of a key, such as "dense 0 1 2"."""
    return " ".join(map(str, key))
