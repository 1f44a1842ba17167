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

from holoview.engine.inputs import FrameInputs
from holoview.engine.kernels import (
    BETWEEN,
    KERNELS,
    Constants,
    Kernels,
    Variant,
    field_numbers,
    variants,
    works_in_place,
)
from holoview.engine.layouts import BATCH
from holoview.gpu.device import Buffer, Device
from holoview.gpu.lines import Strategy
from holoview.gpu.recorder import Pass, Recorder
from holoview.plan import Plan

if TYPE_CHECKING:
    from holoview.optics.slots import FrameSlots

_COMPLEX64, _COMPLEX32, _F32 = 8, 4, 4


@dataclass(frozen=True)
class Span:
    """What one dispatch computes: neighbouring wavelengths of a frame, lit from one source."""

    frame: int
    source: int
    wavelength: int
    count: int = 1


@dataclass(frozen=True)
class Rows:
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
        slots: FrameSlots,
        device: Device,
        *,
        half: bool = False,
        together: int = 1,
        strategy: Strategy = "passes",
        shaders: Kernels | None = None,
    ) -> None:
        self.device, self.grid, self.together = device, plan.grid, together
        grid = plan.grid
        self.field_bytes = field_numbers(grid) * (_COMPLEX32 if half else _COMPLEX64)
        self.kernels: Counter[str] = Counter()
        self.shaders = Kernels(device, grid, half=half) if shaders is None else shaders
        self.strategy = strategy
        self._passes: dict[Hashable, list[Pass]] = {}
        size = f"{grid.padded[1]} x {grid.shape[0]}"
        self._work = self._working_memory()
        self._scratch = [self.rows(f"rows of the field {i}, {size}") for i in (0, 1)]
        self.inputs = FrameInputs(device, plan, slots)

    def rows(self, label: str, fields: int | None = None) -> Rows:
        """New storage for the rows of `fields` fields, those of a span by default."""
        return Rows(self.device.buffer(self.field_bytes * (fields or self.together), label))

    @property
    def memory_bytes(self) -> int:
        """Memory that is needed to go from kernel to kernel."""
        return sum(rows.buffer.nbytes for rows in self._scratch) + (self._work.nbytes if self._work else 0)

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for one field, from the source to the intensity."""
        modulators = len(self.inputs.plan.system.modulators)
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

    def variants(self) -> frozenset[Variant]:
        """The kernels that the plan needs."""
        wavelengths = range(len(self.inputs.plan.system.wavelengths_m))
        glass = [{self.inputs.pupil(relay, w)[0] for w in wavelengths} for relay in (0, 1)]
        return variants(self.inputs.plan, glass, [self.inputs.slots.is_dense(modulator) for modulator in (0, 1)])

    # --- kernels ----------------------------------------------------------------------------------------------------

    def first(self, recorder: Recorder, span: Span, target: Rows | None = None) -> Rows:
        """Records light behind modulator 1, transformed along x."""
        target = target or self._scratch[0]
        inputs = self.inputs
        tilted = inputs.is_tilted(span.source, range(span.wavelength, span.wavelength + span.count))
        is_dense, dense = inputs.dense(span.frame, 0, span.wavelength)
        tables = [inputs.table("waves"), inputs.table("lights", 0), inputs.table("opd", span.frame, 0), dense]
        self._run(recorder, "light", span, None, target, tables, (("is_tilted", tilted), ("is_dense", is_dense)))
        return target

    def second(self, recorder: Recorder, span: Span, first: Rows, target: Rows | None = None) -> Rows:
        """Records light behind modulator 2, transformed along x; with one modulator that is `first`."""
        if self.inputs.plan.system.gap_m is None:
            return first
        target = target or (self._scratch[0] if self.works_in_place else self._scratch[1])
        self._propagate(recorder, span, 0, first, target)
        is_dense, dense = self.inputs.dense(span.frame, 1, span.wavelength)
        tables = [self.inputs.table("lights", 1), self.inputs.table("opd", span.frame, 1), dense]
        self._run(recorder, "modulate", span, target, target, tables, (("is_dense", is_dense),))
        return target

    def observe(
        self, recorder: Recorder, span: Span, second: Rows, intensity: Rows, *, weight: float = 1.0, adds: bool = False
    ) -> None:
        """Records weight·|field|² at the plane of relay 1 into slices of `intensity`, added to what is there or not."""
        seen = self._scratch[1] if second != self._scratch[1] else self._scratch[0]
        self._propagate(recorder, span, 1, second, seen)
        self._run(recorder, "observe", span, seen, intensity, [], (("adds", adds),), weight=weight)

    def _propagate(self, recorder: Recorder, span: Span, relay: int, source: Rows, target: Rows) -> None:
        has_pupil, pupil = self.inputs.pupil(relay, span.wavelength)
        tables = [self.inputs.table("paths", relay), self.inputs.table("stops", relay), pupil]
        self._run(recorder, "propagate", span, source, target, tables, (("has_pupil", has_pupil),))

    def _run(
        self,
        recorder: Recorder,
        kernel: str,
        span: Span,
        source: Rows | None,
        target: Rows,
        tables: Sequence[Buffer],
        constants: Constants = (),
        *,
        weight: float = 0.0,
    ) -> None:
        key = (kernel, span, source, target, *tables, constants, weight)
        if key not in self._passes:
            batch = BATCH.pack(
                wave=span.source * len(self.inputs.plan.system.wavelengths_m) + span.wavelength,
                wavelength=span.wavelength,
                source_field=source.first if source else 0,
                target_field=target.first,
                work_field=source.first if source and kernel == "observe" else target.first,
                weight=weight,
            )
            two = kernel in BETWEEN and source != target
            rows = [source.buffer, target.buffer] if source and two else [(source or target).buffer, None]
            out = [target.buffer] if kernel == "observe" else []
            buffers = [self.device.uniform(batch, f"batch of {kernel}"), *rows, *tables, *out]
            transform = self.shaders.transform((kernel, constants, two), self.strategy)
            lines = self.grid.shape[0] if transform.axis == "x" else self.grid.padded[1]
            self._passes[key] = transform.bind(buffers, lines, span.count, self._work)
        for step in self._passes[key]:
            recorder.add(step)
        self.kernels[kernel] += 1

    def _working_memory(self) -> Buffer | None:
        """What the transforms need besides the rows, if anything. Raises UserError for a size that has no transform."""
        transforms = (self.shaders.transform((kernel, (), False), self.strategy) for kernel in KERNELS)
        nbytes = self.together * max(transform.work_bytes for transform in transforms)
        size = f"{self.grid.padded[1]} x {self.grid.padded[0]}"
        return self.device.buffer(nbytes, f"padded field, {size}") if nbytes else None


def spans_of(lit: Iterable[tuple[int, int]], together: int) -> list[Span]:
    """(frame, wavelength) in order as spans: neighbouring wavelengths of a frame, as many as may be `together`."""
    spans: list[Span] = []
    for frame, wavelength in lit:
        last = spans[-1] if spans else None
        follows = last is not None and (last.frame, last.wavelength + last.count) == (frame, wavelength)
        if last is not None and follows and wavelength % together:
            spans[-1] = replace(last, count=last.count + 1)
        else:
            spans.append(Span(frame, 0, wavelength))
    return spans
