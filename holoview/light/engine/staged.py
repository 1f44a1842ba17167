"""Renders a chain of elements on a device, stage by stage, with the interface of the incremental renderer.

    for each wavelength:  each frame and source ─▶ intensity, a submission each;  intensity ─▶ XYZ

Of each beam (wavelength, frame, source) the light behind one element is kept: the last one before what the latest edit
changed. While the same thing goes on being edited, an update computes what lies behind it, with the same bits. Beams
for which memory has no room begin at the source. A short form has the fused kernels instead.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.compositor import Compositor
from holoview.light.engine.frame import add_light, light_along
from holoview.light.engine.incremental import BUDGET_BYTES, LaserReadout, UpdateProgress
from holoview.light.engine.wgpu_executor import GpuField, WgpuExecutor
from holoview.light.gpu.device import Buffer, Device
from holoview.light.model.chain import Modulate
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.optics.frame_inputs import FrameInputs
from holoview.util.mailbox import Inputs, are_same

Beam = tuple[int, int, int]
"""Wavelength, frame, source."""


@dataclass(frozen=True, eq=False)
class _Kept:
    """The light of a beam right behind an element, and all that the latest update was computed from.

    inputs: of the source, and of each step of the way. step: of the element; -1 if nothing is kept. field: its memory.
    """

    inputs: tuple[Inputs, ...]
    step: int = -1
    field: Buffer | None = None


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
            self._sizes, self._kept = sizes, dict[Beam, _Kept]()
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
        self._kept = dict[Beam, _Kept]()
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
                    before, done = time.perf_counter(), done + 1
                    add_light(executor, self._spectrum((wavelength, frame, source)), wavelength, frame)
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

    def _spectrum(self, beam: Beam) -> GpuField:
        """The spectrum of a beam behind the last element, from the last place on that is kept and still true."""
        executor, (wavelength, frame, source) = self._executor, beam
        inputs, kept = _inputs(self._plan, self.drive, beam), self._kept.get(beam)
        elements = [-1, *(i for i, step in enumerate(self._plan.way.steps) if isinstance(step, Modulate))]
        true = len(inputs) if kept is None else _leading(kept.inputs, inputs)  # as many entries as stayed the same
        keep_at = max(i for i in elements if i < max(true - 1, 0))
        step, copy = (-1, None) if kept is None else (kept.step, kept.field)
        behind = None
        if copy is not None and 0 <= step < true - 1:
            behind = (step, executor.restore(copy))
        elif copy is None and (len(self._kept) + 1) * executor.field_bytes > BUDGET_BYTES:
            keep_at = -1
        first = 0 if behind is None else step + 1
        for index, (_, field) in enumerate(light_along(executor, wavelength, frame, source, behind), first):
            if index == keep_at:
                copy = executor.copy_of(field, copy)
        self._kept[beam] = _Kept(inputs, keep_at, copy)
        return field

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


def _inputs(plan: Plan, drive: Any, beam: Beam) -> tuple[Inputs, ...]:
    """What the light of a beam depends on: at the source, and then at each step of the way.

    Effects may make any step depend on all of the bench but its planes, its eye and its patterns.
    """
    (wavelength, _, source), way, nominal = beam, plan.way, plan.nominal
    slopes = tuple(plan.slopes[source, wavelength])
    light: Inputs = (float(plan.system.wavelengths_m[wavelength]), slopes, nominal.sampling)
    if nominal.effects:
        lasers = (tuple(nominal.wavelengths_m), tuple(nominal.amplitudes.ravel()), nominal.source)
        light = (*light, nominal.effects, nominal.elements, nominal.planes_from, *lasers)
    names = {id(e): name for e, name in zip(plan.system.elements, plan.system.element_names, strict=True)}
    steps: list[Inputs] = [light]
    for step in way.steps:
        if isinstance(step, Modulate):
            of = way.transmissions[step.number]
            arms = [names.get(id(e), "") for e in (of.element, *of.beside)]
            shown = [drive[name] for name in arms if name in drive] if isinstance(drive, Mapping) else [drive]
            steps.append((of, *shown))
        else:
            number = step.relay
            steps.append((way.relays[number], way.distances_m[number], way.orders_m[number], way.kernel(number)))
    return tuple(steps)
