"""The nominal bench of captures as attributes of a capture file and as tables of TOML (`bench.toml`).

Tables: `[slm1]`, `[slm2]`, `[camera]` and `[geometry]`. Stops of relays have the same names in both:

    iris1_na, iris2_na       Relay.iris_na of relay 1, of relay 2
    square1, square2         Relay.square: half the side as an aperture, or text such as "first order at 550 nm"
    centre1_na, centre2_na   Relay.centre_na, [y, x]

A program that knows the irises alone reads these files too, without the others.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Camera, SlmSpec
from holoview.light.model.bench_parts import Relay, Source
from holoview.light.model.elements import AmplitudeModulator, ComplexModulator, Mask, Pixels
from holoview.light.model.fields import FieldType, Number, Truth, fields_by_key, to_mapping
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.util.tables import check_keys, read_table

_NAMES = {"iris_na": "iris{}_na", "square": "square{}", "centre_na": "centre{}_na"}

STOP_KEYS: Mapping[str, FieldType] = {
    name.format(number): fields_by_key(Relay)[field].metadata["kind"]
    for number in (1, 2)
    for field, name in _NAMES.items()
}
"""The field type of each attribute."""


def stops_from_attributes(attributes: Mapping[str, Any], number: int, where: str) -> Relay:
    """The stops of relay `number` (1 or 2) from attributes; attributes of other things are ignored.

    where: the text before an attribute's name in an error. Values may be those of HDF5: numpy numbers, arrays, bytes.
    Raises UserError, which names the attribute, for values that a stop can't have.
    """
    names = {field: name.format(number) for field, name in _NAMES.items()}
    values = {field: _plain(attributes[name]) for field, name in names.items() if name in attributes}
    try:
        return Relay(**values)
    except UserError as error:
        found_in, remedy = (_with_attribute_names(text, names) for text in (error.where, error.remedy))
        raise UserError(where + found_in, error.found, expected=error.expected, remedy=remedy) from error


def stop_attributes(relay: Relay, number: int) -> dict[str, Any]:
    """The attributes of the stops that relay `number` has."""
    stated = stated_keys(relay)
    return {name.format(number): stated[field] for field, name in _NAMES.items() if field in stated}


def has_only_stops(relay: Relay) -> bool:
    """Whether attributes can hold all of a relay: it has neither a DC block, nor apodisation, nor aberrations."""
    return stated_keys(relay).keys() <= _NAMES.keys()


def stated_keys(relay: Relay) -> dict[str, Any]:
    """The keys and values of a relay in presets that differ from those of a relay without stops and pupil."""
    clear = to_mapping(Relay())
    return {key: value for key, value in to_mapping(relay).items() if value != clear.get(key)}


def describe_stops(relay: Relay) -> str:
    """The iris and the square stop in words, for example "iris NA 0.03, square first order, centre [0, 0.002]"."""
    texts = [] if relay.iris_na is None else [f"iris NA {relay.iris_na:g}"]
    if relay.square is not None:
        texts.append(f"square {relay.square}")
    if any(relay.centre_na):
        texts.append("centre [{:g}, {:g}]".format(*relay.centre_na))
    return ", ".join(texts) or "none"


def _plain(value: Any) -> Any:
    """A number, a text or a list of numbers from an attribute's value as HDF5 libraries write it."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.item() if value.size == 1 else value.ravel().tolist()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _with_attribute_names(text: str, names: Mapping[str, str]) -> str:
    """A text about a relay with its keys replaced by the attributes' names."""
    return re.sub(rf"\b({'|'.join(names)})\b", lambda found: names[found[0]], text)


# --- tables of bench.toml --------------------------------------------------------------------------------------------

_SLM_KEYS: dict[str, Number] = {"pitch": Number("um"), "num_levels": Number(), "opd_range": Number("nm")}
_CAMERA_KEYS: dict[str, FieldType] = {
    "pitch": Number("um"),
    "bit_depth": Number(),
    "electrons_per_count": Number(),
    "read_noise": Number(),
    "black_level": Number(),
    "integrates": Truth(),
}
_MAY_BE_ABSENT = ("integrates",)
_GEOMETRY_KEYS: dict[str, FieldType] = {"gap": Number("mm"), "focal_length": Number("mm"), **STOP_KEYS}
KEYS: Mapping[str, Mapping[str, FieldType]] = {
    "slm1": _SLM_KEYS,
    "slm2": _SLM_KEYS,
    "camera": _CAMERA_KEYS,
    "geometry": _GEOMETRY_KEYS,
}
"""Type of each key of each table."""

MAY_BE_UNKNOWN = ("electrons_per_count", "read_noise", "black_level")
"""Keys and attributes of the camera that may be "unknown", NaN then: they are estimated from the pictures."""


@dataclass(frozen=True)
class BenchTables:
    """The nominal bench that the tables describe; the fields are those of `Captures`.

    `bench.toml` has no chain of elements; of a rig it is a preset beside the tables.
    """

    slms: tuple[SlmSpec, ...]
    camera: Camera
    gap_m: float | None
    relay1: Relay
    relay2: Relay
    focal_length_m: float | None
    chain: System | None = None

    def as_fields(self) -> dict[str, Any]:
        """The fields of `Captures` that are the bench's."""
        return dict(vars(self))


def parse_bench_tables(tables: Mapping[str, Any], where: str) -> BenchTables:
    """The bench of the tables of a TOML file. where: names the file in errors.

    Raises UserError where a table or key is unknown, missing or wrong.
    """
    check_keys(tables, KEYS, f"{where}: ", noun="table")
    bench = {name: _table_values(tables, name, where) for name in dict.fromkeys(("slm1", "camera", *tables))}
    geometry, place = bench.get("geometry", {}), f"{where}: geometry."
    return BenchTables(
        slms=tuple(slm_from_attributes(bench[name]) for name in ("slm1", "slm2") if name in bench),
        camera=camera_from_attributes(bench["camera"]),
        gap_m=geometry.get("gap"),
        relay1=stops_from_attributes(geometry, 1, place),
        relay2=stops_from_attributes(geometry, 2, place),
        focal_length_m=geometry.get("focal_length"),
    )


def chain_tables(chain: System, slms: tuple[SlmSpec, ...], camera: Mapping[str, Any], where: str) -> BenchTables:
    """The bench of a chain of elements, and of the table of a camera. Raises UserError as `parse_bench_tables`."""
    values = _table_values({"camera": camera}, "camera", where)
    return BenchTables(slms, camera_from_attributes(values), None, Relay(), Relay(), None, chain)


def _table_values(tables: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
    """The values of one table. Raises UserError where a key is unknown, missing or wrong."""
    table = tables.get(name, {})
    if not isinstance(table, Mapping):
        raise UserError(f"{where}: {name}", f"{table!r}", expected=f"a table [{name}]")
    unknown = [k for k in MAY_BE_UNKNOWN if name == "camera" and table.get(k) == "unknown"]
    required = () if name == "geometry" else [key for key in KEYS[name] if key not in (*unknown, *_MAY_BE_ABSENT)]
    stated = {key: value for key, value in table.items() if key not in unknown}
    values = read_table(stated, KEYS[name], f"{where}: {name}.", required=required)
    return values | dict.fromkeys(unknown, math.nan)


def slm_from_attributes(attributes: Mapping[str, float]) -> SlmSpec:
    """A modulator from the numbers of `slm1` and `slm2`, in SI units."""
    return SlmSpec(attributes["pitch"], int(attributes["num_levels"]), attributes["opd_range"])


def camera_from_attributes(attributes: Mapping[str, float]) -> Camera:
    """A camera from the numbers of `camera`, in SI units, electrons and counts."""
    return Camera(
        pitch_m=attributes["pitch"],
        bit_depth=int(attributes["bit_depth"]),
        electrons_per_count=attributes["electrons_per_count"],
        read_noise=attributes["read_noise"],
        black_level=attributes["black_level"],
        integrates=None if attributes.get("integrates") is None else bool(attributes["integrates"]),
    )


# --- a system as the nominal bench of captures -----------------------------------------------------------------------

_DEFAULT_NUM_LEVELS = 256  # of a modulator that is described as continuous


def slm_of(element: Pixels) -> SlmSpec:
    """What captures state of an element that shows patterns; the path of full drive is 0 for an amplitude."""
    levels = getattr(element, "levels", None)
    count = _DEFAULT_NUM_LEVELS if levels is None else len(levels)
    shares = () if levels is None or _are_even(levels) else tuple(levels.tolist())
    return SlmSpec(element.pitch_m, count, getattr(element, "stroke_m", 0.0), shares)


def _are_even(levels: NDArray[np.float64]) -> bool:
    return np.array_equal(levels, np.linspace(0, 1, len(levels)))


def check_nominal(system: System) -> None:
    """Raises UserError unless a capture file can hold a system as the nominal bench."""
    remedy = "use a preset without it; `--effects` can add it as what is really there"
    if system.is_field:
        raise UserError("modulators", "a field", expected="modulators, whose patterns are sent", remedy=remedy)
    for name in ("relay1", "relay2"):
        if not has_only_stops(getattr(system, name)):
            expected = "a nominal relay with an iris and a square stop only"
            raise UserError(name, "has more than stops", expected=expected, remedy=remedy)
    if system.source != Source():
        raise UserError("source", "isn't a single wave on the axis", expected="one plane wave", remedy=remedy)
    for element in system.elements:
        levels = getattr(element, "levels", None)
        if levels is not None and not isinstance(element, AmplitudeModulator) and not _are_even(levels):
            raise UserError("levels", "aren't equal steps", expected="equal steps of the stroke", remedy=remedy)
        if isinstance(element, ComplexModulator):
            expected = "phase and amplitude modulators, whose levels a capture file holds"
            raise UserError("elements", "a complex modulator", expected=expected)
        if isinstance(element, Mask) and element.file:
            raise UserError("elements", "a mask from a file, which a capture file can't hold", expected="a named mask")
