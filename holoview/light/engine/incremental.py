"""Re-renders an edited hologram: recomputes only the results that depend on the edit.

    light behind a place ─▶ light behind the last place ─▶ intensity ─▶ XYZ ─▶ sRGB image
             (frame, source, wavelength)                  (frame, wavelength)

A place is where a modulator stands, or several elements of a chain (see `fused`). Each result is stored on the device
with a fingerprint of its inputs. It is stale if the fingerprint differs from that of the present bench; there are no
other rules. These edits therefore recompute:

    exposure                       the sRGB image
    observer, amplitudes           XYZ and the sRGB image, since intensities are stored at unit amplitude
    focal plane, the last relay    for each wavelength a column FFT, transfer function, column IFFT and row IFFT
    another relay, a modulator     what lies behind the place before it
    one wavelength                 that wavelength

While a result is being written it has no fingerprint, until all of its work has been submitted, since an update may be
abandoned half way. Results for which the memory budget has no room are recomputed when they are needed. Before the last
place light is stored behind one more: that before which the latest edit changed nothing.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.light.engine.compositor import Compositor, WeightedIntensity
from holoview.light.engine.fused import (
    BufferRegion,
    Fingerprint,
    FrameWavelength,
    FusedFrame,
    IntensityMemory,
    LightMemory,
    WavelengthSpan,
    XyzWeight,
    group_into_spans,
    light_keys,
)
from holoview.light.engine.fused_kernels import FusedKernels, KernelVariant, frame_shape
from holoview.light.engine.shader_structs import ShaderInputs
from holoview.light.gpu.device import Buffer, Device
from holoview.light.gpu.line_fft import Strategy
from holoview.light.gpu.recorder import CommandRecorder, GpuTimer, Submission, Submitter
from holoview.light.gpu.tune import FftTuner, StrategyOption, remembered_strategy
from holoview.light.model.plan import Plan, make_plan
from holoview.light.model.system import System
from holoview.light.model.validity import check_plan
from holoview.light.optics.frame_inputs import FrameInputs

BUDGET_BYTES = 2**30
"""Default budget of device memory for stored fields and intensities."""
_COMPLEX64 = 8


@dataclass(frozen=True)
class UpdateProgress:
    """Progress of an update: `done` of `total` submissions."""

    done: int
    total: int


XyzTerms = dict[FrameWavelength, tuple[Fingerprint, bytes]]
"""Fingerprints of the intensities that XYZ is the sum of, and their weights."""


class IncrementalRenderer:
    """Renders the drive of a system at one focal plane, and re-renders it after edits.

    After `edit`, either call `update`, or iterate over `steps`, which submit little work each, and stop as soon as the
    next edit arrives. Results are on the device as `xyz_buffer`, f32 (y, x, 4), and `srgb_buffer`, 8-bit RGBA with
    `compositor.pitch` pixels in each row; on the host from `xyz`, `srgb8` and `intensity`.

    drive: (frame, modulator, y, x), fractions of the stroke from 0 to 1; of a chain patterns by names of elements, of
    which an edit changes those whose array is another one. plane_m: None for the system's first plane.
    half: store fields as f16 between kernels. max_wavelengths: how many wavelengths a dispatch computes if no relay has
    a pupil. 1 makes the shortest steps; a card waits less for the processor with more. None: as many as there are on a
    discrete GPU, if they fit a quarter of the budget, and 1 elsewhere. strategy: of the FFTs; "auto" starts with a
    strategy that is ready immediately, and changes to the fastest once that is compiled in the background, if
    `poll_strategy` is called regularly.

    progress: share of the present or last update that is done. step_s: running mean of the time for one of the
    `steps`, which is known where these wait; None before the first. update_s: duration of the last update, from its
    first step to its last.

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
        max_wavelengths: int | None = None,
        strategy: StrategyOption = "auto",
    ) -> None:
        self.device = device
        self._budget_bytes, self._max_wavelengths, self._half = budget_bytes, max_wavelengths, half
        self._drive, self._generation = drive, 0
        self._stored_place: int | None = None  # before the last, behind which light is stored
        self.step_s: float | None = None
        self.update_s, self.progress = 0.0, 0.0
        self._submitter = Submitter(device)
        self._others: Buffer | None = None  # XYZ of the terms that aren't being edited
        self.plane_m = float(system.planes_m[0]) if plane_m is None else plane_m
        self.exposure_stops = exposure_stops
        self._plan = check_plan(make_plan(system, [*system.planes_m, self.plane_m]))
        self._selector = StrategySelector(device, strategy)
        kernels = self._precompile(self._plan)  # before the inputs, since these may have to import torch
        self._inputs = FrameInputs(self._plan, drive)
        self._allocate(self._plan, self._inputs, kernels)
        self._apply_strategy(self._selector.strategy_for(self._frame.required_variants()))

    @property
    def drive(self) -> Any:
        """The drive after the last edit."""
        return self._drive

    @property
    def system(self) -> System:
        """The system after the last edit."""
        return self._plan.nominal

    @property
    def plan(self) -> Plan:
        """The plan after the last edit; its last plane is that which is rendered."""
        return self._plan

    @property
    def dispatch_counts(self) -> Counter[str]:
        """Number of dispatched kernels by name: the fused kernels, `composite` and `show`."""
        return self._frame.dispatch_counts

    @property
    def memory_bytes(self) -> int:
        """Device memory of fields and intensities, of a sum of these, and of texels of all."""
        others = self.compositor.texel_bytes + (0 if self._others is None else self._others.nbytes)
        return self._frame.memory_bytes + self._light.memory_bytes + self._intensities.memory_bytes + others

    @property
    def traffic_bytes(self) -> int:
        """Bytes that the kernels read and write for one wavelength of one frame and source, up to the intensity."""
        return self._frame.traffic_bytes

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
        return self._frame.strategy

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
            self._set_plan(plan, inputs)
        else:
            try:
                self._allocate(plan, inputs, self._precompile(plan))
            except BaseException:
                self._selector.initial_strategy(self._plan.grid.padded)  # that of the grid that stays
                raise
        self._generation += 1
        self._plan, self._inputs, self.plane_m = plan, inputs, plane
        self._drive = self._drive if drive is None else drive
        self.exposure_stops = self.exposure_stops if exposure_stops is None else exposure_stops
        self._apply_strategy(self._selector.strategy_for(self._frame.required_variants()))

    def poll_strategy(self) -> bool:
        """Change to a faster FFT strategy if one has become ready, and return whether this happened; never waits.

        Call it regularly, for example for each drawn frame. If the strategy is "auto", the first call starts the search
        for a faster strategy in another process. Results stay valid, and iterators from `steps` continue.
        """
        return self._apply_strategy(self._selector.poll(self._plan.grid.padded, self._frame))

    def close(self) -> None:
        """Stop the search for a faster strategy. The renderer stays usable."""
        self._selector.close()

    def update(self, *, with_srgb: bool = True, may_reorder: bool = False) -> None:
        """Compute everything that is stale; without `with_srgb`, not the sRGB image. may_reorder: see `steps`."""
        for _ in self.steps(with_srgb=with_srgb, may_reorder=may_reorder):
            pass

    def invalidate(self) -> None:
        """Mark all results as stale, so that the next update begins at the light source."""
        self._generation += 1
        self._fingerprints.clear()

    def steps(
        self, *, with_srgb: bool = True, wait: bool = False, slice_s: float | None = None, may_reorder: bool = False
    ) -> Iterator[UpdateProgress]:
        """Compute everything that is stale, one submission for each step; with `wait`, wait for the device after each.

        slice_s: split each submission into slices of about this many seconds, and wait for each; the slices of one
        submission yield the same `done`. may_reorder: after an edit of few lasers, the light of these lasers may be
        added to the stored sum of the light of all others. The sum then has another order, so that XYZ differs from a
        new renderer's by rounding; the next update without `may_reorder` computes XYZ anew. The iterator ends early if
        the renderer is edited, another iterator starts or `intensity` computes something: finished work stays valid,
        and the next iterator continues from there.
        """
        before = started = time.perf_counter()
        spent, done, self.progress = 0.0, 0, 0.0
        for step in self._steps(self._pending(with_srgb, may_reorder), wait=wait, slice_s=slice_s):
            spent += time.perf_counter() - before
            if step.done > done:
                self.step_s = spent if self.step_s is None else 0.7 * self.step_s + 0.3 * spent
                done, spent = step.done, 0.0
            self.progress = step.done / step.total
            if step.done == step.total:
                self.update_s = time.perf_counter() - started
            yield step
            before = time.perf_counter()
        if done == 0:  # nothing was stale
            self.update_s, self.progress = time.perf_counter() - started, 1.0

    def _steps(
        self, submissions: Sequence[Submission], *, wait: bool, slice_s: float | None
    ) -> Iterator[UpdateProgress]:
        self._generation += 1
        generation = self._generation
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

    def intensity(self, laser: int) -> NDArray[np.float32]:
        """Up-to-date intensity (y, x) of a laser of the system: mean over frames and sources, with its power."""
        return np.sum([self._line_intensity(line) for line in self._plan.lasers[laser].indices], axis=0)

    def luminance(self, laser: int) -> NDArray[np.float32]:
        """Up-to-date luminance (y, x) of a laser of the system: its part of the Y of `xyz`."""
        weights = self._plan.colour_weights[:, 1].astype(np.float32)
        lines = self._plan.lasers[laser].indices
        return np.sum([weights[line] * self._line_intensity(line) for line in lines], axis=0)

    def _line_intensity(self, wavelength: int) -> NDArray[np.float32]:
        """Up-to-date intensity (y, x) of a wavelength of the plan."""
        total = np.zeros(self._plan.grid.shape, np.float32)
        for frame in self._plan.lit(wavelength):
            key = (frame, wavelength)
            if not self._is_current(key):
                self._generation += 1
                for submission in self._intensity_submissions(WavelengthSpan(frame, 0, wavelength)):
                    self._submitter.submit(submission)
            region = self._intensities.region(key)
            stored = self.compositor.download_intensity(region.buffer, region.first)
            total += np.float32(self._plan.weights[key]) * stored
        return total

    # --- what is stale ----------------------------------------------------------------------------------------------

    def _pending(self, with_srgb: bool, may_reorder: bool = False) -> list[Submission]:
        """The submissions that are still needed, in order.

        First the stale resident intensities, then XYZ from all resident ones; then each transient intensity, which is
        added to XYZ before the next one overwrites it; finally the sRGB image.
        """
        plan, is_resident = self._plan, self._intensities.is_resident
        keys = [(int(frame), int(wavelength)) for frame, wavelength in np.argwhere(plan.weights > 0)]
        weights = {key: plan.weights[key] * plan.colour_weights[key[1]] for key in keys}
        terms = {key: (self._intensity_fingerprint(key), weights[key].tobytes()) for key in keys}
        submissions: list[Submission] = []
        most = self._frame.max_wavelengths
        for span in group_into_spans([key for key in keys if is_resident(key) and not self._is_current(key)], most):
            submissions += self._intensity_submissions(span)
        transient = group_into_spans([key for key in keys if not is_resident(key)], most)
        edited = self._edited_terms(terms) if may_reorder and not transient else frozenset()
        xyz_fingerprint = (edited, tuple(terms.items()))
        if not self._holds({"XYZ": xyz_fingerprint}):
            if edited:
                submissions += self._reordered_submissions(weights, terms, edited)
            else:
                last = None if transient else xyz_fingerprint
                submissions.append(partial(self._composite_resident, weights, last))
            for span in transient:
                submissions += self._intensity_submissions(span)
                last = xyz_fingerprint if span is transient[-1] else None
                submissions.append(partial(self._composite_transient, span, weights, last))
        srgb_fingerprint = (xyz_fingerprint, self.exposure_stops)
        if with_srgb and not self._holds({"sRGB": srgb_fingerprint}):
            submissions.append(partial(self._encode_srgb, self.exposure_stops, srgb_fingerprint))
        return submissions

    def _edited_terms(self, terms: XyzTerms) -> frozenset[FrameWavelength]:
        """The terms of XYZ to add to the sum of the others, if these are at least as many; else none.

        They are those that aren't in the stored sum of others, or those that an edit has changed.
        """
        if self._holds({"XYZ": (frozenset(), tuple(terms.items()))}):
            return frozenset()
        _, shown = self._fingerprints.get("XYZ", (None, ()))
        others = self._fingerprints.get("others", ())
        if not others or not set(others) <= set(terms.items()):
            others = set(shown) & set(terms.items())
        edited = frozenset(terms) - {key for key, _ in others}
        has_room = self._others is not None or self.memory_bytes + self.xyz_buffer.nbytes <= self._budget_bytes
        return edited if 2 * len(edited) <= len(terms) and has_room else frozenset()

    def _reordered_submissions(
        self, weights: dict[FrameWavelength, XyzWeight], terms: XyzTerms, edited: frozenset[FrameWavelength]
    ) -> list[Submission]:
        """The submissions that add the edited terms of XYZ to the sum of the others, which is stored."""
        others = tuple((key, term) for key, term in terms.items() if key not in edited)
        submissions: list[Submission] = []
        if not self._holds({"others": others}):
            rest = {key: weights[key] for key, _ in others}
            submissions.append(partial(self._composite_others, rest, others))
        last = {key: weights[key] for key in weights if key in edited}
        xyz_fingerprint = (edited, tuple(terms.items()))
        return [*submissions, partial(self._composite_edited, last, xyz_fingerprint)]

    def _intensity_submissions(self, span: WavelengthSpan) -> list[Submission]:
        """The submissions that compute the intensities of a span: one for each source."""
        sources = range(len(self._plan.slopes))
        return [partial(self._accumulate_intensity, replace(span, source=source)) for source in sources]

    def _is_current(self, key: FrameWavelength) -> bool:
        """Whether an intensity is stored in a region of its own and not stale."""
        is_resident = self._intensities.is_resident(key)
        return is_resident and self._holds({("intensity", *key): self._intensity_fingerprint(key)})

    def _holds(self, fingerprints: Mapping[Hashable, Fingerprint]) -> bool:
        """Whether results are stored with these fingerprints. Keys: "XYZ", "sRGB", or as `light_keys` makes them."""
        return all(self._fingerprints.get(key) == fingerprint for key, fingerprint in fingerprints.items())

    def _forget(self, keys: Iterable[Hashable]) -> None:
        """Mark results as stale, as they are going to be written."""
        for key in keys:
            self._fingerprints.pop(key, None)

    def _remember(self, fingerprints: Mapping[Hashable, Fingerprint], recorder: CommandRecorder) -> None:
        """Set the fingerprints of results once the recorded work is submitted; until then they have none."""
        self._forget(fingerprints)
        recorder.on_submit(partial(self._fingerprints.update, fingerprints))

    def _intensity_fingerprint(self, key: FrameWavelength) -> Fingerprint:
        """Fingerprint of the intensity that the present bench has."""
        frame, wavelength = key
        tables, sources = self._frame.tables, range(len(self._frame.tables.plan.slopes))
        light = tuple(tables.light_fingerprints(frame, source, wavelength)[-1] for source in sources)
        return light, tables.relay_fingerprint(wavelength, tables.plan.way.last)

    def _example_fingerprints(self) -> tuple[Fingerprint, ...]:
        """Fingerprints of the light behind each place, of the first frame and wavelength with light."""
        frame, wavelength = np.argwhere(self._frame.tables.plan.weights > 0)[0].tolist()
        return self._frame.tables.light_fingerprints(frame, 0, wavelength)

    def _store_before_edit(self, before: tuple[Fingerprint, ...]) -> None:
        """Store the light behind the last place before which an edit changed nothing, if all of it fits the budget.

        It isn't stored from the start, because the kernels that follow then can't work in place, which is slower.
        """
        after, plan = self._example_fingerprints(), self._frame.tables.plan
        place = sum(one == other for one, other in zip(before, after, strict=True)) - 1
        spans = len(plan.slopes) * int(np.count_nonzero(plan.weights))
        if 0 <= place < self._frame.last_place and self._light.has_room_for(spans, {place, self._frame.last_place}):
            former, self._stored_place = self._stored_place, place
            if former not in (None, place):
                self._light.clear(former)
                self._forget_light(former)

    # --- recording --------------------------------------------------------------------------------------------------

    def _accumulate_intensity(self, span: WavelengthSpan, recorder: CommandRecorder) -> None:
        """Record the intensities of a span for one source: stored for source 0, added for the others."""
        light = self._record_light(span, recorder)
        keys = [(span.frame, span.wavelength + i) for i in range(span.count)]
        self._forget([("intensity", *key) for key in keys])
        region = self._intensities.region(keys[0])
        self._frame.record_intensity(recorder, span, light, region, accumulates=span.source > 0)
        recorder.on_submit(self._frame.trim)
        if span.source == len(self._frame.tables.plan.slopes) - 1:
            self._remember({("intensity", *key): self._intensity_fingerprint(key) for key in keys}, recorder)

    def _composite_resident(
        self, weights: dict[FrameWavelength, XyzWeight], fingerprint: Fingerprint, recorder: CommandRecorder
    ) -> None:
        """Record XYZ as the weighted sum of all resident intensities; `fingerprint` is that of XYZ afterwards."""
        self._remember({"XYZ": fingerprint}, recorder)
        resident = {key: weight for key, weight in weights.items() if self._intensities.is_resident(key)}
        self._record_sum(recorder, resident, self.xyz_buffer)

    def _composite_others(
        self, weights: dict[FrameWavelength, XyzWeight], fingerprint: Fingerprint, recorder: CommandRecorder
    ) -> None:
        """Record the weighted sum of the resident intensities that aren't being edited."""
        if self._others is None:
            self._others = self.compositor.xyz_buffer("XYZ of other lasers")
        self._remember({"others": fingerprint}, recorder)
        self._record_sum(recorder, weights, self._others)

    def _composite_edited(
        self, weights: dict[FrameWavelength, XyzWeight], fingerprint: Fingerprint, recorder: CommandRecorder
    ) -> None:
        """Record XYZ as the sum of the others and the weighted intensities that are being edited."""
        self._remember({"XYZ": fingerprint}, recorder)
        self._record_sum(recorder, weights, self.xyz_buffer, self._others)

    def _record_sum(
        self,
        recorder: CommandRecorder,
        weights: dict[FrameWavelength, XyzWeight],
        target: Buffer,
        base: Buffer | None = None,
    ) -> None:
        """Record `target` as the sum of an XYZ image `base` and the weighted resident intensities."""
        summands = [(buffer, self._intensities.blend_terms(weights, buffer)) for buffer in self._intensities.buffers]
        if not weights:
            recorder.clear(target)
        for buffer, terms in summands:
            if terms:
                self._record_composite(recorder, buffer, terms, target, base)
                base = target

    def _composite_transient(
        self,
        span: WavelengthSpan,
        weights: dict[FrameWavelength, XyzWeight],
        fingerprint: Fingerprint,
        recorder: CommandRecorder,
    ) -> None:
        """Record adding the transient intensities of a span to XYZ; `fingerprint` is that of XYZ afterwards."""
        some = {key: weights[key] for key in ((span.frame, span.wavelength + i) for i in range(span.count))}
        buffer = self._intensities.region((span.frame, span.wavelength)).buffer
        self._record_composite(
            recorder, buffer, self._intensities.blend_terms(some, buffer), self.xyz_buffer, self.xyz_buffer
        )
        self._remember({"XYZ": fingerprint}, recorder)

    def _encode_srgb(self, exposure_stops: float, fingerprint: Fingerprint, recorder: CommandRecorder) -> None:
        """Record the sRGB image of XYZ; `fingerprint` is that of the image afterwards."""
        self.compositor.encode_srgb(recorder, self.xyz_buffer, self.srgb_buffer, exposure_stops)
        self._frame.dispatch_counts["show"] += 1
        self._remember({"sRGB": fingerprint}, recorder)

    def _record_light(self, span: WavelengthSpan, recorder: CommandRecorder) -> BufferRegion:
        """The light behind the last place: stored, or else recomputed from the latest stored light.

        Light that isn't stored goes where that behind the last place will be, if kernels work in place.
        """
        frame, last = self._frame, self._frame.last_place
        wavelengths = range(span.wavelength, span.wavelength + span.count)
        fingerprints = [frame.tables.light_fingerprints(span.frame, span.source, w) for w in wavelengths]
        begin, rows, regions = 0, None, dict[int, BufferRegion | None]()
        known = {
            place: dict(zip(light_keys(place, span), (of[place] for of in fingerprints), strict=True))
            for place in (last, self._stored_place)
            if place is not None
        }
        for place, expected in known.items():
            regions[place] = region = self._light.region(place, span)
            if region is not None and self._holds(expected):
                begin, rows = place + 1, region
                break
        loose = regions[last] if frame.works_in_place else None
        for place in range(begin, last + 1):
            region = regions.get(place)
            rows = frame.record_place(recorder, span, place, rows, region or loose)
            if region is not None:
                self._remember_light(known[place], recorder)
        assert rows is not None
        return rows

    def _remember_light(self, fingerprints: Mapping[Hashable, Fingerprint], recorder: CommandRecorder) -> None:
        """As `_remember`, unless the strategy changes in between, because the spectra are in the order of the old
        one."""
        self._forget(fingerprints)
        strategy = self._frame.strategy

        def set_if_same_strategy() -> None:
            if self._frame.strategy == strategy:
                self._fingerprints.update(fingerprints)

        recorder.on_submit(set_if_same_strategy)

    def _record_composite(
        self,
        recorder: CommandRecorder,
        intensity: Buffer,
        terms: Sequence[WeightedIntensity],
        target: Buffer,
        base: Buffer | None,
    ) -> None:
        self.compositor.composite(recorder, intensity, terms, target, base=base)
        self._frame.dispatch_counts["composite"] += 1

    # --- memory and kernels -----------------------------------------------------------------------------------------

    def _precompile(self, plan: Plan) -> FusedKernels:
        """The kernels for the frames of a plan, whose compilation has been started."""
        kernels = FusedKernels.kept(self.device, frame_shape(plan), half=self._half)
        kernels.precompile(self._selector.initial_strategy(plan.grid.padded), plan)
        return kernels

    def _kernels_fit(self, plan: Plan, inputs: ShaderInputs) -> bool:
        """Whether the present kernels compute all frequencies that a plan's stops pass, as after stops were
        narrowed."""
        shape = frame_shape(plan, has_plain_pixels=not inputs.is_sampled(0))
        return self._frame.fused_kernels.shape.contains(shape)

    def _allocate(self, plan: Plan, inputs: ShaderInputs, kernels: FusedKernels) -> None:
        """Empty device memory for the results of a plan; kernels that don't suit the plan are replaced.

        Raises UserError if the grid exceeds the device's limits or an effect fails; then the former results stay.
        """
        strategy = self._selector.initial_strategy(plan.grid.padded)
        shape = frame_shape(plan, has_plain_pixels=not inputs.is_sampled(0))
        if kernels.shape != shape:
            kernels = FusedKernels.kept(self.device, shape, half=self._half)
        compositor = Compositor(self.device, plan.grid.shape)
        most = self._wavelengths_together(plan, compositor) if _has_no_dense_maps(inputs) else 1
        frame = FusedFrame(
            plan,
            inputs,
            self.device,
            max_wavelengths=most,
            strategy=strategy,
            fused_kernels=kernels,
            plane=len(plan.planes) - 1,
        )
        xyz_buffer, srgb_buffer = compositor.xyz_buffer("XYZ"), compositor.srgb_buffer("sRGB image")
        lit_first = sorted(np.ndindex(*plan.weights.shape), key=lambda key: plan.weights[key] == 0)
        intensities = IntensityMemory(compositor, lit_first, most, self._budget_bytes)
        self._light = LightMemory(frame, self._budget_bytes - intensities.memory_bytes)
        self._frame, self.compositor, self._intensities = frame, compositor, intensities
        self.xyz_buffer, self.srgb_buffer = xyz_buffer, srgb_buffer
        self._others = None
        self._fingerprints: dict[Hashable, Any] = {}  # of complete results; see `light_keys`
        self._stored_place = None

    def _wavelengths_together(self, plan: Plan, compositor: Compositor) -> int:
        """How many wavelengths a dispatch may compute."""
        if self._max_wavelengths is not None:
            return self._max_wavelengths
        if not self.device.info.is_discrete:
            return 1
        room_bytes = min(self._budget_bytes // 4, compositor.largest_bytes)
        return min(len(plan.system.wavelengths_m), max(room_bytes // (math.prod(plan.grid.padded) * _COMPLEX64), 1))

    def _set_plan(self, plan: Plan, inputs: ShaderInputs) -> None:
        """Replace the plan by one of the same structure."""
        before = self._example_fingerprints()
        self._frame.tables.set_plan(plan, inputs, len(plan.planes) - 1)
        self._store_before_edit(before)

    def _apply_strategy(self, strategy: Strategy) -> bool:
        """Use a strategy from now on; return whether it differs from the previous one.

        Fields become stale, since their spectra are in the order of the previous strategy.
        """
        if strategy == self.strategy:
            return False
        self._light.clear()
        self._forget_light()
        self._frame.use_strategy(strategy)
        return True

    def _forget_light(self, place: int | None = None) -> None:
        """Mark the light behind a place, or behind all places, as stale."""
        kept = [key for key in self._fingerprints if isinstance(key, tuple) and key[0] == "light"]
        self._forget([key for key in kept if place in (None, key[1])])


def _structure(plan: Plan, inputs: ShaderInputs) -> Fingerprint:
    """Everything that device memory is allocated and kernels are generated for."""
    return plan.grid, plan.weights.shape, len(plan.slopes), plan.way.places, _has_no_dense_maps(inputs)


def _inputs_fingerprint(plan: Plan) -> Fingerprint:
    """Everything that the frame inputs of a drive depend on."""
    system, nominal = plan.system, plan.nominal
    lasers = (system.wavelengths_m.tobytes(), plan.grid, system.frames)
    if system.is_chain:
        source = (nominal.amplitudes.tobytes(), nominal.source) if nominal.effects else None
        return lasers, nominal.elements, nominal.planes_from, nominal.effects, nominal.eye, source
    elements = (system.modulators, system.relay1, system.relay2, *lasers)
    eye = nominal.eye
    seen = eye if eye is not None and eye.has_pupil_function else None
    return elements, nominal.effects, nominal.relay1, nominal.relay2, seen


def _has_no_dense_maps(inputs: ShaderInputs) -> bool:
    """Whether no relay has a pupil and no modulator's transmission is given sample by sample."""
    return inputs.sampled_transmissions is None and all(pupil is None for pupils in inputs.pupils for pupil in pupils)


# --- the strategy of the FFTs -----------------------------------------------------------------------------------------


class StrategySelector:
    """Chooses the strategy for a padded grid, and again for each further grid.

    With "auto", `poll` searches for the fastest strategy in the background. An edit may need kernel variants that
    aren't compiled yet, such as those with a pupil; then "passes" is used until they are.
    """

    def __init__(self, device: Device, requested: StrategyOption) -> None:
        self._device, self._requested = device, requested
        self._best: Strategy = "passes"
        self._ready: frozenset[KernelVariant] = frozenset()
        self._compiles_instantly = False
        self._tuner: FftTuner | None = None
        self._tuning_variants: frozenset[KernelVariant] = frozenset()
        self._shape: tuple[int, int] | None = None

    def initial_strategy(self, shape: tuple[int, int]) -> Strategy:
        """The strategy to start with on a grid of `shape` (y, x), without waiting or searching."""
        if self._requested != "auto":
            return self._requested
        if shape != self._shape:
            self.close()
            self._shape, self._ready = shape, frozenset()
            self._best = remembered_strategy(self._device, shape)
            self._compiles_instantly = self._best != "passes"
        return self._best

    def strategy_for(self, variants: frozenset[KernelVariant]) -> Strategy:
        """The fastest strategy whose shaders for these variants are compiled or compile instantly."""
        if self._requested != "auto":
            return self._requested
        return self._best if self._compiles_instantly or variants <= self._ready else "passes"

    def poll(self, shape: tuple[int, int], frame: FusedFrame) -> Strategy:
        """`strategy_for` the kernels of a frame, after starting a search if one is needed and checking its progress."""
        if self._requested != "auto":
            return self._requested
        variants = frame.required_variants()
        if self._tuner is None and not variants <= self._ready:
            self._tuning_variants = variants
            self._tuner = FftTuner(
                self._device, shape, lambda strategy: frame.fused_kernels.shaders(strategy, self._tuning_variants)
            )
        if self._tuner is not None:
            self._tuner.poll()
            if self._tuner.is_settled:
                self._adopt(self._tuner, shape)
        return self.strategy_for(variants)

    def close(self) -> None:
        """Stop the search, if one is running."""
        if self._tuner is not None:
            self._tuner.close()
            self._tuner = None

    def _adopt(self, tuner: FftTuner, shape: tuple[int, int]) -> None:
        """Use the result of a finished search."""
        still_ready = self._ready if tuner.current == self._best else frozenset()
        self._best, self._ready = tuner.current, still_ready | self._tuning_variants
        self._compiles_instantly = self._best != "passes" and remembered_strategy(self._device, shape) == self._best
        self.close()
