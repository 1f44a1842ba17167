"""The WGSL executor: a whole wavelength by fused kernels, or each stage of it by a kernel of its own.

Both are made of the same WGSL functions. The stages exist to be compared with torch's one by one: they work on two
padded fields, in place but `transmit`, which writes to the other field, so that the last spectrum survives for the next
plane. Stages are recorded; reading an intensity submits them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor
from holoview.engine.fused import BufferRegion, FusedFrame, WavelengthSpan
from holoview.engine.shader_structs import GRID, MODULATOR, PLANE_WAVE, PROPAGATION, WEIGHT
from holoview.engine.uniforms import (
    UniformValues,
    column_support,
    dense_transmission,
    modulator_uniform,
    plane_wave_uniform,
    propagation_uniform,
)
from holoview.gpu.device import Buffer, Device
from holoview.gpu.fft import FftPlan
from holoview.gpu.recorder import CommandRecorder, Dispatch
from holoview.gpu.shader import GeneratedWgsl, link
from holoview.gpu.tune import remembered_strategy
from holoview.gpu.wgsl_struct import WgslStruct
from holoview.model.plan import Plan
from holoview.optics.frame_inputs import FrameInputs

_WORKGROUP = 64


@dataclass(frozen=True)
class GpuField:
    """One of the executor's two padded fields, in space or as a spectrum in the FFT's own order."""

    number: int
    is_spectrum: bool = False


class WgpuExecutor:
    """Runs a frame on a device, fused or stage by stage. Raises UserError when the grid exceeds the device's limits."""

    def __init__(self, plan: Plan, inputs: FrameInputs, device: Device) -> None:
        self.plan, self.inputs, self.device = plan, inputs, device
        self._fused = FusedFrame(plan, inputs, device, strategy=remembered_strategy(device, plan.grid.padded))
        self._display = Compositor(device, plan.grid.shape)
        planes = range(len(plan.planes_m))
        self._intensity = [self._display.intensity_buffer(1, f"intensity of plane {i}") for i in planes]
        self._xyz = [self._display.xyz_buffer(f"XYZ of plane {i}") for i in planes]
        self._buffers: dict[Hashable, Buffer] = {}
        self._passes: dict[Hashable, Dispatch] = {}
        self._recorder: CommandRecorder | None = None

    def run(self, wavelength: int) -> None:
        """Leaves each plane's intensity at one wavelength in the executor, averaged over frames and sources."""
        rounds = [
            WavelengthSpan(f, s, wavelength) for f in self.plan.lit(wavelength) for s in range(len(self.plan.slopes))
        ]
        for plane in range(len(self._intensity) if not rounds else 0):
            self.clear(plane)
        for number, span in enumerate(rounds):
            recorder = self._recording()
            second = self._fused.record_second_modulator(
                recorder, span, self._fused.record_first_modulator(recorder, span)
            )
            weight = float(self.plan.weights[span.frame, wavelength])
            for plane, distance_m in enumerate(self.plan.planes_m.tolist()):
                self.submit()  # what is recorded still goes to the plane before
                self._fused.tables.set_distance(1, distance_m, [wavelength])
                target = BufferRegion(self._intensity[plane])
                self._fused.record_intensity(self._recording(), span, second, target, weight=weight, adds=number > 0)

    # --- stage by stage ---------------------------------------------------------------------------------------------

    def illuminate(self, wavelength: int, source: int) -> GpuField:
        """The plane wave that falls on the first modulator."""
        key = ("wave", wavelength, source)
        wave = self._uniform(key, PLANE_WAVE, lambda: plane_wave_uniform(self.plan, wavelength, source))
        self._record_stage(key, "stage/illuminate.wgsl", PLANE_WAVE, [wave], [self._fields[0]], self.plan.grid.padded)
        return GpuField(0)

    def modulate(self, field: GpuField, frame: int, modulator: int, wavelength: int) -> GpuField:
        """field × exp(2πi·opd/λ), or × the transmission that effects give the modulator; zero outside it."""
        values = lambda: modulator_uniform(self.plan, modulator, wavelength)  # noqa: E731
        light = self._uniform(("light", modulator, wavelength), MODULATOR, values)
        stroke_m = self.plan.system.modulators[modulator].stroke_m
        opd = self._stored(("opd", frame, modulator), lambda: self.inputs.stroke_fractions(frame, modulator, stroke_m))
        is_dense, table = self.inputs.is_sampled(modulator), self._no_table
        if is_dense:
            samples = partial(dense_transmission, self.inputs, frame, modulator, wavelength)
            table = self._stored(("dense", frame, modulator, wavelength), samples)
        key = ("modulate", frame, modulator, wavelength, field.number)
        buffers = [opd, table, self._fields[field.number]]
        constants = {"is_dense": is_dense}
        self._record_stage(key, "stage/modulate.wgsl", MODULATOR, [light], buffers, self.plan.grid.padded, constants)
        return field

    def spectrum(self, field: GpuField) -> GpuField:
        """Forward FFT; only the modulator's rows are transformed along x, the others are zero."""
        self._fft.forward(self._recording(), self._fields[field.number], rows=self._rows)
        return GpuField(field.number, is_spectrum=True)

    def transmit(self, spectrum: GpuField, relay: int, wavelength: int, distance_m: float) -> GpuField:
        """spectrum × H × pupil, into the other field."""
        step = self.plan.transfer(relay, wavelength, distance_m)
        key = ("transmit", relay, wavelength, distance_m, spectrum.number)
        path = self._uniform(key[:4], PROPAGATION, lambda: propagation_uniform(step))
        stops = self._stored(("stops", *key[1:4]), lambda: column_support(step, self.plan.grid))
        pupil = self.inputs.pupils[relay][wavelength]
        glass = self._no_table
        if pupil is not None:
            glass = self._stored(("pupil", relay, wavelength), lambda: pupil.cpu().numpy().astype(np.complex64))
        target = 1 - spectrum.number
        buffers = [*self._frequencies, stops, glass, self._fields[spectrum.number], self._fields[target]]
        constants = {"has_pupil": pupil is not None}
        self._record_stage(key, "stage/transmit.wgsl", PROPAGATION, [path], buffers, self.plan.grid.padded, constants)
        return GpuField(target, is_spectrum=True)

    def field(self, spectrum: GpuField) -> GpuField:
        """Inverse FFT; only the modulator's rows are valid."""
        self._fft.inverse(self._recording(), self._fields[spectrum.number], rows=self._rows)
        return GpuField(spectrum.number)

    def clear(self, plane: int) -> None:
        """Sets the intensity of a plane to zero."""
        self._recording().clear(self._intensity[plane])

    def accumulate(self, field: GpuField, plane: int, weight: float) -> None:
        """Adds weight·|field|² to the intensity of a plane."""
        share = self._uniform(("weight", weight), WEIGHT, lambda: {"weight": weight})
        key = ("accumulate", field.number, plane, weight)
        buffers = [self._fields[field.number], self._intensity[plane]]
        self._record_stage(key, "stage/accumulate.wgsl", WEIGHT, [share], buffers, self.plan.grid.shape)

    # --- what is seen -----------------------------------------------------------------------------------------------

    def intensity(self, plane: int) -> NDArray[np.floating]:
        """The accumulated intensity of a plane, (y, x) float32; runs what was recorded."""
        self.submit()
        return self.device.download(self._intensity[plane], np.float32, self.plan.grid.shape)

    def clear_xyz(self) -> None:
        """Sets what the observer sees to black."""
        for buffer in self._xyz:
            self._recording().clear(buffer)

    def composite(self, wavelength: int) -> None:
        """Adds each plane's intensity, at this wavelength, to what the observer sees."""
        self.submit()  # what is recorded still takes the weights of the wavelength before
        share = (0, self.plan.colour_weights[wavelength])
        for intensity, seen in zip(self._intensity, self._xyz, strict=True):
            self._display.composite(self._recording(), intensity, [share], seen, adds=True)

    def xyz(self) -> NDArray[np.floating]:
        """What the observer sees, XYZ (plane, y, x, 3) float32."""
        self.submit()
        return np.stack([self._display.download_xyz(seen) for seen in self._xyz])

    def submit(self, wait: bool = False) -> None:
        """Runs what was recorded."""
        if self._recorder is not None:
            self._recorder.submit(wait=wait)
            self._recorder = None

    def put(self, values: NDArray[np.complexfloating], *, is_spectrum: bool = False) -> GpuField:
        """A field (y, x) or spectrum (P_y, P_x), zero frequency first, on the device: to look at one stage alone."""
        self.submit()
        padded = np.zeros(self.plan.grid.padded, np.complex64)
        if is_spectrum:
            orders = (self._fft.frequency_y, self._fft.frequency_x)
            fy, fx = (f % p for f, p in zip(orders, self.plan.grid.padded, strict=True))
            padded[:] = values[fy[:, None], fx]
        else:
            padded[self.plan.grid.inside] = values
        self.device.write(self._fields[0], self._fft.pack(padded))
        return GpuField(0, is_spectrum)

    def get(self, field: GpuField) -> NDArray[np.complexfloating]:
        """A field as (y, x), a spectrum as (P_y, P_x) zero frequency first."""
        self.submit()
        padded = self._fft.download(self._fields[field.number])[0]
        return self._fft.natural_order(padded) if field.is_spectrum else padded[self.plan.grid.inside]

    # --- resources of the stages ------------------------------------------------------------------------------------

    @cached_property
    def _fft(self) -> FftPlan:
        return FftPlan(self.device, self.plan.grid.padded)

    @cached_property
    def _fields(self) -> list[Buffer]:
        size = " x ".join(map(str, reversed(self.plan.grid.padded)))
        return [self.device.buffer(self._fft.buffer_bytes, f"padded field {i}, {size}") for i in (0, 1)]

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

    def _uniform(self, key: Hashable, layout: WgslStruct, values: Callable[[], UniformValues]) -> Buffer:
        """The uniform of that key; its values are made at the first call only."""
        if key not in self._buffers:
            self._buffers[key] = self.device.uniform(layout.pack(**values()), layout.name)
        return self._buffers[key]

    def _stored(self, key: Hashable, array: Callable[[], NDArray[np.generic]]) -> Buffer:
        """The storage buffer of that key; its array is made at the first call only."""
        if key not in self._buffers:
            self._buffers[key] = self.device.upload(np.ascontiguousarray(array()), str(key))
        return self._buffers[key]

    def _record_stage(
        self,
        key: Hashable,
        shader: str,
        layout: WgslStruct,
        uniforms: Sequence[Buffer],
        buffers: Sequence[Buffer],
        shape: tuple[int, int],
        constants: dict[str, bool] | None = None,
    ) -> None:
        """Records one stage over `shape` samples (y, x), bound once for each key."""
        if key not in self._passes:
            source = link(GeneratedWgsl("Grid", GRID.wgsl), GeneratedWgsl(layout.name, layout.wgsl), shader)
            pipeline = self.device.pipeline(source, constants)
            workgroups = (-(-shape[1] // _WORKGROUP), shape[0], 1)
            self._passes[key] = Dispatch.bind(
                self.device, pipeline, [[self._grid, *uniforms], list(buffers)], workgroups
            )
        self._recording().add(self._passes[key])
