"""Lists the GPU submissions that an update still needs, and submits them at once or in slices of about equal time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.engine.fused import WavelengthSpan, group_into_spans
from holoview.engine.result_cache import ResultCache
from holoview.gpu.device import Device
from holoview.gpu.recorder import CommandRecorder, GpuTimer, SlicedRecorder
from holoview.model.plan import Plan

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
    if results.xyz_fingerprint != xyz_fingerprint:
        transient = group_into_spans([key for key in keys if not results.is_resident(key)], max_wavelengths)
        submissions.append(partial(results.composite_resident, weights, None if transient else xyz_fingerprint))
        for span in transient:
            submissions += intensity_submissions(results, plan, span)
            fingerprint = xyz_fingerprint if span is transient[-1] else None
            submissions.append(partial(results.composite_transient, span, weights, fingerprint))
    srgb_fingerprint = (xyz_fingerprint, exposure_stops)
    if with_srgb and results.srgb_fingerprint != srgb_fingerprint:
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
