"""Renders a chain of elements on a device by the fused kernels, with the interface of the incremental renderer.

    for each wavelength:  each frame and source ─▶ intensity, a submission each;  intensity ─▶ XYZ

Of each beam (wavelength, frame, source) the light behind one place of elements is kept: the last one before what the
latest edit changed. While the same thing goes on being edited, an update computes what lies behind it, with the same
bits. Beams for which memory has no room begin at the source. Unlike those of a short form, the tables of a chain, one
for each place, frame and wavelength, are made for one wavelength after the other.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.compositor import Compositor
from holoview.light.engine.fused import BufferRegion, WavelengthSpan
from holoview.light.engine.fused_kernels import FrameLayout
from holoview.light.engine.incremental import BUDGET_BYTES, LaserReadout, UpdateProgress
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import Buffer, Device
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.mailbox import Inputs, are_same


@dataclass(frozen=True, eq=False)
class _Kept:
    """The light of a beam right behind a place, and all that the latest update was computed from.

    inputs: of each place. layout: of the rows. place, rows: -1 and None if nothing is kept.
    """

    inputs: tuple[Inputs, ...]
    layout: FrameLayout
    place: int
    rows: BufferRegion | None


class StagedRenderer(LaserReadout):
    """Renders a chain at one focal plane, and again after each `edit`; `steps` submit little work each.

    drive: patterns (frame, y, x) of its elements by their names. plane_m, step_s, update_s, progress, xyz_buffer: as of
    `IncrementalRenderer`. Raises UserError as `make_plan`, `check_plan` and `FrameInputs` do, and if the grid exceeds
    the device's limits.
    """

    def __init__(self, system: System, drive: Any, device: Device, *, plane_m: float) -> None:
        self.device = device
        self.step_s: float | None = None
        self.update_s, self.progress = 0.0, 0.0
        self._set(system, drive, plane_m)

    def _set(self, system: System, drive: Any, plane_m: float) -> None:
        every = check_plan(make_plan(system, [*system.planes_m, plane_m]))  # so that padding that follows stays
        plan = replace(every, planes=every.planes[-1:], _transfers={})
        self._executor = WgpuExecutor(plan, FrameInputs(plan, drive), self.device)
        sizes = (plan.grid, plan.weights.shape, plan.slopes.shape)
        if getattr(self, "_sizes", None) != sizes:
            self._sizes, self._kept = sizes, dict[WavelengthSpan, _Kept]()
        self._plan, self._generation = plan, getattr(self, "_generation", 0) + 1
        self.system, self.drive, self.plane_m = system, drive, plane_m
        self._is_done, self._intensities = False, dict[int, NDArray[np.float32]]()

    @property
    def plan(self) -> Plan:
        """The plan of the picture: its plane alone, on the grid that fits all planes."""
        return self._plan

    @property
    def compositor(self) -> Compositor:
        """What holds the shape of the picture, and reads it."""
        return self._executor.compositor

    @property
    def xyz_buffer(self) -> Buffer:
        """XYZ, f32 (y, x, 4), of the last update."""
        return self._executor.xyz_buffer(0)

    def edit(self, *, system: System | None = None, drive: Any = None, plane_m: float | None = None) -> None:
        """Changes what is rendered, without computing anything. Raises UserError, and then nothing has changed."""
        new = (
            self.system if system is None else system,
            self.drive if drive is None else drive,
            self.plane_m if plane_m is None else plane_m,
        )
        if new[0] != self.system or new[1] is not self.drive or new[2] != self.plane_m:
            self._set(*new)

    def invalidate(self) -> None:
        """Forgets all light that is kept, so that the next update computes the whole picture."""
        self._kept = dict[WavelengthSpan, _Kept]()
        self._set(self.system, self.drive, self.plane_m)

    def steps(self) -> Iterator[UpdateProgress]:
        """Computes the picture, one submission for each step, for which it waits; ends early after an edit."""
        started, generation = time.perf_counter(), self._generation
        plan, executor, done, total = self._plan, self._executor, 0, self.pending_count()
        if not self._is_done:
            executor.clear_xyz()
        for wavelength in range(len(plan.system.wavelengths_m) if total else 0):
            executor.clear(0)
            for frame in plan.lit(wavelength):
                for source in range(len(plan.slopes)):
                    before, done, span = time.perf_counter(), done + 1, WavelengthSpan(frame, source, wavelength)
                    executor.add_light(span, self._light(span), accumulates=True)
                    if done < total:
                        executor.submit(wait=True)
                        self._measure(done / total, time.perf_counter() - before)
                        yield UpdateProgress(done, total)
                    if generation != self._generation:
                        return
            executor.composite(wavelength)
            executor.forget_beams()
        executor.submit(wait=True)
        self._is_done, self.progress, self.update_s = True, 1.0, time.perf_counter() - started
        yield UpdateProgress(total, total)

    def _light(self, span: WavelengthSpan) -> BufferRegion:
        """The light of a beam behind the last place, from the last place on that is kept and still true."""
        fused, recorder, kept = self._executor.fused, self._executor.recording(), self._kept.get(span)
        inputs, layout = _inputs(self._plan, self.drive, span), fused.layout
        true = len(inputs) if kept is None else _leading(kept.inputs, inputs)  # places with the same light as before
        rows, begin, keep_at = None, 0, true - 1
        if kept is not None and kept.layout == layout and kept.place < true:
            rows, begin = kept.rows, kept.place + 1
        kept_rows = self._room(keep_at, span) if keep_at >= begin else rows
        for place in range(begin, len(inputs)):
            target = kept_rows if place == keep_at else None
            if rows is None:
                rows = fused.record_first_place(recorder, span, target)
            else:
                rows = fused.record_place(recorder, span, place, rows, target)
        assert rows is not None
        self._kept[span] = _Kept(inputs, layout, keep_at if kept_rows else -1, kept_rows)
        return rows

    def _room(self, place: int, span: WavelengthSpan) -> BufferRegion | None:
        """New memory for the light of a beam behind a place; None if there is no room for it beside the other beams."""
        fused, others = self._executor.fused, (kept.rows for key, kept in self._kept.items() if key != span)
        rows = fused.rows_behind(place)
        used = sum(region.buffer.nbytes for region in others if region is not None)
        return fused.allocate_rows("kept light", rows) if used + fused.rows_bytes(rows) <= BUDGET_BYTES else None

    def _measure(self, progress: float, step_s: float) -> None:
        self.progress = progress
        self.step_s = step_s if self.step_s is None else 0.7 * self.step_s + 0.3 * step_s

    def pending_count(self, *, with_srgb: bool = False) -> int:
        """Number of submissions that an update still needs."""
        return 0 if self._is_done else int(np.count_nonzero(self._plan.weights)) * len(self._plan.slopes)

    def expected_s(self) -> float | None:
        """The time that an update will take; None before the time of a step was measured."""
        return None if self.step_s is None else self.pending_count() * self.step_s

    def xyz(self) -> NDArray[np.float32]:
        """XYZ (y, x, 3) of the last update."""
        return self.compositor.download_xyz(self.xyz_buffer)

    def _line_intensity(self, wavelength: int) -> NDArray[np.float32]:
        """Intensity (y, x) of a wavelength of the plan; an update of XYZ that is under way begins anew."""
        if wavelength not in self._intensities:
            self._generation += 1
            self._executor.run(wavelength)
            self._intensities[wavelength] = self._executor.intensity(0).astype(np.float32)
        return self._intensities[wavelength]

    def poll_strategy(self) -> bool:
        """Nothing: its transforms have one strategy."""
        return False

    def close(self) -> None:
        """Nothing: it has no search to end."""


def _leading(one: Sequence[Inputs], other: Sequence[Inputs]) -> int:
    """How many inputs at the beginning are the same."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((i for i, (a, b) in pairs if not are_same(a, b)), min(len(one), len(other)))


def _inputs(plan: Plan, drive: Any, span: WavelengthSpan) -> tuple[Inputs, ...]:
    """What the light of a beam depends on behind each place beyond what it does behind the one before.

    Effects may make any place depend on all of the bench but its planes, its eye and its patterns.
    """
    way, nominal, system = plan.way, plan.nominal, plan.system
    slopes = tuple(plan.slopes[span.source, span.wavelength])
    light: Inputs = (float(system.wavelengths_m[span.wavelength]), slopes, nominal.sampling)
    if nominal.effects:
        lasers = (tuple(nominal.wavelengths_m), tuple(nominal.amplitudes.ravel()), nominal.source)
        light = (*light, nominal.effects, nominal.elements, nominal.planes_from, *lasers)
    names = {id(e): name for e, name in zip(system.elements, system.element_names, strict=True)}
    found = []
    for relay, numbers in enumerate(way.places, -1):  # behind which the place stands
        if relay >= 0:
            light = (way.relays[relay], way.distances_m[relay], way.orders_m[relay], way.kernel(relay))
        for of in (way.transmissions[number] for number in numbers):
            arms = [names.get(id(e), "") for e in (of.element, *of.beside)]
            shown = [drive[name] for name in arms if name in drive] if isinstance(drive, Mapping) else [drive]
            light = (*light, of, *shown)
        found.append(light)
    return tuple(found)
