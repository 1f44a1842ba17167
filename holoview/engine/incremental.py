"""Re-renders an edited hologram: recomputes only the results that depend on the edit.

    first rows ─▶ second rows ─▶ intensity ─▶ XYZ ─▶ sRGB image
    (frame, source, wavelength)  (frame, wavelength)

The first and second rows are the fields behind the first and the last modulator, transformed along x (see `fused`).
Each result is stored on the device with a fingerprint of its inputs (`result_cache`). It is stale if the fingerprint
differs from that of the present bench; there are no other rules. It follows that these edits recompute:

    exposure                    the sRGB image
    observer, amplitudes        XYZ and the sRGB image, since intensities are stored at unit amplitude
    focal plane, relay 2        for each wavelength a column FFT, transfer function, column IFFT and row IFFT
    gap, relay 1, modulator 2   everything behind the first modulator
    one wavelength              that wavelength

Results for which the memory budget has no room are recomputed when they are needed.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.engine.compositor import Compositor
from holoview.engine.fused import Fingerprint, WavelengthSpan, group_into_spans
from holoview.engine.kernels import FusedKernels, frame_shape
from holoview.engine.result_cache import RenderSettings, ResultCache, has_no_dense_maps
from holoview.engine.shader_structs import ShaderInputs
from holoview.engine.strategy_selector import StrategySelector
from holoview.gpu.device import Buffer, Device
from holoview.gpu.line_fft import Strategy
from holoview.gpu.recorder import CommandRecorder, GpuTimer, SlicedRecorder
from holoview.gpu.tune import StrategyOption
from holoview.model.plan import Plan, make_plan
from holoview.model.system import System
from holoview.model.validity import check_plan
from holoview.optics.frame_inputs import FrameInputs

BUDGET_BYTES = 2**30
"""Default budget of device memory for stored fields and intensities."""


@dataclass(frozen=True)
class UpdateProgress:
    """Progress of an update: `done` of `total` submissions."""

    done: int
    total: int


class IncrementalRenderer:
    """Renders the drive of a system at one focal plane, and re-renders it after edits.

    After `edit`, either call `update`, or iterate over `steps`, which submit little work each, and stop as soon as the
    next edit arrives. Results are on the device as `xyz_buffer` and `srgb_buffer`, and on the host from `xyz`, `srgb8`
    and `intensity`.

    drive: (frame, modulator, y, x), fractions of the stroke from 0 to 1. plane_m: None for the system's first plane.
    half: store fields as f16 between kernels. max_wavelengths: how many wavelengths a dispatch computes if no relay has
    a pupil; 1 makes the shortest steps, more use a large GPU better. strategy: of the FFTs; "auto" starts with one that
    is ready immediately and changes to the fastest once that is compiled in the background, if `poll_strategy` is
    called regularly.

    step_s: running mean of the time for one of the `steps`, which is known where these wait; None before the first.
    update_s: duration of the last update, from its first step to its last.

    Raises UserError as `make_plan`, `check_plan` and `FrameInputs` do, and if the grid exceeds the device's limits.
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
        strategy: StrategyOption = "auto",
    ) -> None:
        self.device = device
        self._settings, self._half = RenderSettings(budget_bytes, max_wavelengths), half
        self._drive, self._generation = drive, 0
        self.step_s: float | None = None
        self.update_s = 0.0
        self._submitter = Submitter(device)
        self.plane_m = float(system.planes_m[0]) if plane_m is None else plane_m
        self.exposure_stops = exposure_stops
        self._plan = check_plan(make_plan(system, [*system.planes_m, self.plane_m]))
        self._selector = StrategySelector(device, strategy)
        kernels = self._precompile(self._plan)  # before the inputs, since these may have to import torch
        self._inputs = FrameInputs(self._plan, drive)
        self._results = self._open_cache(self._plan, self._inputs, kernels)
        self._apply_strategy(self._selector.strategy_for(self._results.frame.required_variants()))

    @property
    def drive(self) -> Any:
        """The drive after the last edit."""
        return self._drive

    @property
    def system(self) -> System:
        """The system after the last edit."""
        return self._plan.nominal

    @property
    def dispatch_counts(self) -> Counter[str]:
        """Number of dispatched kernels by name: the fused kernels, `composite` and `show`."""
        return self._results.frame.dispatch_counts

    @property
    def compositor(self) -> Compositor:
        """Computes XYZ and sRGB images; tells their memory layout."""
        return self._results.compositor

    @property
    def xyz_buffer(self) -> Buffer:
        """XYZ on the device, f32 (y, x, 4)."""
        return self._results.xyz_buffer

    @property
    def srgb_buffer(self) -> Buffer:
        """The sRGB image on the device, 8-bit RGBA, `compositor.pitch` pixels in each row."""
        return self._results.srgb_buffer

    @property
    def memory_bytes(self) -> int:
        """Device memory of fields and intensities."""
        return self._results.memory_bytes

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for one wavelength of one frame and source, up to the intensity."""
        return self._results.frame.traffic_bytes

    @property
    def timer(self) -> GpuTimer | None:
        """If set, measures the device time of all dispatches."""
        return self._submitter.timer

    @timer.setter
    def timer(self, timer: GpuTimer | None) -> None:
        self._submitter.timer = timer

    @property
    def strategy(self) -> Strategy:
        """The present strategy of the FFTs."""
        return self._results.frame.strategy

    def edit(
        self,
        *,
        system: System | None = None,
        drive: Any = None,
        plane_m: float | None = None,
        exposure_stops: float | None = None,
    ) -> None:
        """Change what is rendered, without computing anything; results stay the previous ones until the next update.

        Arguments that are None stay as they are. Raises UserError if the change is impossible; then nothing changes.
        """
        new_system = self.system if system is None else system
        plane = self.plane_m if plane_m is None else plane_m
        plan, inputs = self._plan, self._inputs
        if system is not None or plane_m is not None:
            plan = check_plan(make_plan(new_system, [*new_system.planes_m, plane]))
        if drive is not None or _inputs_fingerprint(plan) != _inputs_fingerprint(self._plan):
            inputs = FrameInputs(plan, self._drive if drive is None else drive)
        if _structure(plan, inputs) == _structure(self._plan, self._inputs) and self._kernels_fit(plan, inputs):
            self._results.set_plan(plan, inputs, float(plan.planes_m[-1]))
        else:
            self._results = self._open_cache(plan, inputs, self._precompile(plan))
        self._generation += 1
        self._plan, self._inputs, self.plane_m = plan, inputs, plane
        self._drive = self._drive if drive is None else drive
        self.exposure_stops = self.exposure_stops if exposure_stops is None else exposure_stops
        self._apply_strategy(self._selector.strategy_for(self._results.frame.required_variants()))

    def poll_strategy(self) -> bool:
        """Change to a faster FFT strategy if one has become ready, and return whether this happened; never waits.

        Call it regularly, for example for each drawn frame. If the strategy is "auto", the first call starts the search
        for a faster one in another process. Results stay valid, and iterators from `steps` continue.
        """
        return self._apply_strategy(self._selector.poll(self._plan.grid.padded, self._results.frame))

    def close(self) -> None:
        """Stop the search for a faster strategy. The renderer stays usable."""
        self._selector.close()

    def update(self, *, with_srgb: bool = True) -> None:
        """Compute everything that is stale; without `with_srgb`, not the sRGB image."""
        for _ in self.steps(with_srgb=with_srgb):
            pass

    def invalidate(self) -> None:
        """Mark all results as stale, so that the next update begins at the light source."""
        self._generation += 1
        self._results.invalidate()

    def steps(
        self, *, with_srgb: bool = True, wait: bool = False, slice_s: float | None = None
    ) -> Iterator[UpdateProgress]:
        """Compute everything that is stale, one submission for each step; with `wait`, wait for the device after each.

        slice_s: split each submission into slices of about this many seconds, and wait for each; the slices of one
        submission yield the same `done`. The iterator ends early if the renderer is edited, another iterator starts or
        `intensity` computes something: finished work stays valid, and the next iterator continues from there.
        """
        before = started = time.perf_counter()
        spent, done = 0.0, 0
        for step in self._steps(with_srgb=with_srgb, wait=wait, slice_s=slice_s):
            spent += time.perf_counter() - before
            if step.done > done:
                self.step_s = spent if self.step_s is None else 0.7 * self.step_s + 0.3 * spent
                done, spent = step.done, 0.0
            if step.done == step.total:
                self.update_s = time.perf_counter() - started
            yield step
            before = time.perf_counter()
        if done == 0:  # nothing was stale
            self.update_s = time.perf_counter() - started

    def _steps(self, *, with_srgb: bool, wait: bool, slice_s: float | None) -> Iterator[UpdateProgress]:
        self._generation += 1
        generation, submissions = self._generation, self._pending(with_srgb)
        for done, submission in enumerate(submissions, start=1):
            if slice_s is None:
                self._submitter.submit(submission, wait=wait)
            else:
                for _ in self._submitter.submit_sliced(submission, slice_s):
                    yield UpdateProgress(done - 1, len(submissions))
                    if generation != self._generation:
                        return
            yield UpdateProgress(done, len(submissions))
            if generation != self._generation:
                return

    def pending_count(self, *, with_srgb: bool = True) -> int:
        """Number of submissions that an update still needs."""
        return len(self._pending(with_srgb))

    def expected_s(self) -> float | None:
        """The time that an update without the sRGB image will take; None before the time of a step was measured."""
        return None if self.step_s is None else self.pending_count(with_srgb=False) * self.step_s

    def xyz(self) -> NDArray[np.float32]:
        """XYZ (y, x, 3) of the last update."""
        return self.compositor.download_xyz(self.xyz_buffer)

    def srgb8(self) -> NDArray[np.uint8]:
        """The 8-bit sRGB image (y, x, 3) of the last update."""
        return self.compositor.download_srgb8(self.srgb_buffer)

    def intensity(self, wavelength: int) -> NDArray[np.float32]:
        """Up-to-date intensity (y, x) at a wavelength: mean over frames and sources, laser amplitudes included."""
        total = np.zeros(self._plan.grid.shape, np.float32)
        for frame in self._plan.lit(wavelength):
            key = (frame, wavelength)
            if not self._results.is_current(key):
                self._generation += 1
                span = WavelengthSpan(frame, 0, wavelength)
                for submission in intensity_submissions(self._results, self._plan, span):
                    self._submitter.submit(submission)
            total += np.float32(self._plan.weights[key]) * self._results.intensity(key)
        return total

    # --- internals --------------------------------------------------------------------------------------------------

    def _pending(self, with_srgb: bool) -> list[Submission]:
        return pending_submissions(self._results, self._plan, self.exposure_stops, with_srgb=with_srgb)

    def _precompile(self, plan: Plan) -> FusedKernels:
        """The kernels for the frames of a plan, whose compilation has been started."""
        kernels = FusedKernels(self.device, frame_shape(plan), half=self._half)
        kernels.precompile(self._selector.initial_strategy(plan.grid.padded), plan)
        return kernels

    def _kernels_fit(self, plan: Plan, inputs: ShaderInputs) -> bool:
        """Whether the present kernels compute all that the stops of a plan pass, as they do when stops are narrowed."""
        shape = frame_shape(plan, has_plain_pixels=not inputs.is_sampled(0))
        return self._results.frame.fused_kernels.shape.contains(shape)

    def _open_cache(self, plan: Plan, inputs: ShaderInputs, kernels: FusedKernels) -> ResultCache:
        """Empty device memory for the results of a plan; other kernels take the place of those that don't fit."""
        strategy = self._selector.initial_strategy(plan.grid.padded)
        shape = frame_shape(plan, has_plain_pixels=not inputs.is_sampled(0))
        if kernels.shape != shape:
            kernels = FusedKernels(self.device, shape, half=self._half)
        results = ResultCache(plan, inputs, kernels, self._settings, strategy)
        results.frame.tables.set_distance(1, float(plan.planes_m[-1]))
        return results

    def _apply_strategy(self, strategy: Strategy) -> bool:
        """Use a strategy from now on; return whether it differs from the previous one."""
        if strategy == self.strategy:
            return False
        self._results.use_strategy(strategy)
        return True


def _structure(plan: Plan, inputs: ShaderInputs) -> Fingerprint:
    """Everything that device memory is allocated and kernels are generated for."""
    return plan.grid, plan.weights.shape, len(plan.slopes), len(plan.system.modulators), has_no_dense_maps(inputs)


def _inputs_fingerprint(plan: Plan) -> Fingerprint:
    """Everything that the frame inputs of a drive depend on."""
    system = plan.system
    elements = (
        system.modulators,
        system.relay1,
        system.relay2,
        system.wavelengths_m.tobytes(),
        plan.grid,
        system.frames,
    )
    eye = plan.nominal.eye
    seen = eye if eye is not None and eye.has_pupil_function else None
    return elements, plan.nominal.effects, plan.nominal.relay1, plan.nominal.relay2, seen


# Lists the GPU submissions that an update still needs, and submits them at once or in slices of about equal time.


Submission = Callable[[CommandRecorder], None]
"""Records the work of one submission."""

_MAX_DISPATCHES = 256.0  # of a slice


def pending_submissions(
    results: ResultCache, plan: Plan, exposure_stops: float, *, with_srgb: bool
) -> list[Submission]:
    """The submissions that are still needed, in order.

    First the stale resident intensities, then XYZ from all resident ones; then each transient intensity, which is added
    to XYZ before the next one overwrites it; finally the sRGB image.
    """
    keys = [(int(frame), int(wavelength)) for frame, wavelength in np.argwhere(plan.weights > 0)]
    weights = {key: plan.weights[key] * plan.colour_weights[key[1]] for key in keys}
    xyz_fingerprint = tuple((results.intensity_fingerprint(key), weights[key].tobytes()) for key in keys)
    submissions: list[Submission] = []
    max_wavelengths = results.frame.max_wavelengths
    stale = [key for key in keys if results.is_resident(key) and not results.is_current(key)]
    for span in group_into_spans(stale, max_wavelengths):
        submissions += intensity_submissions(results, plan, span)
    if not results.holds({"XYZ": xyz_fingerprint}):
        transient = group_into_spans([key for key in keys if not results.is_resident(key)], max_wavelengths)
        submissions.append(partial(results.composite_resident, weights, None if transient else xyz_fingerprint))
        for span in transient:
            submissions += intensity_submissions(results, plan, span)
            fingerprint = xyz_fingerprint if span is transient[-1] else None
            submissions.append(partial(results.composite_transient, span, weights, fingerprint))
    srgb_fingerprint = (xyz_fingerprint, exposure_stops)
    if with_srgb and not results.holds({"sRGB": srgb_fingerprint}):
        submissions.append(partial(results.encode_srgb, exposure_stops, srgb_fingerprint))
    return submissions


def intensity_submissions(results: ResultCache, plan: Plan, span: WavelengthSpan) -> list[Submission]:
    """The submissions that compute the intensities of a span: one for each source."""
    return [partial(results.accumulate_intensity, replace(span, source=source)) for source in range(len(plan.slopes))]


class Submitter:
    """Submits work to a device. A `timer`, if set, measures the device time of all dispatches."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._slice_dispatches = 1.0
        self.timer: GpuTimer | None = None

    def submit(self, submission: Submission, *, wait: bool = False) -> None:
        """Submit all of it at once; with `wait`, return after it has run."""
        recorder = CommandRecorder(self._device, "frame", self.timer)
        submission(recorder)
        recorder.submit(wait=wait)

    def submit_sliced(self, submission: Submission, slice_s: float) -> Iterator[None]:
        """Submit it in slices, wait for each, and yield between them.

        The number of dispatches in a slice follows the measured time, so that a slice takes about `slice_s` seconds; it
        changes by a factor of 2 at most from one slice to the next.
        """
        recorder = SlicedRecorder(self._device, "frame", self.timer)
        submission(recorder)
        while True:
            count, start = max(min(round(self._slice_dispatches), recorder.remaining), 1), time.perf_counter()
            recorder.submit_next(count, wait=True)
            elapsed_s = max(time.perf_counter() - start, 1e-6)
            least, most = self._slice_dispatches / 2, 2 * self._slice_dispatches
            self._slice_dispatches = min(max(count * slice_s / elapsed_s, least), most, _MAX_DISPATCHES)
            if recorder.remaining == 0:
                return
            yield
