"""Which captures a session takes: the default set, or a plan in TOML.

each = 8                          # captures of every wavelength and distance
wavelengths = ["450 nm"]          # default: all lasers
distances = ["0 mm", "5 mm"]      # default: three over the stage's range; a Fourier bench: 0
power = [0.5, 1.0]                # drawn uniformly
blur = [6, 3, 1.5, 0]             # of the random patterns, pixels; captures cycle through them
exposure = 0.01                   # s; default: searched
seed = 0

A table in CSV as `holoview captures plan` writes it gives the default set a power and an exposure for each laser.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.patterns import BLUR_SIGMAS_PX, random_levels
from holoview.model.fields import Array, FieldType, Integer, Number
from holoview.rig.description import RigDescription
from holoview.rig.devices import Levels
from holoview.rig.measure.exposure_table import LaserSetting, read_exposure_table
from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import read_text
from holoview.util.tables import parse_toml

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


@dataclass(frozen=True)
class CaptureRequest:
    """One capture. sigma_px: blur of its random patterns, drawn with `seed`. exposure_s: None where it is searched."""

    wavelength_m: float
    distance_m: float
    power: float
    sigma_px: float
    seed: tuple[int, int]
    exposure_s: float | None = None

    def levels(self, rig: RigDescription) -> Levels:
        """The patterns (modulator, y, x)."""
        rng = np.random.default_rng(self.seed)
        patterns = [random_levels(rng, rig.slm_shape, slm.num_levels, self.sigma_px) for slm in rig.bench.slms]
        return np.stack(patterns)


@dataclass(frozen=True)
class CapturePlan:
    """Captures in the order in which they are taken."""

    requests: tuple[CaptureRequest, ...] = field(default=())

    def check(self, rig: RigDescription) -> None:
        """Raises UserError for what the rig has no laser for, or what its safety limits don't allow."""
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

    Raises UserError for unknown keys, wrong values, and what the rig can't or mustn't do.
    """
    file = Path(path)
    if file.suffix.lower() == ".csv":
        plan = _with_settings(default_plan(rig), read_exposure_table(file, rig.wavelengths_m))
        plan.check(rig)
        return plan
    table = parse_toml(read_text(file, _EXPECTED), str(file), _EXPECTED)
    for key in table:
        if key not in _KEYS:
            raise UserError(f"{file}: {key}", "unknown key", remedy=suggest_matches(key, _KEYS))
    values = {key: _KEYS[key].parse(value, f"{file}: {key}") for key, value in table.items()}
    for key, value in values.items():
        if np.size(value) == 0:
            raise UserError(f"{file}: {key}", "is empty", expected="at least one number")
    plan = _plan(rig, values)
    plan.check(rig)
    return plan


def _plan(rig: RigDescription, values: Mapping[str, Any]) -> CapturePlan:
    """The captures of these values; those of a key that is missing are the default."""
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
    """The captures of the lasers that have settings, with these."""
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
