"""Reads a rig's description: its devices, their facts, the safety limits, and the nominal bench.

rig.toml has the tables of `bench.toml` (`captures.nominal_bench`) with the devices' own keys, and three of its own:

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

The rig of a chain of elements names a preset, and has a table of each element that shows patterns, by its name, in
place of [slm1], [slm2] and [geometry]; its shape, pitch and levels are the preset's:

    chain = "chain.toml"            # beside rig.toml, or the name of a preset
    [coarse]
    device = "virtual"
    num_levels = 256                # default; of an element whose preset states no levels

`holoview rig align` writes the places of camera and modulators beside it (`registration`); they are read with it.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.nominal_bench import (
    KEYS,
    BenchTables,
    chain_tables,
    check_nominal,
    parse_bench_tables,
    slm_of,
)
from holoview.bench.captures.patterns import random_levels
from holoview.bench.captures.validation import check_settings
from holoview.bench.rig.devices import Counts, Levels, SafetyLimits
from holoview.bench.rig.registration import Registration, read_registration, registration_path
from holoview.light.model import preset
from holoview.light.model.elements import AmplitudeModulator, Space
from holoview.light.model.fields import POSITIVE, Array, Integer, Number, Span
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.files import read_text
from holoview.util.tables import ValueType, check_keys, parse_toml, read_table

_EXPECTED = "a description of a rig in TOML"
_LONG_SETTLE_S = 0.5  # longer than most liquid crystals need
_SLMS, _DEVICES = ("slm1", "slm2"), ("camera", "lasers", "stage")
_TABLES = ("limits", "virtual", *_DEVICES)


class _Shape:
    """Field type of a shape: rows and columns."""

    def parse(self, value: Any, where: str) -> tuple[int, int]:
        numbers = Array(Number(low=1, high=65536)).parse(value, where)
        if numbers is None or len(numbers) != 2 or any(numbers != numbers.round()):
            raise UserError(where, str(value), expected="rows and columns, such as [1080, 1920]")
        return int(numbers[0]), int(numbers[1])


class _Wavelengths:
    """Field type of the lasers' wavelengths, ascending."""

    def parse(self, value: Any, where: str) -> tuple[float, ...]:
        numbers = Array(Number("nm", low=100e-9, high=10e-6)).parse(value, where)
        wavelengths = tuple(sorted(float(λ) for λ in numbers)) if numbers is not None else ()
        if not wavelengths:
            raise UserError(where, "is empty", expected="at least one wavelength")
        if len(set(wavelengths)) != len(wavelengths):
            raise UserError(where, "one is listed twice", expected="distinct wavelengths")
        return wavelengths


_LENGTHS = Span(Number("mm", low=-1.0, high=10.0))
_LIMITS: dict[str, ValueType] = {
    "power": POSITIVE,
    "exposure": Span(POSITIVE),
    "stage": _LENGTHS,
}
_FACTS: dict[str, dict[str, ValueType]] = {
    "slm1": {"shape": _Shape()},
    "slm2": {"shape": _Shape()},
    "camera": {"shape": _Shape()},
    "lasers": {"wavelengths": _Wavelengths()},
    "stage": {"range": _LENGTHS},
}
"""Types of the facts of each device, beside those of the bench; all are required."""
_ELEMENT_FACTS: dict[str, ValueType] = {"num_levels": Integer(2, 65536)}
"""Types of the facts of an element of a chain; none is required."""


@dataclass(frozen=True)
class DeviceSpec:
    """A device that is to be opened. name: its table in rig.toml. kind: who drives it. options: of that kind.

    measures_settling: whether the time that a modulator needs is to be measured; until then its option is a long time.
    """

    name: str
    kind: str
    options: Mapping[str, Any]
    measures_settling: bool = False


@dataclass(frozen=True)
class RigDescription:
    """A rig. All lengths in m, times in s.

    path: of rig.toml. bench: the nominal bench. slm_shape, camera_shape: rows and columns; of a chain, whose elements
    have shapes of their own (`slm_shapes`), the most of each.
    wavelengths_m: of the lasers, ascending. stage_m: the reach of the stage.
    devices: by their tables. virtual: the table of the virtual bench, empty where no device is virtual.
    registration: the measured places of the devices; None: they are as described. With a registration, camera_shape is
    that of the rectified picture, bench has the measured pitch, and stage_m and limits are measured distances.
    described: the rig without it.
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
        """The rig of rig.toml, without a registration."""
        return self.described or self

    def registered(self, registration: Registration) -> RigDescription:
        """The rig with the measured places of its devices. Raises UserError for a registration of other devices."""
        described = self.as_described
        for name, found, own in (
            ("slm_shape", registration.slm_shape, described.slm_shape),
            ("camera_shape", registration.camera_shape, described.camera_shape),
            ("modulators", 1 if registration.slm2_turn is None else 2, len(described.dotted)),
            ("elements", registration.elements, described.aligned_elements),
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
    def modulator_names(self) -> tuple[str, ...]:
        """The tables of the modulators: slm1 and slm2, of a chain the names of the elements that show patterns."""
        chain = self.bench.chain
        return _SLMS[: len(self.bench.slms)] if chain is None else tuple(chain.drive_shapes)

    @property
    def dotted(self) -> tuple[int, ...]:
        """The numbers of the modulators that can make dots: those of phase, or all of a bench that has none."""
        phase = tuple(number for number, slm in enumerate(self.bench.slms) if slm.opd_range_m > 0)
        return phase or tuple(range(len(self.bench.slms)))

    @property
    def gap_space(self) -> str:
        """The name of the first space between the two modulators of a chain that make dots; "" without one."""
        chain = self.bench.chain
        if chain is None or len(self.dotted) < 2:
            return ""
        first, last = (chain.part(self.modulator_names[number]) for number in self.dotted[:2])
        between = zip(chain.element_names[first:last], chain.elements[first:last], strict=True)
        return next((name for name, element in between if isinstance(element, Space)), "")

    @property
    def aligned_elements(self) -> tuple[str, ...]:
        """`Registration.elements`: the modulators of a chain that make dots, and the space between two."""
        if self.bench.chain is None:
            return ()
        names = (*(self.modulator_names[number] for number in self.dotted), self.gap_space)
        return tuple(filter(None, names))

    @property
    def slm_words(self) -> tuple[str, ...]:
        """The modulators in words, as `Captures.slm_names`."""
        return self.blank_capture().slm_names

    @property
    def slm_shapes(self) -> tuple[tuple[int, int], ...]:
        """Rows and columns of each modulator."""
        chain = self.bench.chain
        if chain is None:
            return (self.slm_shape,) * len(self.bench.slms)
        return tuple((rows, columns) for _, rows, columns in chain.drive_shapes.values())

    def together(self, patterns: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Patterns of each modulator as one array (modulator, y, x), smaller ones in the first rows and columns."""
        rows, columns = self.slm_shape
        return np.stack([np.pad(own, [(0, rows - own.shape[0]), (0, columns - own.shape[1])]) for own in patterns])

    @property
    def clear_levels(self) -> list[Levels]:
        """Patterns of each modulator that change no phase and let all light through."""
        chain = self.bench.chain
        named = {} if chain is None else dict(zip(chain.element_names, chain.elements, strict=True))
        tops = [
            slm.num_levels - 1 if isinstance(named.get(name), AmplitudeModulator) else 0
            for name, slm in zip(self.modulator_names, self.bench.slms, strict=True)
        ]
        return [np.full(shape, top, self.levels_type) for shape, top in zip(self.slm_shapes, tops, strict=True)]

    @property
    def levels_type(self) -> type[np.unsignedinteger]:
        """The type of grey levels of all modulators."""
        return np.uint8 if max(slm.num_levels for slm in self.bench.slms) <= 256 else np.uint16

    def random_levels(self, rng: np.random.Generator, sigma_px: float) -> Levels:
        """Random patterns (modulator, y, x), blurred by a Gaussian of `sigma_px` modulator pixels."""
        pairs = zip(self.bench.slms, self.slm_shapes, strict=True)
        return self.together([random_levels(rng, shape, slm.num_levels, sigma_px) for slm, shape in pairs])

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
    chain = _chain(tables.pop("chain"), file) if "chain" in tables else None
    slms = _SLMS if chain is None else tuple(chain.drive_shapes)
    known = (*_TABLES, *_SLMS, "geometry") if chain is None else (*_TABLES, *slms)
    for key, table in tables.items():
        if key not in known or not isinstance(table, Mapping):
            raise UserError(f"{where}: {key}", "unknown table", remedy=suggest_matches(key, known))
    for key in (*(_SLMS[:1] if chain is None else slms), "camera", "lasers", "stage", "limits"):
        check_keys(tables, known, f"{where}: ", required=[key], expected=f"a table [{key}]", noun="table")
    facts = {name: _facts(tables[name], name, where) for name in (*slms, *_DEVICES) if name in tables}
    bench, shape = _bench(tables, facts, where) if chain is None else _bench_of_chain(chain, tables, facts, where)
    rig = RigDescription(
        path=file,
        name=name,
        bench=bench,
        slm_shape=shape,
        camera_shape=facts["camera"]["shape"],
        wavelengths_m=facts["lasers"]["wavelengths"],
        stage_m=facts["stage"]["range"],
        limits=_limits(tables["limits"], facts["stage"]["range"], f"{where}: limits"),
        devices={name: _device(name, tables[name], where, name in slms) for name in facts},
        virtual=dict(tables.get("virtual", {})),
    )
    _check(replace(rig, camera_shape=rig.slm_shape))  # a raw picture may have any shape
    return rig


def _bench(tables: Mapping[str, Any], facts: Mapping[str, Any], where: str) -> tuple[BenchTables, tuple[int, int]]:
    """The bench of one or two modulators, and their shape."""
    shapes = [facts[name]["shape"] for name in _SLMS if name in facts]
    if len(set(shapes)) > 1:
        expected = f"that of slm1, {list(shapes[0])}"
        raise UserError(f"{where}: slm2.shape", str(list(shapes[1])), expected=expected)
    bench = {name: {key: v for key, v in tables[name].items() if key in KEYS[name]} for name in KEYS if name in tables}
    bench |= {"geometry": tables["geometry"]} if "geometry" in tables else {}
    return parse_bench_tables(bench, where), shapes[0]


def _bench_of_chain(
    chain: System, tables: Mapping[str, Any], facts: Mapping[str, Any], where: str
) -> tuple[BenchTables, tuple[int, int]]:
    """The bench of a chain, and the most rows and columns of its modulators."""
    named, slms = dict(zip(chain.element_names, chain.elements, strict=True)), []
    for name in chain.drive_shapes:
        own = slm_of(named[name])  # type: ignore[arg-type]  # it shows patterns
        stated = facts[name].get("num_levels", own.num_levels)
        if getattr(named[name], "levels", None) is not None and stated != own.num_levels:
            raise UserError(f"{where}: {name}.num_levels", f"{stated}", expected=f"{own.num_levels}, as the chain has")
        slms.append(replace(own, num_levels=stated))
    camera = {key: v for key, v in tables["camera"].items() if key in KEYS["camera"]}
    shape = tuple(max(sizes[axis] for sizes in chain.drive_shapes.values()) for axis in (1, 2))
    return chain_tables(chain, tuple(slms), camera, where), (shape[0], shape[1])


def _chain(stated: Any, file: Path) -> System:
    """The chain of elements of a rig, without effects. Raises UserError for a bench that a capture file can't hold."""
    where = f"{file}: chain"
    if not isinstance(stated, str):
        raise UserError(where, f"{stated!r}", expected='the name of a preset, or of a file such as "chain.toml"')
    beside = file.parent / stated
    try:
        system = preset.load(beside if beside.is_file() else stated)
        _require_nominal(system)
    except UserError as error:
        raise error.inside(f"{where}: ") from error
    return system


def virtual_rig_of(chain: System, file: str) -> dict[str, Any]:
    """The tables of rig.toml of virtual devices around a chain of elements, whose preset stands in a file beside it.

    The camera has the samples of the simulation as pixels. Raises UserError for a bench that a capture file can't hold.
    """
    _require_nominal(chain)
    to_mm, near_m = Number("mm").to_toml, chain.way.behind_m
    far_m = max(2 * float(chain.planes_m.max()), near_m + 1e-3)
    camera = {"shape": list(chain.way.shape), "pitch": Number("um").to_toml(chain.way.sample_m)}
    camera |= {"bit_depth": 12, "electrons_per_count": 4.0, "read_noise": 3.0, "black_level": 64}
    stage = [to_mm(near_m), to_mm(far_m)]
    return {
        "name": f"virtual rig of {chain.name}",
        "chain": file,
        **{name: {"device": "virtual", "settle": 0.1} for name in chain.drive_shapes},
        "camera": {"device": "virtual", **camera},
        "lasers": {"device": "virtual", "wavelengths": [Number("nm").to_toml(float(λ)) for λ in chain.wavelengths_m]},
        "stage": {"device": "virtual", "range": stage},
        "limits": {"power": 1.0, "exposure": [1e-5, 0.5], "stage": stage},
        "virtual": {"bench": "hidden.toml"},
    }


def _require_nominal(system: System) -> None:
    """Raises UserError for a system that is no chain of elements, or whose captures no file can hold."""
    if not system.is_chain:
        expected = "a chain of elements; one or two equal phase modulators have the tables [slm1] and [slm2]"
        raise UserError("elements", "one or two equal phase modulators", expected=expected)
    if system.effects or system.eye is not None:
        raise UserError("effects" if system.effects else "eye", "stated", expected="the nominal bench alone")
    check_nominal(system)
    if taken := [name for name in system.drive_shapes if name in _TABLES]:
        raise UserError("elements", f'"{taken[0]}", a table of its own', expected="another name of the element")


def _check(rig: RigDescription) -> None:
    """Raises UserError for a rig whose captures no file can hold."""
    try:
        check_settings(rig.blank_capture())
    except UserError as error:
        raise error.inside(f"{rig.path}: ") from error


def _facts(table: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
    """The facts of a device, parsed, without those of the bench and the options of its kind."""
    types = _FACTS.get(name, _ELEMENT_FACTS)
    required = types if name in _FACTS else ()
    return read_table({k: v for k, v in table.items() if k in types}, types, f"{where}: {name}.", required=required)


def _limits(table: Mapping[str, Any], reach_m: tuple[float, float], where: str) -> SafetyLimits:
    """The safety limits. reach_m: of the stage, beyond which they can't go."""
    values = read_table(table, _LIMITS, f"{where}.", required=("power", "exposure"))
    stage_m = values.get("stage", reach_m)
    if not reach_m[0] <= stage_m[0] <= stage_m[1] <= reach_m[1]:
        expected = f"a range within {' … '.join(units.format_rounded(z, 'mm') for z in reach_m)}, that of the stage"
        raise UserError(f"{where}.stage", " … ".join(units.format_rounded(z, "mm") for z in stage_m), expected=expected)
    return SafetyLimits(values["power"], values["exposure"], stage_m)


def _device(name: str, table: Mapping[str, Any], where: str, is_modulator: bool) -> DeviceSpec:
    facts = (*KEYS.get(name, ()), *_FACTS.get(name, _ELEMENT_FACTS))
    options = {key: v for key, v in table.items() if key not in facts}
    kind = options.get("device")
    if not isinstance(kind, str):
        raise UserError(f"{where}: {name}.device", "is missing" if kind is None else f"{kind!r}", expected="a text")
    own = {key: value for key, value in options.items() if key != "device"}
    if not is_modulator or "settle" not in own:
        return DeviceSpec(name, kind, own)
    is_auto = own["settle"] == "auto"
    if not is_auto:
        Number(low=0.0, high=1000.0).parse(own["settle"], f"{where}: {name}.settle")
    return DeviceSpec(name, kind, own | {"settle": _LONG_SETTLE_S} if is_auto else own, is_auto)


def with_settle(text: str, name: str, settle_s: float) -> str:
    """The text of rig.toml with another `settle` in the table [name], in milliseconds rounded up."""
    lines, value = text.splitlines(keepends=True), f"settle = {math.ceil(settle_s * 1e3) / 1e3:g}"
    begin = next(k for k, line in enumerate(lines) if re.match(rf"\s*\[\s*[\"']?{re.escape(name)}[\"']?\s*\]", line))
    end = next((k for k in range(begin + 1, len(lines)) if lines[k].lstrip().startswith("[")), len(lines))
    for k in range(begin + 1, end):
        if re.match(r"\s*settle\s*=", lines[k]):
            lines[k] = re.sub(r"settle\s*=\s*(\"[^\"]*\"|[^\s#]+)", value, lines[k])
            return "".join(lines)
    lines.insert(begin + 1, f"{value}\n")
    return "".join(lines)
