"""What a session would do, how long it would take on the bench, and what memory and disk it needs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from holoview.rig.description import RigDescription
from holoview.rig.measure.capture_plan import CapturePlan, CaptureRequest
from holoview.rig.measure.dark_frames import PICTURES
from holoview.util import units
from holoview.util.memory import format_size, require_memory
from holoview.util.units import format_duration

_EXPOSURE_S, _TRIES = 1 / 60, 1.3  # where it is searched: a frame's time, and pictures until it suits
_READOUT_S, _MOVE_S = 0.05, 2.0  # typical ones
_SETTLING_S = 20.0  # to measure a modulator
_HELD = 3.0  # times of the data that are in memory while captures are joined, checked and written


@dataclass(frozen=True)
class Forecast:
    """bench_s: time on the bench. data_bytes: of all captures of the plan, before they are compressed."""

    requests: tuple[CaptureRequest, ...]
    missing: int
    bench_s: float
    data_bytes: int

    def require_memory(self) -> None:
        """Raises UserError if the finished session wouldn't fit into the memory that may be taken."""
        require_memory("captures", _HELD * self.data_bytes, remedy="take fewer captures in one file")


def make_forecast(rig: RigDescription, plan: CapturePlan, missing: Sequence[int]) -> Forecast:
    """Of a session in which the captures of these numbers are missing."""
    level_bytes = 1 if max(slm.num_levels for slm in rig.bench.slms) <= 256 else 2
    levels = level_bytes * len(rig.bench.slms) * math.prod(rig.slm_shape)
    size = (levels + 2 * math.prod(rig.camera_shape)) * len(plan.requests)
    return Forecast(plan.requests, len(missing), _bench_s(rig, [plan.requests[k] for k in missing]), size)


def forecast_lines(rig: RigDescription, forecast: Forecast) -> Iterator[str]:
    """The forecast in words, a line each: devices, dark frames, moves and lasers in order, counts, time, disk."""
    for name, spec in rig.devices.items():
        yield f"{name}: {spec.kind}"
    limits = rig.limits
    near, far = (units.format_rounded(z, "mm") for z in limits.stage_m)
    low, high = (format_duration(s) for s in limits.exposures_s)
    yield f"limits: power up to {limits.power:g}, exposure {low} … {high}, stage {near} … {far}"
    yield "lasers off: dark frames"
    for name, spec in rig.devices.items():
        if spec.measures_settling:
            yield f"{name}: how fast it settles is measured"
    for distance_m, group in itertools.groupby(forecast.requests, lambda request: request.distance_m):
        yield f"stage to {units.format_rounded(distance_m, 'mm')}"
        for wavelength_m, own in itertools.groupby(group, lambda request: request.wavelength_m):
            yield f"  {_format_lasers(wavelength_m, list(own))}"
    yield f"lasers off: dark frames of {PICTURES} pictures at the shortest and at the longest exposure"
    count = len(forecast.requests)
    yield f"{count} captures, of which {count - forecast.missing} are there"
    yield f"about {format_duration(forecast.bench_s)} on the bench, {format_size(forecast.data_bytes)} of data"


def _format_lasers(wavelength_m: float, requests: Sequence[CaptureRequest]) -> str:
    powers = [request.power for request in requests]
    exposures = [request.exposure_s for request in requests if request.exposure_s is not None]
    power = _format_range([f"{min(powers):g}", f"{max(powers):g}"])
    exposure = (
        "searched" if not exposures else _format_range([format_duration(s) for s in (min(exposures), max(exposures))])
    )
    return f"{wavelength_m * 1e9:g} nm: {len(requests)} captures, power {power}, exposure {exposure}"


def _format_range(ends: Sequence[str]) -> str:
    return " … ".join(dict.fromkeys(ends))


def _bench_s(rig: RigDescription, requests: Sequence[CaptureRequest]) -> float:
    if not requests:
        return 0.0
    devices = rig.devices
    settle_s = max(float(devices[name].options.get("settle", 0.0)) for name in ("slm1", "slm2") if name in devices)
    moves = 1 + sum(a.distance_m != b.distance_m for a, b in itertools.pairwise(requests))
    total_s = _MOVE_S * moves + 3 * PICTURES * (_EXPOSURE_S + _READOUT_S)
    total_s += _SETTLING_S * sum(spec.measures_settling for spec in devices.values())
    for request in requests:
        searched = request.exposure_s is None
        exposure_s = min(max(_EXPOSURE_S, rig.limits.exposures_s[0]), rig.limits.exposures_s[1])
        own = _TRIES * (exposure_s + _READOUT_S) if searched else (request.exposure_s or 0.0) + _READOUT_S
        total_s += settle_s + own
    return total_s
