"""The WGSL executor: the stages of a frame as compute shaders on a WebGPU adapter.

Two padded fields are on the device. Every stage works in place but `transmit`, which writes to the other field, so that
the last spectrum survives for the next focal plane. Stages are recorded; reading an intensity submits them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from holoview.engine.layouts import GRID, LIGHT, PATH, RESPONSE, SHARE, WAVE
from holoview.gpu.device import Buffer, Device
from holoview.gpu.fft import FftPlan
from holoview.gpu.layout import Struct
from holoview.gpu.recorder import Pass, Recorder
from holoview.gpu.shader import Generated, link
from holoview.optics.slots import Slots
from holoview.plan import Plan, Transfer, fixed_turns

_WORKGROUP = 64
_F32, _VEC4 = 4, 16


@dataclass(frozen=True)
class GpuField:
    """One of the executor's two padded fields, in space or as a spectrum in the FFT's own order."""

    number: int
    is_spectrum: bool = False


class WgpuExecutor:
    """Runs the stages of a frame on a device. Raises UserError when the grid exceeds the device's limits."""

    def __init__(self, plan: Plan, slots: Slots, device: Device) -> None:
        self.plan, self.slots, self.device = plan, slots, device
        grid = plan.grid
        self._fft = FftPlan(device, grid.padded)
        size = f"{grid.padded[1]} x {grid.padded[0]}"
        self._fields = [device.buffer(self._fft.buffer_bytes, f"padded field {i}, {size}") for i in (0, 1)]
        pixels = math.prod(grid.shape)
        planes = range(len(plan.planes_m))
        self._intensity = [device.buffer(pixels * _F32, f"intensity of plane {i}") for i in planes]
        self._xyz = [device.buffer(pixels * _VEC4, f"XYZ of plane {i}") for i in planes]
        self._frequencies = [
            device.upload(np.ascontiguousarray(f, dtype=np.int32), "frequencies")
            for f in (self._fft.frequency_y, self._fft.frequency_x)
        ]
        self._no_pupil = device.upload(np.zeros(1, np.complex64), "no pupil")
        self._grid = device.uniform(
            GRID.pack(
                padded=grid.padded,
                shape=grid.shape,
                offset=grid.offset,
                stride=self._fft.stride,
                upsample=grid.upsample,
            ),
            "grid",
        )
        self._kept: dict[Hashable, Buffer] = {}
        self._passes: dict[Hashable, Pass] = {}
        self._recorder: Recorder | None = None

    def illuminate(self, wavelength: int, source: int) -> GpuField:
        """The plane wave that falls on the first modulator."""
        key = ("wave", wavelength, source)
        wave = self._uniform(key, WAVE, lambda: self._wave(wavelength, source))
        self._run(key, "stage/illuminate.wgsl", WAVE, [wave], [self._fields[0]], self.plan.grid.padded)
        return GpuField(0)

    def modulate(self, field: GpuField, frame: int, modulator: int, wavelength: int) -> GpuField:
        """field × exp(2πi·opd/λ), zero outside the modulator."""
        stroke_m = self.plan.system.modulators[modulator].stroke_m
        waves = stroke_m / float(self.plan.system.wavelengths_m[wavelength])
        light = self._uniform(("light", modulator, wavelength), LIGHT, lambda: {"waves": waves})
        opd = self._stored(("opd", frame, modulator), lambda: self._strokes(frame, modulator))
        key = ("modulate", frame, modulator, wavelength, field.number)
        buffers = [opd, self._fields[field.number]]
        self._run(key, "stage/modulate.wgsl", LIGHT, [light], buffers, self.plan.grid.padded)
        return field

    def spectrum(self, field: GpuField) -> GpuField:
        """Forward FFT; only the modulator's rows are transformed along x, the others are zero."""
        self._fft.forward(self._recording(), self._fields[field.number], rows=self._rows)
        return GpuField(field.number, is_spectrum=True)

    def transmit(self, spectrum: GpuField, relay: int, wavelength: int, distance_m: float) -> GpuField:
        """spectrum × H × pupil, into the other field."""
        step = self.plan.transfer(relay, wavelength, distance_m)
        key = ("transmit", relay, wavelength, distance_m, spectrum.number)
        path = self._uniform(key[:4], PATH, lambda: _path(step))
        support = self._stored(("support", *key[1:4]), lambda: step.support)
        pupil = self.slots.pupils[relay][wavelength]
        glass = self._no_pupil
        if pupil is not None:
            glass = self._stored(("pupil", relay, wavelength), lambda: pupil.cpu().numpy().astype(np.complex64))
        target = 1 - spectrum.number
        buffers = [*self._frequencies, support, glass, self._fields[spectrum.number], self._fields[target]]
        constants = {"has_pupil": pupil is not None}
        self._run(key, "stage/transmit.wgsl", PATH, [path], buffers, self.plan.grid.padded, constants)
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
        share = self._uniform(("share", weight), SHARE, lambda: {"weight": weight})
        key = ("accumulate", field.number, plane, weight)
        buffers = [self._fields[field.number], self._intensity[plane]]
        self._run(key, "stage/accumulate.wgsl", SHARE, [share], buffers, self.plan.grid.shape)

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
        weights = self.plan.colour_weights[wavelength]
        response = self._uniform(("response", wavelength), RESPONSE, lambda: {"xyz": [*weights, 0.0]})
        for plane, (intensity, seen) in enumerate(zip(self._intensity, self._xyz, strict=True)):
            key = ("composite", wavelength, plane)
            shape = self.plan.grid.shape
            self._run(key, "display/composite.wgsl", RESPONSE, [response], [intensity, seen], shape)

    def xyz(self) -> NDArray[np.floating]:
        """What the observer sees, XYZ (plane, y, x, 3) float32."""
        self.submit()
        shape = (*self.plan.grid.shape, 4)
        return np.stack([self.device.download(buffer, np.float32, shape)[..., :3] for buffer in self._xyz])

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
            fy, fx = (f % p for f, p in zip(self._orders, self.plan.grid.padded, strict=True))
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

    @property
    def _orders(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        return self._fft.frequency_y, self._fft.frequency_x

    @property
    def _rows(self) -> tuple[int, int]:
        return self.plan.grid.offset[0], self.plan.grid.shape[0]

    def _recording(self) -> Recorder:
        if self._recorder is None:
            self._recorder = Recorder(self.device, "frame")
        return self._recorder

    def _wave(self, wavelength: int, source: int) -> dict[str, object]:
        slopes = self.plan.slopes[source, wavelength]
        start = -float(np.dot(slopes, [(n - 1) / 2 for n in self.plan.grid.shape]))
        return {"slope_y": fixed_turns(slopes[0]), "slope_x": fixed_turns(slopes[1]), "start": fixed_turns(start)[0]}

    def _strokes(self, frame: int, modulator: int) -> NDArray[np.float32]:
        """Optical paths in strokes of the modulator (y, x), so that a float32 drive stays exact."""
        strokes = self.slots.opd_m[frame, modulator] / self.plan.system.modulators[modulator].stroke_m
        return strokes.float().cpu().numpy()

    def _uniform(self, key: Hashable, layout: Struct, values: Callable[[], dict[str, object]]) -> Buffer:
        """The uniform of that key; its values are made at the first call only."""
        if key not in self._kept:
            self._kept[key] = self.device.uniform(layout.pack(**values()), layout.name)
        return self._kept[key]

    def _stored(self, key: Hashable, array: Callable[[], NDArray[np.generic]]) -> Buffer:
        """The storage buffer of that key; its array is made at the first call only."""
        if key not in self._kept:
            self._kept[key] = self.device.upload(np.ascontiguousarray(array()), str(key))
        return self._kept[key]

    def _run(
        self,
        key: Hashable,
        shader: str,
        layout: Struct,
        uniforms: Sequence[Buffer],
        buffers: Sequence[Buffer],
        shape: tuple[int, int],
        constants: dict[str, bool] | None = None,
    ) -> None:
        """Records one stage over `shape` samples (y, x), bound once for each key."""
        if key not in self._passes:
            source = link(Generated("Grid", GRID.wgsl), Generated(layout.name, layout.wgsl), shader)
            pipeline = self.device.pipeline(source, constants)
            workgroups = (-(-shape[1] // _WORKGROUP), shape[0], 1)
            self._passes[key] = Pass.bind(self.device, pipeline, [[self._grid, *uniforms], list(buffers)], workgroups)
        self._recording().add(self._passes[key])


def _path(step: Transfer) -> dict[str, object]:
    words = step.paraxial_words()
    sine_step2 = [sine * sine for sine in step.sine_step]
    return {"paraxial_y": words[0], "paraxial_x": words[1], "sine_step2": sine_step2, "waves": step.waves}
