"""What is left to be computed of a hologram, as submissions in their order, and submitting them whole or in slices."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from holoview.engine.fused import Span, spans_of
from holoview.engine.results import Results
from holoview.gpu.device import Device
from holoview.gpu.recorder import Recorder, Score
from holoview.gpu.timer import Timer
from holoview.plan import Plan

Job = Callable[[Recorder], None]

_MOST_DISPATCHES = 256.0  # in a slice


def work_left(results: Results, plan: Plan, exposure_stops: float, *, picture: bool) -> list[Job]:
    """What has to be submitted, in order: intensities that stay, their blend, those that don't, the picture."""
    lit = [(int(f), int(w)) for f, w in np.argwhere(plan.weights > 0)]
    weights = {key: plan.weights[key] * plan.colour_weights[key[1]] for key in lit}
    seen_of = tuple((results.identity(key), weights[key].tobytes()) for key in lit)
    work: list[Job] = []
    together = results.frame.together
    for run in spans_of([key for key in lit if results.is_housed(key) and not results.is_fresh(key)], together):
        work += exposures(results, plan, run)
    if results.seen_of != seen_of:
        homeless = spans_of([key for key in lit if not results.is_housed(key)], together)
        work.append(partial(results.blend, weights, None if homeless else seen_of))
        for run in homeless:
            work += exposures(results, plan, run)
            work.append(partial(results.add, run, weights, seen_of if run is homeless[-1] else None))
    picture_of = (seen_of, exposure_stops)
    if picture and results.picture_of != picture_of:
        work.append(partial(results.show, exposure_stops, picture_of))
    return work


def exposures(results: Results, plan: Plan, run: Span) -> list[Job]:
    """What makes the intensities of a run of wavelengths: a submission a source."""
    return [partial(results.expose, replace(run, source=source)) for source in range(len(plan.slopes))]


class Submitter:
    """Submits jobs to a device. A `timer`, where one is set, takes the time of all dispatches."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._dispatches = 1.0
        self.timer: Timer | None = None

    def submit(self, job: Job, *, wait: bool = False) -> None:
        """All of a job at once; with `wait`, until the device has done it."""
        recorder = Recorder(self._device, "frame", self.timer)
        job(recorder)
        recorder.submit(wait=wait)

    def slices(self, job: Job, slice_s: float) -> Iterator[None]:
        """A job in slices, as many dispatches at a time as took about `slice_s` so far; yields between them."""
        score = Score(self._device, "frame", self.timer)
        job(score)
        while True:
            count, begun = max(min(round(self._dispatches), score.left), 1), time.perf_counter()
            score.play(count, wait=True)
            spent = max(time.perf_counter() - begun, 1e-6)
            self._dispatches = min(
                max(count * slice_s / spent, self._dispatches / 2), 2 * self._dispatches, _MOST_DISPATCHES
            )
            if score.left == 0:
                return
            yield
