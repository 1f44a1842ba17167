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
from dataclasses import dataclass

from holoview.engine.display import padded_pixels
from holoview.engine.inputs import FrameInputs
from holoview.engine.layouts import BATCH, GRID, LIGHT, PATH, WAVE
from holoview.gpu.device import Buffer, Device
from holoview.gpu.fft_codegen import Direction
from holoview.gpu.layout import Struct
from holoview.gpu.lines import ROW_PADDING, Axis, Hooks, LineTransform, Stage, Strategy, storage
from holoview.gpu.recorder import Pass, Recorder
from holoview.gpu.shader import Generated
from holoview.optics.slots import Slots
from holoview.plan import Grid, Plan

_COMPLEX64, _COMPLEX32, _F32 = 8, 4, 4
Constants = tuple[tuple[str, bool], ...]
Variant = tuple[str, Constants, bool]
"""A kernel, its constants, and whether it reads one buffer and writes another."""


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

    half: store what lies between kernels as f16. together: the most wavelengths of a span.
    Raises UserError when the grid exceeds the device's limits.
    """

    def __init__(
        self,
        plan: Plan,
        slots: Slots,
        device: Device,
        *,
        half: bool = False,
        together: int = 1,
        strategy: Strategy = "passes",
    ) -> None:
        self.device, self.grid, self.together = device, plan.grid, together
        grid = plan.grid
        self.field_bytes = grid.shape[0] * row_stride(grid) * (_COMPLEX32 if half else _COMPLEX64)
        self.kernels: Counter[str] = Counter()
        self._half = half
        self.strategy = strategy
        self._transforms: dict[Hashable, LineTransform] = {}
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

    def use_strategy(self, strategy: Strategy) -> None:
        """Transform by another strategy from now on, which has spectra in its own order."""
        self.strategy = strategy
        self._transforms.clear()
        self._passes.clear()
        self._work = self._working_memory()

    def variants(self) -> frozenset[Variant]:
        """The kernels that the plan needs."""
        inputs, system = self.inputs, self.inputs.plan.system
        wavelengths = range(len(system.wavelengths_m))
        sources = range(len(inputs.plan.slopes))
        tilts = {inputs.is_tilted(source, range(w, w + 1)) for source in sources for w in wavelengths}
        found: set[Variant] = {("light", (("is_tilted", tilted),), False) for tilted in tilts}
        found.add(("observe", (), False))
        for relay in (1,) if system.gap_m is None else (0, 1):
            glass = {inputs.pupil(relay, wavelength)[0] for wavelength in wavelengths}
            found |= {("propagate", (("has_pupil", has),), two) for has in glass for two in {relay == 1, True}}
        if system.gap_m is not None:
            found.add(("modulate", (), False))
        return frozenset(found)

    def stages(self, strategy: Strategy, variants: Iterable[Variant]) -> list[Stage]:
        """All shaders of kernels by a strategy, such as to compile them somewhere else."""
        chosen = sorted(variants)
        transforms = (transform_of(self.device, self.grid, *v[:2], strategy, half=self._half, two=v[2]) for v in chosen)
        return [stage for transform in transforms for stage in transform.stages]

    # --- kernels ----------------------------------------------------------------------------------------------------

    def first(self, recorder: Recorder, span: Span, target: Rows | None = None) -> Rows:
        """Records light behind modulator 1, transformed along x."""
        target = target or self._scratch[0]
        inputs = self.inputs
        tilted = inputs.is_tilted(span.source, range(span.wavelength, span.wavelength + span.count))
        tables = [inputs.table("waves"), inputs.table("lights", 0), inputs.table("opd", span.frame, 0)]
        self._run(recorder, "light", span, None, target, tables, (("is_tilted", tilted),))
        return target

    def second(self, recorder: Recorder, span: Span, first: Rows, target: Rows | None = None) -> Rows:
        """Records light behind modulator 2, transformed along x; with one modulator that is `first`."""
        if self.inputs.plan.system.gap_m is None:
            return first
        target = target or self._scratch[0]
        self._propagate(recorder, span, 0, first, target)
        tables = [self.inputs.table("lights", 1), self.inputs.table("opd", span.frame, 1)]
        self._run(recorder, "modulate", span, target, target, tables)
        return target

    def observe(
        self, recorder: Recorder, span: Span, second: Rows, intensity: Rows, *, weight: float = 1.0, adds: bool = False
    ) -> None:
        """Records weight·|field|² at the plane of relay 1 into slices of `intensity`, added to what is there or not."""
        seen = self._scratch[1]
        self._propagate(recorder, span, 1, second, seen)
        self._run(recorder, "observe", span, seen, intensity, [], weight=weight, adds=adds)

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
        adds: bool = False,
    ) -> None:
        key = (kernel, span, source, target, *tables, constants, weight, adds)
        if key not in self._passes:
            batch = BATCH.pack(
                wave=span.source * len(self.inputs.plan.system.wavelengths_m) + span.wavelength,
                wavelength=span.wavelength,
                source_field=source.first if source else 0,
                target_field=target.first,
                work_field=source.first if source and kernel == "observe" else target.first,
                weight=weight,
                adds=adds,
            )
            two = kernel in _BETWEEN and source != target
            rows = [source.buffer, target.buffer] if source and two else [(source or target).buffer, None]
            out = [target.buffer] if kernel == "observe" else []
            buffers = [self.device.uniform(batch, f"batch of {kernel}"), *rows, *tables, *out]
            transform = self._transform(kernel, constants, two)
            lines = self.grid.shape[0] if transform.axis == "x" else self.grid.padded[1]
            self._passes[key] = transform.bind(buffers, lines, span.count, self._work)
        for step in self._passes[key]:
            recorder.add(step)
        self.kernels[kernel] += 1

    def _transform(self, kernel: str, constants: Constants, two: bool) -> LineTransform:
        key = (kernel, constants, two)
        if key not in self._transforms:
            options = {"half": self._half, "two": two}
            self._transforms[key] = transform_of(self.device, self.grid, kernel, constants, self.strategy, **options)
        return self._transforms[key]

    def _working_memory(self) -> Buffer | None:
        """What the transforms need besides the rows, if anything. Raises UserError for a size that has no transform."""
        nbytes = self.together * max(self._transform(kernel, (), False).work_bytes for kernel in KERNELS)
        size = f"{self.grid.padded[1]} x {self.grid.padded[0]}"
        return self.device.buffer(nbytes, f"padded field, {size}") if nbytes else None


KERNELS: dict[str, tuple[Axis, tuple[Direction, ...], tuple[Struct, ...]]] = {
    "light": ("x", ("forward",), (WAVE, LIGHT)),
    "propagate": ("y", ("forward", "inverse"), (PATH,)),
    "modulate": ("x", ("inverse", "forward"), (LIGHT,)),
    "observe": ("x", ("inverse",), ()),
}
"""Axis and directions of the transform, and the structs that its hooks take."""
_BETWEEN = ("propagate", "modulate")
"""Kernels that read fields and write fields: in place, or from one buffer to another."""


def transform_of(
    device: Device,
    grid: Grid,
    kernel: str,
    constants: Constants,
    strategy: Strategy,
    *,
    half: bool = False,
    two: bool = False,
) -> LineTransform:
    """A fused kernel: the transform of an axis between the hooks of `shaders/frame/<kernel>.wgsl`.

    half: fields are stored as f16. two: they are read from one buffer and written to another, else in place.
    Where the transform has several shaders, it uses the rows that it writes for what lies between them, if it can.
    """
    axis, steps, layouts = KERNELS[kernel]
    has_room = axis == "x" or grid.padded[0] == grid.shape[0]  # for whole lines, between the rows that are stored
    own_work = has_room and not half  # passes that round to f16 one after the other would cost 12 dB
    work = ("frame/work.wgsl",) if own_work else ()
    parts = (
        Generated("structs", GRID.wgsl + BATCH.wgsl + "".join(layout.wgsl for layout in layouts)),
        Generated("grid", _grid_wgsl(grid)),
        storage(device, half=half),
        f"frame/rows_{'two' if two else 'one'}.wgsl",
        *work,
        f"frame/{kernel}.wgsl",
    )
    return LineTransform(device, axis, grid.padded, steps, Hooks(kernel, parts, constants, own_work), strategy)


def row_stride(grid: Grid) -> int:
    """Complex numbers from row to row."""
    return grid.padded[1] + ROW_PADDING


def _grid_wgsl(grid: Grid) -> str:
    """WGSL constants of a grid, so that what depends on nothing else is evaluated by the compiler."""
    pairs = [f"vec2u({y}u, {x}u)" for y, x in (grid.padded, grid.shape, grid.offset)]
    return (
        f"const grid = Grid({', '.join(pairs)}, {row_stride(grid)}u, {grid.upsample}u);\n"
        f"const is_padded = {str(grid.padded != grid.shape).lower()};\n"
        f"const inverse_scale = {1 / math.prod(grid.padded):.12g};  // of an inverse transform along both axes\n"
        f"const slice_pixels = {padded_pixels(grid.shape)}u;  // from one intensity to the next\n"
    )
