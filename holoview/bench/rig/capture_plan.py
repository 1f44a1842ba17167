"""The captures that are taken: the default set, a plan in TOML, or a table; and the time that they take on the bench.

each = 8                          # captures of every wavelength and distance
wavelengths = ["450 nm"]          # default: all lasers
distances = ["0 mm", "5 mm"]      # default: three over the stage's range; a Fourier bench: 0
power = [0.5, 1.0]                # drawn uniformly
blur = [6, 3, 1.5, 0]             # of the random patterns, pixels; captures cycle through them
exposure = 0.01                   # s; default: searched
seed = 0

A table in CSV as `holoview captures plan` writes it gives the default set a power and an exposure for each laser. A
`Forecast` states the work of a measurement, and the time, memory and disk that it needs.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.patterns import BLUR_SIGMAS_PX
from holoview.bench.rig.camera_pictures import DARK_PICTURES
from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import Levels
from holoview.light.model.fields import Array, FieldType, Integer, Number
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.files import read_text
from holoview.util.memory_limit import format_size, require_memory
from holoview.util.number_text import read_csv
from holoview.util.tables import NumberSchema, parse_toml, read_table
from holoview.util.units import format_duration

_EXPECTED = "a plan of captures in TOML"
_MARGIN = 0.1  # of the stage's range, left free by the default planes
_KEYS: dict[str, FieldType] = {
    "each": Integer(low=1, high=100_000),
    "wavelengths": Array(Number("nm", low=100e-9, high=10e-6)),
    "distances": Array(Number("mm", low=-1.0, high=10.0)),
    "power": Array(Number(low=0.0)),
    "blur": Array(Number(low=0.0, high=1000.0)),
    "exposure": Number(low=0.0, high=1e4),
    "seed": Integer(low=0, high=2**31),
}
_TABLE_EXPECTED = "a table of `holoview captures plan` in CSV"
_SAME_WAVELENGTH = 1e-4  # relative: the table rounds wavelengths to six digits
_COLUMNS = (NumberSchema("wavelength_nm", 100, 10_000), NumberSchema("power", 0), NumberSchema("exposure_s", 0))
_EXPOSURE_S, _TRIES = 1 / 60, 1.3  # where it is searched: a frame's time, and pictures until it suits
_READOUT_S, _MOVE_S = 0.05, 2.0  # typical ones
_SETTLING_S = 20.0  # to measure a modulator
_HELD = 3.0  # times of the data that are in memory while captures are joined, checked and written


@dataclass(frozen=True)
class CaptureRequest:
    """A planned capture. sigma_px: blur of its random patterns, drawn with `seed`. exposure_s: None: it is searched."""

    wavelength_m: float
    distance_m: float
    power: float
    sigma_px: float
    seed: tuple[int, int]
    exposure_s: float | None = None

    def levels(self, rig: RigDescription) -> Levels:
        """The patterns (modulator, y, x)."""
        rng = np.random.default_rng(self.seed)
        return rig.random_levels(rng, self.sigma_px)


@dataclass(frozen=True)
class CapturePlan:
    """Captures in the order in which they are taken."""

    requests: tuple[CaptureRequest, ...] = field(default=())

    def check(self, rig: RigDescription) -> None:
        """Raises UserError for a wavelength without a laser, and for settings that the safety limits don't allow."""
        for request in self.requests:
            if request.wavelength_m not in rig.wavelengths_m:
                known = ", ".join(f"{λ * 1e9:g} nm" for λ in rig.wavelengths_m)
                raise UserError("plan: wavelengths", f"{request.wavelength_m * 1e9:g} nm", expected=f"one of {known}")
            rig.limits.require_power(request.power)
            if request.power == 0:
                raise UserError("plan: power", "0", expected="powers greater than 0")
            rig.limits.require_distance(request.distance_m)
            if request.exposure_s is not None:
                rig.limits.require_exposure(request.exposure_s)


def default_plan(rig: RigDescription) -> CapturePlan:
    """Eight captures of every laser and plane."""
    return _plan(rig, {})


def read_plan(path: str | os.PathLike[str], rig: RigDescription) -> CapturePlan:
    """Reads a plan in TOML, or the default captures with the powers and exposures of a table (CSV).

    Raises UserError for unknown keys, wrong values, and captures that the rig can't or mustn't take.
    """
    file = Path(path)
    if file.suffix.lower() == ".csv":
        plan = _with_settings(default_plan(rig), read_exposure_table(file, rig.wavelengths_m))
        plan.check(rig)
        return plan
    table = parse_toml(read_text(file, _EXPECTED), str(file), _EXPECTED)
    values = read_table(table, _KEYS, f"{file}: ")
    for key, value in values.items():
        if np.size(value) == 0:
            raise UserError(f"{file}: {key}", "is empty", expected="at least one number")
    plan = _plan(rig, values)
    plan.check(rig)
    return plan


def _plan(rig: RigDescription, values: Mapping[str, Any]) -> CapturePlan:
    """The captures of a table of values; missing keys have their defaults."""
    seed, each = int(values.get("seed", 0)), int(values.get("each", 8))
    powers = values.get("power", np.array([0.5, 1.0]) * rig.limits.power)
    sigmas = values.get("blur", np.array(BLUR_SIGMAS_PX))
    distances = values.get("distances", default_distances(rig))
    wavelengths = values.get("wavelengths", np.array(rig.wavelengths_m))
    rng = np.random.default_rng(seed)
    requests: list[CaptureRequest] = []
    for distance, wavelength, number in itertools.product(distances, wavelengths, range(each)):
        request = CaptureRequest(
            wavelength_m=float(wavelength),
            distance_m=float(distance),
            power=float(np.clip(round(rng.uniform(powers.min(), powers.max()), 3), powers.min(), powers.max())),
            sigma_px=float(sigmas[number % len(sigmas)]),
            seed=(seed, len(requests)),
            exposure_s=values.get("exposure"),
        )
        requests.append(request)
    return CapturePlan(tuple(requests))


def _with_settings(plan: CapturePlan, settings: Mapping[float, LaserSetting]) -> CapturePlan:
    """The plan with the given settings for the captures of their lasers."""
    requests = (
        replace(request, power=own.power, exposure_s=own.exposure_s)
        for request in plan.requests
        if (own := settings.get(request.wavelength_m)) is not None
    )
    return CapturePlan(tuple(requests))


def default_distances(rig: RigDescription) -> NDArray[np.float64]:
    """Three distances (m) over the stage's range; one on a Fourier bench."""
    low, high = rig.limits.stage_m
    if rig.bench.focal_length_m is not None:
        return np.array([min(max(0.0, low), high)])
    margin = _MARGIN * (high - low)
    return np.unique(np.linspace(low + margin, high - margin, 3))


@dataclass(frozen=True)
class LaserSetting:
    """Power, relative, and exposure time (s) of the captures of one laser."""

    power: float
    exposure_s: float


def read_exposure_table(path: Path, wavelengths_m: Sequence[float]) -> Mapping[float, LaserSetting]:
    """The settings by wavelength, which is one of `wavelengths_m`.

    Raises UserError, with line and column, for a cell that is missing or no number, and for a laser that isn't there.
    """
    lines, has_decimal_commas = read_csv(read_text(path, _TABLE_EXPECTED), str(path))
    if has_decimal_commas:
        lines = [{name: text and text.replace(",", ".") for name, text in line.items()} for line in lines]
    if not lines:
        raise UserError(str(path), "is empty", expected=_TABLE_EXPECTED)
    settings: dict[float, LaserSetting] = {}
    for number, line in enumerate(lines, start=2):
        where = f"{path}, line {number}"
        nm, power, exposure_s = (_cell(line, schema, where) for schema in _COLUMNS)
        near = [λ for λ in wavelengths_m if abs(λ * 1e9 / nm - 1) < _SAME_WAVELENGTH]
        if not near:
            known = ", ".join(f"{λ * 1e9:g} nm" for λ in wavelengths_m)
            raise UserError(f"{where}: wavelength_nm", f"{nm:g}", expected=f"one of {known}")
        if near[0] in settings:
            raise UserError(f"{where}: wavelength_nm", f"{nm:g} again", expected="each wavelength once")
        settings[near[0]] = LaserSetting(power, exposure_s)
    return settings


def _cell(line: Mapping[str, str | None], schema: NumberSchema, where: str) -> float:
    text = line.get(schema.name)
    if not text:
        raise UserError(f"{where}: {schema.name}", "is missing", expected=_TABLE_EXPECTED)
    try:
        return schema.read(float(text), f"{where}: {schema.name}")
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {schema.name}", f'"{text}"', expected="a number") from error


@dataclass(frozen=True)
class Forecast:
    """bench_s: time on the bench. data_bytes: of all captures of the plan, before they are compressed."""

    requests: tuple[CaptureRequest, ...]
    missing: int
    bench_s: float
    data_bytes: int

    def require_memory(self) -> None:
        """Raises UserError if the finished capture file wouldn't fit into the memory that may be taken."""
        require_memory("captures", _HELD * self.data_bytes, remedy="take fewer captures in one file")


def make_forecast(rig: RigDescription, plan: CapturePlan, missing: Sequence[int]) -> Forecast:
    """The forecast of a measurement in which the captures of these numbers are missing."""
    levels = np.dtype(rig.levels_type).itemsize * len(rig.bench.slms) * math.prod(rig.slm_shape)
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
    yield f"lasers off: dark frames of {DARK_PICTURES} pictures at the shortest and at the longest exposure"
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
    settle_s = max(float(devices[name].options.get("settle", 0.0)) for name in rig.modulator_names)
    moves = 1 + sum(a.distance_m != b.distance_m for a, b in itertools.pairwise(requests))
    total_s = _MOVE_S * moves + 3 * DARK_PICTURES * (_EXPOSURE_S + _READOUT_S)
    total_s += _SETTLING_S * sum(spec.measures_settling for spec in devices.values())
    for request in requests:
        searched = request.exposure_s is None
        exposure_s = min(max(_EXPOSURE_S, rig.limits.exposures_s[0]), rig.limits.exposures_s[1])
        own = _TRIES * (exposure_s + _READOUT_S) if searched else (request.exposure_s or 0.0) + _READOUT_S
        total_s += settle_s + own
    return total_s
