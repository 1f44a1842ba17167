"""What is left to be computed of a hologram, as submissions in their order, and submitting them whole or in slices."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.engine.fused import WavelengthSpan, group_into_spans
from holoview.engine.result_cache import ResultCache
from holoview.gpu.device import Device
from holoview.gpu.recorder import CommandRecorder, SlicedRecorder
from holoview.gpu.timer import GpuTimer
from holoview.model.plan import Plan

Submission = Callable[[CommandRecorder], None]

_MOST_DISPATCHES = 256.0  # in a slice


def pending_submissions(results: ResultCache, plan: Plan, exposure_stops: float, *, picture: bool) -> list[Submission]:
    """What has to be submitted, in order: intensities that stay, their blend, those that don't, the picture."""
    lit = [(int(f), int(w)) for f, w in np.argwhere(plan.weights > 0)]
    weights = {key: plan.weights[key] * plan.colour_weights[key[1]] for key in lit}
    seen_of = tuple((results.intensity_fingerprint(key), weights[key].tobytes()) for key in lit)
    work: list[Submission] = []
    together = results.frame.max_wavelengths
    for run in group_into_spans(
        [key for key in lit if results.is_resident(key) and not results.is_current(key)], together
    ):
        work += intensity_submissions(results, plan, run)
    if results.xyz_fingerprint != seen_of:
        homeless = group_into_spans([key for key in lit if not results.is_resident(key)], together)
        work.append(partial(results.composite_resident, weights, None if homeless else seen_of))
        for run in homeless:
            work += intensity_submissions(results, plan, run)
            work.append(partial(results.composite_transient, run, weights, seen_of if run is homeless[-1] else None))
    picture_of = (seen_of, exposure_stops)
    if picture and results.srgb_fingerprint != picture_of:
        work.append(partial(results.encode_srgb, exposure_stops, picture_of))
    return work


def intensity_submissions(results: ResultCache, plan: Plan, run: WavelengthSpan) -> list[Submission]:
    """What makes the intensities of a run of wavelengths: a submission a source."""
    return [partial(results.accumulate_intensity, replace(run, source=source)) for source in range(len(plan.slopes))]


class Submitter:
    """Submits jobs to a device. A `timer`, where one is set, takes the time of all dispatches."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._dispatches = 1.0
        self.timer: GpuTimer | None = None

    def submit(self, job: Submission, *, wait: bool = False) -> None:
        """All of a job at once; with `wait`, until the device has done it."""
        recorder = CommandRecorder(self._device, "frame", self.timer)
        job(recorder)
        recorder.submit(wait=wait)

    def submit_sliced(self, job: Submission, slice_s: float) -> Iterator[None]:
        """A job in slices, as many dispatches at a time as took about `slice_s` so far; yields between them."""
        score = SlicedRecorder(self._device, "frame", self.timer)
        job(score)
        while True:
            count, begun = max(min(round(self._dispatches), score.remaining), 1), time.perf_counter()
            score.submit_next(count, wait=True)
            spent = max(time.perf_counter() - begun, 1e-6)
            self._dispatches = min(
                max(count * slice_s / spent, self._dispatches / 2), 2 * self._dispatches, _MOST_DISPATCHES
            )
            if score.remaining == 0:
                return
            yield
