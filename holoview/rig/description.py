"""Reads a rig's description: which devices it has, their facts, the safety limits, and the nominal bench.

rig.toml has the tables of `bench.toml` (`captures.bench_tables`) with the devices' own keys, and three of its own:

    name = "left arm"
    [slm1]                          # and [slm2]
    device = "slmsuite"             # kind of device, see `open_rig`; further keys are that kind's options
    class = "slmsuite.hardware.slms.holoeye.Holoeye"
    shape = [1080, 1920]            # rows, columns
    pitch = "8 um"
    num_levels = 256
    opd_range = "633 nm"
    settle = "auto"                 # s until a pattern is shown; "auto": `holoview measure` finds out
    [camera]
    device = "slmsuite"
    class = "slmsuite.hardware.cameras.thorlabs.ThorCam"
    shape = [1080, 1440]            # of a raw picture
    pitch = "3.45 um"               # and bit_depth, electrons_per_count, read_noise, black_level
    [lasers]
    device = "manual"
    wavelengths = ["450 nm", "520 nm", "638 nm"]
    [stage]
    device = "manual"
    range = ["0 mm", "20 mm"]
    [limits]
    power = 1.0                     # highest, relative
    exposure = [1e-4, 0.5]          # s
    stage = ["1 mm", "15 mm"]       # default: the stage's range
    [geometry]
    gap = "1 mm"

Where camera and modulators are is written beside it by `holoview rig align` (`registration`), and read with it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.captures.dataset import Captures
from holoview.captures.nominal_bench import KEYS, BenchTables, parse_bench_tables
from holoview.captures.patterns import random_levels
from holoview.captures.validation import check_settings
from holoview.model.fields import Array, FieldType, Number
from holoview.rig.devices import Counts, Levels
from holoview.rig.limits import SafetyLimits
from holoview.rig.registration import Registration, read_registration, registration_path
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import read_text
from holoview.util.tables import check_keys, parse_toml

_EXPECTED = "a description of a rig in TOML"
_LONG_SETTLE_S = 0.5  # longer than most liquid crystals need
_SHAPE = Array(Number(low=1, high=65536))
_LENGTHS = Array(Number("mm", low=-1.0, high=10.0))
_LASERS: dict[str, FieldType] = {"wavelengths": Array(Number("nm", low=100e-9, high=10e-6))}
_STAGE: dict[str, FieldType] = {"range": _LENGTHS}
_LIMITS: dict[str, FieldType] = {
    "power": Number(low=0.0),
    "exposure": Array(Number(low=0.0)),
    "stage": _LENGTHS,
}
_DEVICES = ("slm1", "slm2", "camera", "lasers", "stage")
_TABLES = ("limits", "geometry", "virtual", *_DEVICES)


@dataclass(frozen=True)
class DeviceSpec:
    """A device that is to be opened. name: its table in rig.toml. kind: who drives it. options: of that kind.

    measures_settling: whether the time that a modulator needs is to be measured; until then its option is a long one.
    """

    name: str
    kind: str
    options: Mapping[str, Any]
    measures_settling: bool = False


@dataclass(frozen=True)
class RigDescription:
    """A rig. All lengths in m, times in s.

    path: of rig.toml. bench: the nominal bench. slm_shape, camera_shape: rows and columns.
    wavelengths_m: of the lasers, ascending. stage_m: what the stage reaches.
    devices: by their tables. virtual: the table of the virtual bench, empty where no device is virtual.
    registration: where the devices are; None: where they should be. With one, camera_shape is that of the rectified
    picture, bench has the measured pitch, and stage_m and limits are distances as measured. described: without it.
    """

    path: Path
    name: str
    bench: BenchTables
    slm_shape: tuple[int, int]
    camera_shape: tuple[int, int]
    wavelengths_m: tuple[float, ...]
    stage_m: tuple[float, float]
    limits: SafetyLimits
    devices: Mapping[str, DeviceSpec]
    virtual: Mapping[str, Any]
    registration: Registration | None = None
    described: RigDescription | None = None

    @property
    def as_described(self) -> RigDescription:
        """As rig.toml says, without a registration."""
        return self.described or self

    def registered(self, registration: Registration) -> RigDescription:
        """With the devices where they are. Raises UserError for a registration of other devices."""
        described = self.as_described
        for name, found, own in (
            ("slm_shape", registration.slm_shape, described.slm_shape),
            ("camera_shape", registration.camera_shape, described.camera_shape),
            ("modulators", 1 if registration.slm2_turn is None else 2, len(described.bench.slms)),
        ):
            if found != own:
                where, remedy = f"{registration_path(self.path)}: found_for.{name}", "run `holoview rig align` again"
                raise UserError(where, str(found), expected=f"{own}, as in {self.path}", remedy=remedy)
        camera = replace(described.bench.camera, pitch_m=registration["pitch"])
        return replace(
            described,
            bench=replace(described.bench, camera=camera),
            camera_shape=registration.shape,
            stage_m=described._distances_m(described.stage_m, registration),
            limits=replace(described.limits, stage_m=described._distances_m(described.limits.stage_m, registration)),
            registration=registration,
            described=described,
        )

    def _distances_m(self, settings_m: tuple[float, float], registration: Registration) -> tuple[float, float]:
        """Distances at settings of the stage; in the near field not behind the last modulator."""
        low, high = (registration.distance_m(setting) for setting in settings_m)
        least = 0.0 if self.bench.focal_length_m is None else low
        return max(low, least), max(high, least)

    @property
    def levels_type(self) -> type[np.unsignedinteger]:
        """The type of grey levels of all modulators."""
        return np.uint8 if max(slm.num_levels for slm in self.bench.slms) <= 256 else np.uint16

    def random_levels(self, rng: np.random.Generator, sigma_px: float) -> Levels:
        """Random patterns (modulator, y, x), blurred by a Gaussian of `sigma_px` modulator pixels."""
        return np.stack([random_levels(rng, self.slm_shape, slm.num_levels, sigma_px) for slm in self.bench.slms])

    def capture(
        self,
        levels: NDArray[np.unsignedinteger],
        image: Counts,
        *,
        wavelength_m: float,
        distance_m: float,
        power: float,
        exposure_s: float,
        **fields: Any,
    ) -> Captures:
        """One capture of the nominal bench. levels: (modulator, y, x). image: (y, x). fields: further ones."""
        return Captures(
            levels=levels[None],
            images=image[None],
            wavelength_m=np.array([wavelength_m]),
            distance_m=np.array([distance_m]),
            power=np.array([power]),
            exposure_s=np.array([exposure_s]),
            **self.bench.as_fields(),
            **fields,
        )

    def blank_capture(self) -> Captures:
        """A capture that wasn't taken: dark patterns and no light, with the shortest wavelength at the near end."""
        return self.capture(
            np.zeros((len(self.bench.slms), *self.slm_shape), np.uint8),
            np.zeros(self.camera_shape, np.uint16),
            wavelength_m=self.wavelengths_m[0],
            distance_m=self.limits.stage_m[0],
            power=self.limits.power,
            exposure_s=self.limits.exposures_s[0],
        )


def read_rig(path: str | os.PathLike[str], *, is_registered: bool = True) -> RigDescription:
    """Reads rig.toml, and the registration beside it if there is one.

    is_registered: False for the rig without a registration, whose pictures needn't be rectified. Raises UserError that
    names a missing, unknown or wrong key, and for a registration of other devices.
    """
    rig = _read_description(path)
    if not is_registered:
        return rig
    file = registration_path(rig.path)
    rig = rig.registered(read_registration(file)) if file.exists() else rig
    _check(rig)
    return rig


def _read_description(path: str | os.PathLike[str]) -> RigDescription:
    file = Path(path)
    tables = parse_toml(read_text(file, _EXPECTED), str(file), _EXPECTED)
    where = str(file)
    name = tables.pop("name", file.stem)
    if not isinstance(name, str):
        raise UserError(f"{where}: name", f"{name!r}", expected="a text")
    for key, table in tables.items():
        if key not in _TABLES or not isinstance(table, Mapping):
            raise UserError(f"{where}: {key}", "unknown table", remedy=suggest_matches(key, _TABLES))
    for key in ("slm1", "camera", "lasers", "stage", "limits"):
        check_keys(tables, _TABLES, f"{where}: ", required=[key], expected=f"a table [{key}]", noun="table")
    facts, options = _split(tables, where)
    slm_shape, camera_shape = _equal_shapes(facts, where), _shape(facts["camera"], f"{where}: camera")
    stage_m = _pair(facts["stage"], "range", f"{where}: stage")
    limits = _limits(facts["limits"], stage_m, f"{where}: limits")
    rig = RigDescription(
        path=file,
        name=name,
        bench=parse_bench_tables({key: facts[key] for key in KEYS if key in facts}, where),
        slm_shape=slm_shape,
        camera_shape=camera_shape,
        wavelengths_m=_wavelengths(facts["lasers"], f"{where}: lasers"),
        stage_m=stage_m,
        limits=limits,
        devices={key: _device(key, options[key], where) for key in _DEVICES if key in tables},
        virtual=dict(tables.get("virtual", {})),
    )
    _check(replace(rig, camera_shape=rig.slm_shape))  # a raw picture may have any shape
    return rig


def _check(rig: RigDescription) -> None:
    """Raises UserError for what no capture file can hold."""
    try:
        check_settings(rig.blank_capture())
    except UserError as error:
        raise error.inside(f"{rig.path}: ") from error


def _split(tables: Mapping[str, Any], where: str) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """The facts of each table, parsed where they aren't the bench's, and what is left: options of the devices."""
    known: dict[str, Mapping[str, FieldType]] = {"lasers": _LASERS, "stage": _STAGE, "limits": _LIMITS}
    facts: dict[str, dict[str, Any]] = {}
    options: dict[str, dict[str, Any]] = {}
    for name, table in tables.items():
        if name == "virtual":
            continue
        if name in known:
            types = known[name]
            facts[name] = {
                key: types[key].parse(v, f"{where}: {name}.{key}") for key, v in table.items() if key in types
            }
        else:
            keys = {*KEYS[name], "shape"} if name != "geometry" else set(table)
            facts[name] = {key: v for key, v in table.items() if key in keys}
        options[name] = {key: v for key, v in table.items() if key not in facts[name]}
        if name == "limits":
            check_keys(table, _LIMITS, f"{where}: limits.")
    return facts, options


def _equal_shapes(facts: dict[str, dict[str, Any]], where: str) -> tuple[int, int]:
    """Rows and columns of the modulators, which are taken from their facts."""
    shapes = [_shape(facts[name], f"{where}: {name}") for name in ("slm1", "slm2") if name in facts]
    if len(set(shapes)) > 1:
        raise UserError(f"{where}: slm2.shape", str(list(shapes[1])), expected=f"that of slm1, {list(shapes[0])}")
    return shapes[0]


def _shape(table: dict[str, Any], where: str) -> tuple[int, int]:
    """Takes `shape` out of a table."""
    _required(table, "shape", where)
    value = _SHAPE.parse(table.pop("shape"), f"{where}.shape")
    if value is None or len(value) != 2 or any(value != value.round()):
        raise UserError(f"{where}.shape", str(value), expected="rows and columns, such as [1080, 1920]")
    return int(value[0]), int(value[1])


def _wavelengths(table: Mapping[str, Any], where: str) -> tuple[float, ...]:
    values = tuple(sorted(float(λ) for λ in _required(table, "wavelengths", where)))
    if not values:
        raise UserError(f"{where}.wavelengths", "is empty", expected="at least one wavelength")
    if len(set(values)) != len(values):
        raise UserError(f"{where}.wavelengths", "one is listed twice", expected="distinct wavelengths")
    return values


def _pair(table: Mapping[str, Any], key: str, where: str) -> tuple[float, float]:
    values = [float(value) for value in _required(table, key, where)]
    if len(values) != 2 or values[0] > values[1]:
        raise UserError(f"{where}.{key}", str(values), expected="two values, the lower one first")
    return values[0], values[1]


def _required(table: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in table:
        raise UserError(f"{where}.{key}", "is missing")
    return table[key]


def _limits(table: Mapping[str, Any], reach_m: tuple[float, float], where: str) -> SafetyLimits:
    """The safety limits. reach_m: of the stage, beyond which they can't go."""
    power = float(_required(table, "power", where))
    if power == 0:
        raise UserError(f"{where}.power", "0", expected="a number greater than 0")
    exposures_s = _pair(table, "exposure", where)
    if exposures_s[0] == 0:
        raise UserError(f"{where}.exposure", "0 s", expected="exposures greater than 0")
    stage_m = _pair(table, "stage", where) if "stage" in table else reach_m
    if not reach_m[0] <= stage_m[0] <= stage_m[1] <= reach_m[1]:
        expected = f"a range within {' … '.join(units.format_rounded(z, 'mm') for z in reach_m)}, that of the stage"
        raise UserError(f"{where}.stage", " … ".join(units.format_rounded(z, "mm") for z in stage_m), expected=expected)
    return SafetyLimits(power, exposures_s, stage_m)


def _device(name: str, options: Mapping[str, Any], where: str) -> DeviceSpec:
    kind = options.get("device")
    if not isinstance(kind, str):
        raise UserError(f"{where}: {name}.device", "is missing" if kind is None else f"{kind!r}", expected="a text")
    own = {key: value for key, value in options.items() if key != "device"}
    if name not in ("slm1", "slm2") or "settle" not in own:
        return DeviceSpec(name, kind, own)
    is_auto = own["settle"] == "auto"
    if not is_auto:
        Number(low=0.0, high=1000.0).parse(own["settle"], f"{where}: {name}.settle")
    return DeviceSpec(name, kind, own | {"settle": _LONG_SETTLE_S} if is_auto else own, is_auto)
