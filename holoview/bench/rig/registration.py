"""The registration of a rig, between its modulators and its camera, which `holoview rig align` finds.

It stands in RIG.placement.toml beside rig.toml:

    [turned]                          # one of `captures.dataset: ORIENTATIONS`, against the picture on modulator 1
    camera = "rotate_90"              # and slm2
    [picture]                         # the part of the raw picture, turned back, that shows modulator 1
    first = [24, 31]                  # row and column
    shape = [192, 256]
    [found_for]                       # the devices of rig.toml; others need another alignment
    slm_shape = [96, 128]
    camera_shape = [320, 240]
    modulators = 2                    # that make dots; of a chain `elements` has their names, and the space between
    [values]                          # each with its uncertainty, one standard deviation
    pitch = ["3.8835 um", "0.0001 um"]

Turning and cropping pictures is exact. Other corrections would need resampling and aren't made: the remaining
displacement and rotation are known effects, with which a diagnosis begins.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from holoview.bench.captures.dataset import ORIENTATIONS, oriented_shape, undone
from holoview.bench.rig.devices import CameraDevice, Counts, Devices, Levels, ModulatorDevice, StageDevice, Wrapped
from holoview.light.model.effects.on_element import AT
from holoview.light.model.fields import Array, Number
from holoview.util import units
from holoview.util.errors import UserError, suggest_matches
from holoview.util.file_writer import write_file
from holoview.util.files import read_text
from holoview.util.tables import check_keys, parse_toml

_EXPECTED = "the placement of a rig's devices in TOML"
_REMEDY = "run `holoview rig align` again, or remove the file"
_HEADER = "# Where the devices are, found by `holoview rig align`. Without this file the nominal places count.\n"
_UNITS = {
    "pitch": "um", "rotation": "mrad", "shift_y": "um", "shift_x": "um", "walk_y": "mrad", "walk_x": "mrad",
    "stage_offset": "mm", "stage_scale": "",
    "slm2_shift_y": "um", "slm2_shift_x": "um", "slm2_rotation": "mrad", "slm2_magnification": "", "gap_error": "mm",
}  # fmt: skip
_SECOND = ("slm2_shift_y", "slm2_shift_x", "slm2_rotation", "slm2_magnification", "gap_error")
_EFFECTS = {
    "shift_y": "camera_alignment.shift_y", "shift_x": "camera_alignment.shift_x",
    "rotation": "camera_alignment.rotation", "walk_y": "stage.walk_y", "walk_x": "stage.walk_x",
    "slm2_shift_y": "slm_alignment.shift_y", "slm2_shift_x": "slm_alignment.shift_x",
    "slm2_rotation": "slm_alignment.rotation", "slm2_magnification": "slm_alignment.magnification",
    "gap_error": "gap.gap_error",
}  # fmt: skip
_MEASURED = _EFFECTS | {"stage_offset": "distance.distance_error", "stage_scale": "stage.scale"}
_SIGNIFICANT = 2.0  # standard deviations from zero, from which on a value counts as known
_SPARE_DIGITS = 1


@dataclass(frozen=True)
class UncertainValue:
    """A value with its standard deviation, in SI units."""

    value: float
    uncertainty: float

    @property
    def is_significant(self) -> bool:
        """Whether the value is farther from zero than chance puts it."""
        return abs(self.value) > _SIGNIFICANT * self.uncertainty


@dataclass(frozen=True)
class Registration:
    """The measured places of a rig's devices.

    camera_turn, slm2_turn: of the raw picture, and of the picture on modulator 2, against the picture on modulator 1;
    slm2_turn is None with one modulator. first, shape: first row and column, and numbers of rows and columns, of the
    rectified picture in the raw picture turned back. slm_shape, camera_shape: of the devices of the alignment.
    elements: of a chain, the names of the modulators that made dots, and after them that of the space between two.
    values: by the names of the file. `pitch` is the camera's, referred to the modulators; shift, rotation and walk are
    those of the rectified picture; a distance is stage_offset + (1 + stage_scale)·setting.
    """

    camera_turn: str
    slm2_turn: str | None
    first: tuple[int, int]
    shape: tuple[int, int]
    slm_shape: tuple[int, int]
    camera_shape: tuple[int, int]
    values: Mapping[str, UncertainValue] = field(default_factory=dict)
    elements: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, str]:
        """The modulators in words; of a single one that alone counts."""
        one, other = (*self.elements[:2], "", "")[:2] if self.elements else ("modulator 1", "modulator 2")
        return one, other

    def _effect(self, name: str) -> tuple[str, str]:
        """The effect and its parameter that a value is."""
        effect, parameter = _MEASURED[name].split(".")
        if self.elements and name in _SECOND:
            on = self.elements[2] if name == "gap_error" else self.elements[1]
            effect = f"{'gap' if name == 'gap_error' else 'misplaced'}{AT}{on}"
        return effect, parameter

    def __getitem__(self, name: str) -> float:
        return self.values[name].value

    def distance_m(self, setting_m: float) -> float:
        """The distance from the last modulator at a setting of the stage."""
        return self["stage_offset"] + (1 + self["stage_scale"]) * setting_m

    def setting_m(self, distance_m: float) -> float:
        """The setting of the stage at which the camera is at a distance."""
        return (distance_m - self["stage_offset"]) / (1 + self["stage_scale"])

    def known_effects(self) -> dict[str, dict[str, float]]:
        """Effects that rectified pictures still have, {effect: {parameter: value}}, without insignificant values."""
        known: dict[str, dict[str, float]] = {}
        for name in _EFFECTS:
            found = self.values.get(name)
            if found is not None and found.is_significant:
                identity, parameter = self._effect(name)
                known.setdefault(identity, {})[parameter] = rounded_to(found.value, found.uncertainty)
        return known

    def uncertain_effects(self) -> dict[str, dict[str, float]]:
        """Standard deviations of the registration's values, {effect: {parameter: standard deviation}}, in SI units."""
        sigmas = {self._effect(name): self.values[name].uncertainty for name in _MEASURED if name in self.values}
        if "pitch" in self.values:
            sigmas["camera_alignment", "magnification"] = self.values["pitch"].uncertainty / self["pitch"]
        result: dict[str, dict[str, float]] = {}
        for (identity, parameter), sigma in sigmas.items():
            if sigma > 0:
                result.setdefault(identity, {})[parameter] = sigma
        return result


def registration_path(rig_path: Path) -> Path:
    """The file of the registration of a rig."""
    return rig_path.with_name(f"{rig_path.stem}.placement.toml")


def write_registration(path: Path, registration: Registration) -> None:
    """Writes the file whole or not at all; equal placements give equal files. Raises WriteError."""
    turned = {"camera": registration.camera_turn}
    if registration.slm2_turn is not None:
        turned["slm2"] = registration.slm2_turn
    table = {
        "turned": turned,
        "picture": {"first": list(registration.first), "shape": list(registration.shape)},
        "found_for": {
            "slm_shape": list(registration.slm_shape),
            "camera_shape": list(registration.camera_shape),
            "modulators": 1 if registration.slm2_turn is None else 2,
            **({"elements": list(registration.elements)} if registration.elements else {}),
        },
        "values": {
            name: _pair(registration.values[name], _UNITS[name]) for name in _UNITS if name in registration.values
        },
    }
    pairs_in_a_line = re.sub(r"\[\n +(.+),\n +(.+),\n\]", r"[\1, \2]", tomli_w.dumps(table))
    write_file(path, _HEADER + pairs_in_a_line)


def read_registration(path: Path) -> Registration:
    """Reads the file. Raises UserError that names a missing, unknown or wrong key."""
    tables, where = parse_toml(read_text(path, _EXPECTED), str(path), _EXPECTED), str(path)
    for key in ("turned", "picture", "found_for", "values"):
        if not isinstance(tables.get(key), Mapping):
            raise UserError(f"{where}: {key}", "is missing", expected=f"a table [{key}]", remedy=_REMEDY)
    turned, found_for = tables["turned"], tables["found_for"]
    two, elements = found_for.get("modulators") == 2, found_for.get("elements", [])
    counts = (0, 2, 3) if two else (0, 1)
    if not (isinstance(elements, list) and all(isinstance(n, str) for n in elements) and len(elements) in counts):
        raise UserError(f"{where}: found_for.elements", f"{elements!r}", expected="names of elements", remedy=_REMEDY)
    registration = Registration(
        camera_turn=_turn(turned, "camera", where),
        slm2_turn=_turn(turned, "slm2", where) if two else None,
        first=_whole_pair(tables["picture"], "first", f"{where}: picture", 0),
        shape=_whole_pair(tables["picture"], "shape", f"{where}: picture", 1),
        slm_shape=_whole_pair(found_for, "slm_shape", f"{where}: found_for", 1),
        camera_shape=_whole_pair(found_for, "camera_shape", f"{where}: found_for", 1),
        values=_values(tables["values"], _wanted(two, elements), f"{where}: values"),
        elements=tuple(elements),
    )
    raw = oriented_shape(registration.camera_shape, registration.camera_turn)
    if any(first + n > whole for first, n, whole in zip(registration.first, registration.shape, raw, strict=True)):
        raise UserError(f"{where}: picture", "reaches beyond the camera's picture", remedy=_REMEDY)
    return registration


def _wanted(two: bool, elements: Sequence[str]) -> list[str]:
    """The names of the values that a file has."""
    missing = set() if two else set(_SECOND)
    if elements:
        missing |= {"slm2_magnification", *(["gap_error"] if len(elements) < 3 else [])}
    return [name for name in _UNITS if name not in missing]


def _values(table: Mapping[str, Any], wanted: Sequence[str], where: str) -> dict[str, UncertainValue]:
    check_keys(table, wanted, f"{where}.")
    values = {}
    for name in wanted:
        if name not in table:
            raise UserError(f"{where}.{name}", "is missing", remedy=_REMEDY)
        pair = Array(Number(_UNITS[name])).parse(table[name], f"{where}.{name}")
        if pair is None or len(pair) != 2 or pair[1] < 0:
            raise UserError(f"{where}.{name}", f"{table[name]}", expected="a value and its uncertainty")
        values[name] = UncertainValue(float(pair[0]), float(pair[1]))
    if not (values["pitch"].value > 0 and values["stage_scale"].value > -1):
        raise UserError(where, "a pitch or a scale of the stage that can't be", remedy=_REMEDY)
    return values


def _turn(table: Mapping[str, Any], key: str, where: str) -> str:
    if table.get(key) not in ORIENTATIONS:
        remedy = suggest_matches(str(table.get(key)), ORIENTATIONS)
        raise UserError(f"{where}: turned.{key}", f"{table.get(key)!r}", remedy=remedy)
    return str(table[key])


def _whole_pair(table: Mapping[str, Any], key: str, where: str, least: int) -> tuple[int, int]:
    value = table.get(key)
    if not (isinstance(value, list) and len(value) == 2 and all(type(n) is int and n >= least for n in value)):
        raise UserError(f"{where}.{key}", f"{value!r}", expected=f"two whole numbers of at least {least}")
    return value[0], value[1]


def _pair(found: UncertainValue, unit: str) -> list[Any]:
    """Value and uncertainty as text, or as numbers where they have no unit."""
    pair = [rounded_to(found.value, found.uncertainty), float(f"{found.uncertainty:.2g}")]
    return [units.format_exact(x, unit) for x in pair] if unit else pair


def rounded_to(value: float, uncertainty: float) -> float:
    """A value with one digit more than its uncertainty allows."""
    if not uncertainty > 0:
        return value
    return round(value, _SPARE_DIGITS + 1 - int(np.floor(np.log10(uncertainty))))


def register_devices(devices: Devices, registration: Registration, second: int = 1) -> Devices:
    """The same devices: levels are turned on their way out, pictures turned back and cropped, distances measured.

    second: the number of the modulator that `slm2_turn` is of.
    """
    turns = ["none"] * len(devices.modulators)
    if registration.slm2_turn is not None:
        turns[second] = registration.slm2_turn
    modulators = tuple(_RegisteredModulator(own, turn) for own, turn in zip(devices.modulators, turns, strict=True))
    return replace(
        devices,
        modulators=modulators,
        camera=_RegisteredCamera(devices.camera, registration),
        stage=_RegisteredStage(devices.stage, registration),
    )


@dataclass(eq=False)
class _RegisteredModulator(Wrapped[ModulatorDevice]):
    turn: str

    def show(self, levels: Levels) -> None:
        self.device.show(np.ascontiguousarray(undone(levels, self.turn)))


@dataclass(eq=False)
class _RegisteredCamera(Wrapped[CameraDevice]):
    registration: Registration

    @property
    def shape(self) -> tuple[int, int]:
        return self.registration.shape

    def take(self) -> Counts:
        (row, column), (rows, columns) = self.registration.first, self.registration.shape
        picture = undone(self.device.take(), self.registration.camera_turn)
        return np.ascontiguousarray(picture[row : row + rows, column : column + columns])


@dataclass(eq=False)
class _RegisteredStage(Wrapped[StageDevice]):
    registration: Registration

    @property
    def range_m(self) -> tuple[float, float]:
        low, high = self.device.range_m
        return self.registration.distance_m(low), self.registration.distance_m(high)

    def move_to(self, distance_m: float) -> float:
        setting = float(np.clip(self.registration.setting_m(distance_m), *self.device.range_m))  # undoes rounding
        return self.registration.distance_m(self.device.move_to(setting))
