"""Whether a few captures, taken as placed, belong together: the check of records of a diagnosis of files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from holoview.captures.dataset import join_captures
from holoview.captures.patterns import BLUR_SIGMAS_PX
from holoview.captures.records import RecordFindings, find_record_errors
from holoview.rig.description import RigDescription
from holoview.rig.devices import Devices
from holoview.rig.measure.capture_plan import CapturePlan, default_plan
from holoview.rig.measure.session import MeasurementSession
from holoview.util.progress import ProgressCallback

_OF_EACH = 2  # captures of each laser and plane


def check_plan(rig: RigDescription) -> CapturePlan:
    """The smoothest captures of each laser and plane of the default plan."""
    smoothest = np.sort(BLUR_SIGMAS_PX)[-_OF_EACH:]
    count: dict[tuple[float, float], int] = {}
    requests = []
    for request in default_plan(rig).requests:
        condition = request.wavelength_m, request.distance_m
        if request.sigma_px in smoothest and count.get(condition, 0) < _OF_EACH:
            count[condition] = count.get(condition, 0) + 1
            requests.append(request)
    return CapturePlan(tuple(requests))


def check_rig_records(
    rig: RigDescription,
    devices: Devices,
    progress: ProgressCallback = lambda done, total, note: None,
    is_asked_to_end: Callable[[], bool] = lambda: False,
) -> RecordFindings | None:
    """Takes two captures of every laser and plane, and checks their records; None if asked to end.

    rig: with its placement. devices: those of it, placed.
    """
    session, requests, taken = MeasurementSession(rig, devices), check_plan(rig).requests, []
    for done, request in enumerate(requests):
        if is_asked_to_end():
            return None
        progress(done, len(requests), f"{request.wavelength_m * 1e9:.0f} nm, {request.distance_m * 1e3:.3g} mm")
        taken.append(session.take(request, request.levels(rig)))
    progress(len(requests), len(requests), "")
    known = {} if rig.placement is None else rig.placement.known_effects()
    return find_record_errors(join_captures(taken), known)
