"""Renders a chain of elements on a device, stage by stage, with the interface of the incremental renderer.

    for each wavelength:  each frame and source ─▶ intensity, a submission each;  intensity ─▶ XYZ

Nothing is kept over an edit: the next update begins at the light source. A short form has the fused kernels instead.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.compositor import Compositor
from holoview.light.engine.frame import add_beam
from holoview.light.engine.incremental import LaserReadout, UpdateProgress
from holoview.light.engine.wgpu_executor import WgpuExecutor
from holoview.light.gpu.device import Buffer, Device
from holoview.light.model.plan import make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.optics.frame_inputs import FrameInputs


class StagedRenderer(LaserReadout):
    """Renders a chain at one focal plane, and again after each `edit`; `steps` submit little work each.

    drive: patterns (frame, y, x) of its elements by their names. plane_m, step_s, update_s, progress, xyz_buffer: as of
    `IncrementalRenderer`. Raises UserError as `make_plan`, `check_plan` and `FrameInputs` do, and if the grid exceeds
    the device's limits.
    """

    def __init__(self, system: System, drive: Any, device: Device, *, plane_m: float) -> None:
        self._device = device
        self.step_s: float | None = None
        self.update_s, self.progress = 0.0, 0.0
        self._set(system, drive, plane_m)

    def _set(self, system: System, drive: Any, plane_m: float) -> None:
        every = check_plan(make_plan(system, [*system.planes_m, plane_m]))  # so that padding that follows stays
        plan = replace(every, planes=every.planes[-1:], _transfers={})
        self._executor = WgpuExecutor(plan, FrameInputs(plan, drive), self._device)
        self._plan, self._generation = plan, getattr(self, "_generation", 0) + 1
        self.system, self.drive, self.plane_m = system, drive, plane_m
        self._is_done, self._intensities = False, dict[int, NDArray[np.float32]]()

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

    def steps(self) -> Iterator[UpdateProgress]:
        """Computes the picture, one submission for each step, for which it waits; ends early after an edit."""
        started, generation = time.perf_counter(), self._generation
        plan, executor, done, total = self._plan, self._executor, 0, self.pending_count()
        executor.clear_xyz()
        for wavelength in range(len(plan.system.wavelengths_m) if total else 0):
            executor.clear(0)
            for frame in plan.lit(wavelength):
                for source in range(len(plan.slopes)):
                    before, done = time.perf_counter(), done + 1
                    add_beam(executor, wavelength, frame, source)
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
