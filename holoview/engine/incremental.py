"""A hologram that is looked at while its bench is edited: after an edit, only what depends on it is computed again.

    first rows ─▶ second rows ─▶ intensity ─▶ XYZ ─▶ picture
    (frame, source, wavelength)  (frame, wavelength)

Each result is kept on the device with the identity of what it was computed from (`results.py`); it is stale when that
identity is no longer the one that the bench gives. There are no rules of what an edit invalidates beyond that:

    exposure                    the picture
    observer, amplitudes        XYZ and the picture: intensities are kept at unit amplitude
    focal plane, relay 2        from the second rows: one column FFT × H × column IFFT and one row IFFT a wavelength
    gap, relay 1, modulator 2   from the first rows
    one wavelength              that wavelength

What the memory budget has no room for is computed again when it is needed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor
from holoview.engine.device_tables import Fingerprint
from holoview.engine.fused import WavelengthSpan
from holoview.engine.kernels import FusedKernels
from holoview.engine.pending_work import Submission, Submitter, intensity_submissions, pending_submissions
from holoview.engine.result_cache import RenderSettings, ResultCache, has_no_dense_maps
from holoview.engine.shader_inputs import ShaderInputs
from holoview.engine.strategy_selector import StrategySelector
from holoview.gpu.device import Buffer, Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.timer import GpuTimer
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.optics.plain_inputs import plain_frame_inputs

BUDGET_BYTES = 2**30
"""Device memory for results that are kept, unless another budget is given."""


@dataclass(frozen=True)
class UpdateProgress:
    """Progress of an update: `done` of `total` submissions."""

    done: int
    total: int


class IncrementalRenderer:
    """One drive of one system at one focal plane, on a device, ready for edits.

    After `edit`, either `update` computes what is stale, or the caller goes through `steps`, a small submission each,
    and may drop the rest as soon as another edit comes. What is seen is on the device as `seen` (XYZ, f32, (y, x, 4))
    and `picture` (8-bit sRGB, `display.pitch` pixels a row, ready to be copied to a texture), and on the host from
    `xyz`, `srgb8` and `intensity`. A `timer`, where one is set, takes the time of all dispatches on the device.

    half: store fields as f16 between kernels. together: the most wavelengths that are computed at a time where no relay
    has a pupil; one makes the smallest steps, several occupy a large GPU better. strategy: of the transforms; "auto"
    starts with what is ready at once and, if `poll` is called now and then, goes on with the fastest as soon as that is
    compiled in the background. One that is named stays.
    Raises UserError as `make_plan` and `make_slots` do, and when the grid exceeds the device's limits.
    """

    def __init__(
        self,
        system: System,
        drive: Any,
        device: Device,
        *,
        plane_m: float | None = None,
        exposure_stops: float = 0.0,
        budget_bytes: int = BUDGET_BYTES,
        half: bool = False,
        max_wavelengths: int = 1,
        strategy: Strategy | Literal["auto"] = "auto",
    ) -> None:
        self.device = device
        self._settings, self._half = RenderSettings(budget_bytes, max_wavelengths), half
        self._drive, self._generation = drive, 0
        self._submitter = Submitter(device)
        self.plane_m = float(system.planes_m[0]) if plane_m is None else plane_m
        self.exposure_stops = exposure_stops
        self._plan = make_plan(system, [*system.planes_m, self.plane_m])
        self._pace = StrategySelector(device, strategy)
        shaders = self._precompile(self._plan)  # first, as making slots may have to import torch
        self._slots = _make_inputs(self._plan, drive)
        self._results = self._opened(self._plan, self._slots, shaders)
        self._apply_strategy(self._pace.strategy_for(self._results.frame.required_variants()))

    @property
    def system(self) -> System:
        """The bench as it was last edited."""
        return self._plan.nominal

    @property
    def dispatch_counts(self) -> Counter[str]:
        """How many fused kernels were dispatched, by name; `composite` and `show` among them."""
        return self._results.frame.dispatch_counts

    @property
    def compositor(self) -> Compositor:
        """What makes pictures, of which it tells the layout."""
        return self._results.compositor

    @property
    def xyz_buffer(self) -> Buffer:
        """XYZ on the device, f32, (y, x, 4)."""
        return self._results.xyz_buffer

    @property
    def srgb_buffer(self) -> Buffer:
        """The picture on the device, 8-bit RGBA, `display.pitch` pixels a row."""
        return self._results.srgb_buffer

    @property
    def memory_bytes(self) -> int:
        """Memory on the device that fields and intensities take."""
        return self._results.memory_bytes

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for a wavelength of a frame and a source, up to its intensity."""
        return self._results.frame.traffic_bytes

    @property
    def timer(self) -> GpuTimer | None:
        """Takes the time of all dispatches on the device, where one is set."""
        return self._submitter.timer

    @timer.setter
    def timer(self, timer: GpuTimer | None) -> None:
        self._submitter.timer = timer

    @property
    def strategy(self) -> Strategy:
        """Of the transforms, now."""
        return self._results.frame.strategy

    def edit(
        self,
        *,
        system: System | None = None,
        drive: Any = None,
        plane_m: float | None = None,
        exposure_stops: float | None = None,
    ) -> None:
        """Changes what is to be computed, and computes nothing. Results stay those of before until they are updated.

        Raises UserError when the change is impossible; then nothing has changed.
        """
        given = self.system if system is None else system
        plane = self.plane_m if plane_m is None else plane_m
        plan, slots = self._plan, self._slots
        if system is not None or plane_m is not None:
            plan = make_plan(given, [*given.planes_m, plane])
        if drive is not None or _inputs_fingerprint(plan) != _inputs_fingerprint(self._plan):
            slots = _make_inputs(plan, self._drive if drive is None else drive)
        if _structure(plan, slots) == _structure(self._plan, self._slots):
            self._results.set_plan(plan, slots, float(plan.planes_m[-1]))
        else:
            self._results = self._opened(plan, slots, self._precompile(plan))
        self._generation += 1
        self._plan, self._slots, self.plane_m = plan, slots, plane
        self._drive = self._drive if drive is None else drive
        self.exposure_stops = self.exposure_stops if exposure_stops is None else exposure_stops
        self._apply_strategy(self._pace.strategy_for(self._results.frame.required_variants()))

    def poll_strategy(self) -> bool:
        """Whether the transforms have just become faster: call it now and then, such as once a drawn frame.

        It never waits. Where the strategy is "auto", the first call begins to look for a faster one, in a process of
        its own. Results stay valid; an update that has begun goes on.
        """
        return self._apply_strategy(self._pace.poll(self._plan.grid.padded, self._results.frame))

    def close(self) -> None:
        """Ends the search for a faster strategy; the session stays of use."""
        self._pace.close()

    def update(self, *, with_srgb: bool = True) -> None:
        """Computes all that is stale, but not the picture without `picture`."""
        for _ in self.steps(with_srgb=with_srgb):
            pass

    def invalidate(self) -> None:
        """Everything is stale: the next update begins at the light source."""
        self._generation += 1
        self._results.invalidate()

    def steps(
        self, *, with_srgb: bool = True, wait: bool = False, slice_s: float | None = None
    ) -> Iterator[UpdateProgress]:
        """Computes what is stale, a submission a step; with `wait`, a step ends when the device has done it.

        With `slice_s`, a submission is cut into several of about so many seconds, waited for, and several steps have
        the same number. The iterator ends early once the session is edited, another iterator begins or an intensity is
        computed: what it has done stays, and the next one goes on from there.
        """
        self._generation += 1
        generation, work = self._generation, self._left(with_srgb)
        for done, job in enumerate(work, start=1):
            if slice_s is None:
                self._submitter.submit(job, wait=wait)
            else:
                for _ in self._submitter.submit_sliced(job, slice_s):
                    yield UpdateProgress(done - 1, len(work))
                    if generation != self._generation:
                        return
            yield UpdateProgress(done, len(work))
            if generation != self._generation:
                return

    def pending_count(self, *, with_srgb: bool = True) -> int:
        """How many submissions are left to do."""
        return len(self._left(with_srgb))

    def xyz_stack(self, planes_m: Sequence[float]) -> NDArray[np.float32]:
        """XYZ (plane, y, x, 3) at several planes, sharing all up to the second rows; the session's plane stays."""
        before, out = self.plane_m, []
        try:
            for plane_m in planes_m:
                self.edit(plane_m=plane_m)
                self.update()
                out.append(self.xyz())
        finally:
            self.edit(plane_m=before)
        return np.stack(out)

    def xyz(self) -> NDArray[np.float32]:
        """What the observer saw at the last update, XYZ (y, x, 3)."""
        return self.compositor.download_xyz(self.xyz_buffer)

    def srgb8(self) -> NDArray[np.uint8]:
        """The picture of the last update, sRGB (y, x, 3), 8 bit."""
        return self.compositor.download_srgb8(self.srgb_buffer)

    def intensity(self, wavelength: int) -> NDArray[np.float32]:
        """Intensity (y, x) of a wavelength as the bench is now: frames and sources averaged, amplitudes applied."""
        total = np.zeros(self._plan.grid.shape, np.float32)
        for frame in self._plan.lit(wavelength):
            lit = (frame, wavelength)
            if not self._results.is_current(lit):
                self._generation += 1
                for job in intensity_submissions(self._results, self._plan, WavelengthSpan(frame, 0, wavelength)):
                    self._submitter.submit(job)
            total += np.float32(self._plan.weights[lit]) * self._results.intensity(lit)
        return total

    # --- what has to be done ----------------------------------------------------------------------------------------

    def _left(self, picture: bool) -> list[Submission]:
        """What has to be submitted, in order."""
        return pending_submissions(self._results, self._plan, self.exposure_stops, picture=picture)

    def _precompile(self, plan: Plan) -> FusedKernels:
        """The shaders for the grid of a plan, which are being compiled."""
        shaders = FusedKernels(self.device, plan.grid, half=self._half)
        shaders.precompile(self._pace.initial_strategy(plan.grid.padded), plan)
        return shaders

    def _opened(self, plan: Plan, slots: ShaderInputs, shaders: FusedKernels) -> ResultCache:
        """Memory on the device for the results of a plan, none of which is known yet."""
        results = ResultCache(plan, slots, shaders, self._settings, self._pace.initial_strategy(plan.grid.padded))
        results.frame.tables.set_distance(1, float(plan.planes_m[-1]))
        return results

    def _apply_strategy(self, strategy: Strategy) -> bool:
        """Computes by that strategy from now on; whether it is another one."""
        if strategy == self.strategy:
            return False
        self._results.use_strategy(strategy)
        return True


def _make_inputs(plan: Plan, drive: Any) -> ShaderInputs:
    plain = plain_frame_inputs(plan, drive) if isinstance(drive, np.ndarray) else None
    if plain is not None:
        return plain
    from holoview.optics.frame_inputs import make_frame_inputs  # here, as it imports torch, which takes a second

    return make_frame_inputs(plan, drive)


def _structure(plan: Plan, slots: ShaderInputs) -> Fingerprint:
    """What decides how much memory is taken, and what the kernels are compiled for."""
    return plan.grid, plan.weights.shape, len(plan.slopes), len(plan.system.modulators), has_no_dense_maps(slots)


def _inputs_fingerprint(plan: Plan) -> Fingerprint:
    """What the slots of a drive depend on."""
    system = plan.system
    bench = (system.modulators, system.relay1, system.relay2, system.wavelengths_m.tobytes(), plan.grid, system.frames)
    return bench, plan.nominal.effects, plan.nominal.relay1, plan.nominal.relay2
