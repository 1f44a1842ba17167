"""The fused kernels of a frame, five a pair of modulators, bound to the inputs of a plan.

    light      source × modulator 1 → row FFT              → first rows
    propagate  column FFT × H of the gap → column IFFT
    modulate   row IFFT × modulator 2 → row FFT            → second rows
    propagate  column FFT × H to the plane → column IFFT
    observe    row IFFT → |field|² × weight                → intensity

Between kernels lie only the rows that hold the field, transformed along x: rows of zero padding are neither stored nor
transformed along x. With one modulator the first rows are the second ones.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from holoview.engine.device_tables import DeviceTables
from holoview.engine.kernels import (
    FIELD_TO_FIELD,
    KERNELS,
    FusedKernels,
    KernelVariant,
    Switches,
    field_samples,
    required_variants,
    works_in_place,
)
from holoview.engine.shader_structs import DISPATCH_PARAMS
from holoview.gpu.device import Buffer, Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.recorder import CommandRecorder, Dispatch
from holoview.model.plan import Plan

if TYPE_CHECKING:
    from holoview.optics.frame_inputs import AnyFrameInputs

_COMPLEX64, _COMPLEX32, _F32 = 8, 4, 4


@dataclass(frozen=True)
class WavelengthSpan:
    """What one dispatch computes: neighbouring wavelengths of a frame, lit from one source."""

    frame: int
    source: int
    wavelength: int
    count: int = 1


@dataclass(frozen=True)
class BufferRegion:
    """Where fields of a span are: the buffer, and the number of the first field in it."""

    buffer: Buffer
    first: int = 0


class FusedFrame:
    """Records the kernels of a frame of one plan; another plan on the same grid can take its place.

    half: store what lies between kernels as f16. together: the most wavelengths of a span. shaders: of this grid, where
    there are any yet.
    Raises UserError when the grid exceeds the device's limits.
    """

    def __init__(
        self,
        plan: Plan,
        inputs: AnyFrameInputs,
        device: Device,
        *,
        half: bool = False,
        max_wavelengths: int = 1,
        strategy: Strategy = "passes",
        fused_kernels: FusedKernels | None = None,
    ) -> None:
        self.device, self.grid, self.max_wavelengths = device, plan.grid, max_wavelengths
        grid = plan.grid
        self.field_bytes = field_samples(grid) * (_COMPLEX32 if half else _COMPLEX64)
        self.dispatch_counts: Counter[str] = Counter()
        self.fused_kernels = FusedKernels(device, grid, half=half) if fused_kernels is None else fused_kernels
        self.strategy = strategy
        self._passes: dict[Hashable, list[Dispatch]] = {}
        size = f"{grid.padded[1]} x {grid.shape[0]}"
        self._work = self._working_memory()
        self._scratch = [self.allocate_fields(f"rows of the field {i}, {size}") for i in (0, 1)]
        self.tables = DeviceTables(device, plan, inputs)

    def allocate_fields(self, label: str, fields: int | None = None) -> BufferRegion:
        """New storage for the rows of `fields` fields, those of a span by default."""
        return BufferRegion(self.device.buffer(self.field_bytes * (fields or self.max_wavelengths), label))

    @property
    def memory_bytes(self) -> int:
        """Memory that is needed to go from kernel to kernel."""
        return sum(rows.buffer.nbytes for rows in self._scratch) + (self._work.nbytes if self._work else 0)

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for one field, from the source to the intensity."""
        modulators = len(self.tables.plan.system.modulators)
        opd = modulators * math.prod(self.grid.shape) * _F32 // self.grid.upsample**2
        rows = (4 * modulators) * self.field_bytes
        return rows + opd + math.prod(self.grid.shape) * _F32

    @property
    def works_in_place(self) -> bool:
        """Whether `second` is best given the rows that `first` was, as its target."""
        return works_in_place(self.strategy)

    def use_strategy(self, strategy: Strategy) -> None:
        """Transform by another strategy from now on, which has spectra in its own order."""
        self.strategy = strategy
        self._passes.clear()
        self._work = self._working_memory()

    def required_variants(self) -> frozenset[KernelVariant]:
        """The kernels that the plan needs."""
        wavelengths = range(len(self.tables.plan.system.wavelengths_m))
        glass = [{self.tables.pupil(relay, w)[0] for w in wavelengths} for relay in (0, 1)]
        return required_variants(
            self.tables.plan, glass, [self.tables.inputs.is_sampled(modulator) for modulator in (0, 1)]
        )

    # --- kernels ----------------------------------------------------------------------------------------------------

    def record_first_modulator(
        self, recorder: CommandRecorder, span: WavelengthSpan, target: BufferRegion | None = None
    ) -> BufferRegion:
        """Records light behind modulator 1, transformed along x."""
        target = target or self._scratch[0]
        inputs = self.tables
        tilted = inputs.is_tilted(span.source, range(span.wavelength, span.wavelength + span.count))
        is_dense, dense = inputs.dense(span.frame, 0, span.wavelength)
        tables = [inputs.table("waves"), inputs.table("lights", 0), inputs.table("opd", span.frame, 0), dense]
        self._record_kernel(
            recorder, "light", span, None, target, tables, (("is_tilted", tilted), ("is_dense", is_dense))
        )
        return target

    def record_second_modulator(
        self, recorder: CommandRecorder, span: WavelengthSpan, first: BufferRegion, target: BufferRegion | None = None
    ) -> BufferRegion:
        """Records light behind modulator 2, transformed along x; with one modulator that is `first`."""
        if self.tables.plan.system.gap_m is None:
            return first
        target = target or (self._scratch[0] if self.works_in_place else self._scratch[1])
        self._propagate(recorder, span, 0, first, target)
        is_dense, dense = self.tables.dense(span.frame, 1, span.wavelength)
        tables = [self.tables.table("lights", 1), self.tables.table("opd", span.frame, 1), dense]
        self._record_kernel(recorder, "modulate", span, target, target, tables, (("is_dense", is_dense),))
        return target

    def record_intensity(
        self,
        recorder: CommandRecorder,
        span: WavelengthSpan,
        second: BufferRegion,
        intensity: BufferRegion,
        *,
        weight: float = 1.0,
        adds: bool = False,
    ) -> None:
        """Records weight·|field|² at the plane of relay 1 into slices of `intensity`, added to what is there or not."""
        seen = self._scratch[1] if second != self._scratch[1] else self._scratch[0]
        self._propagate(recorder, span, 1, second, seen)
        self._record_kernel(recorder, "observe", span, seen, intensity, [], (("adds", adds),), weight=weight)

    def _propagate(
        self, recorder: CommandRecorder, span: WavelengthSpan, relay: int, source: BufferRegion, target: BufferRegion
    ) -> None:
        has_pupil, pupil = self.tables.pupil(relay, span.wavelength)
        tables = [self.tables.table("paths", relay), self.tables.table("stops", relay), pupil]
        self._record_kernel(recorder, "propagate", span, source, target, tables, (("has_pupil", has_pupil),))

    def _record_kernel(
        self,
        recorder: CommandRecorder,
        kernel: str,
        span: WavelengthSpan,
        source: BufferRegion | None,
        target: BufferRegion,
        tables: Sequence[Buffer],
        constants: Switches = (),
        *,
        weight: float = 0.0,
    ) -> None:
        key = (kernel, span, source, target, *tables, constants, weight)
        if key not in self._passes:
            batch = DISPATCH_PARAMS.pack(
                wave=span.source * len(self.tables.plan.system.wavelengths_m) + span.wavelength,
                wavelength=span.wavelength,
                source_field=source.first if source else 0,
                target_field=target.first,
                work_field=source.first if source and kernel == "observe" else target.first,
                weight=weight,
            )
            two = kernel in FIELD_TO_FIELD and source != target
            rows = [source.buffer, target.buffer] if source and two else [(source or target).buffer, None]
            out = [target.buffer] if kernel == "observe" else []
            buffers = [self.device.uniform(batch, f"batch of {kernel}"), *rows, *tables, *out]
            transform = self.fused_kernels.transform((kernel, constants, two), self.strategy)
            lines = self.grid.shape[0] if transform.axis == "x" else self.grid.padded[1]
            self._passes[key] = transform.bind(buffers, lines, span.count, self._work)
        for step in self._passes[key]:
            recorder.add(step)
        self.dispatch_counts[kernel] += 1

    def _working_memory(self) -> Buffer | None:
        """What the transforms need besides the rows, if anything. Raises UserError for a size that has no transform."""
        transforms = (self.fused_kernels.transform((kernel, (), False), self.strategy) for kernel in KERNELS)
        nbytes = self.max_wavelengths * max(transform.work_bytes for transform in transforms)
        size = f"{self.grid.padded[1]} x {self.grid.padded[0]}"
        return self.device.buffer(nbytes, f"padded field, {size}") if nbytes else None


def group_into_spans(lit: Iterable[tuple[int, int]], max_wavelengths: int) -> list[WavelengthSpan]:
    """(frame, wavelength) in order as spans: neighbouring wavelengths of a frame, as many as may be `together`."""
    spans: list[WavelengthSpan] = []
    for frame, wavelength in lit:
        last = spans[-1] if spans else None
        follows = last is not None and (last.frame, last.wavelength + last.count) == (frame, wavelength)
        if last is not None and follows and wavelength % max_wavelengths:
            spans[-1] = replace(last, count=last.count + 1)
        else:
            spans.append(WavelengthSpan(frame, 0, wavelength))
    return spans
