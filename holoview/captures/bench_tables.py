"""The tables of TOML that describe a measured bench: `[slm1]`, `[slm2]`, `[camera]` and `[geometry]`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from holoview.captures.capture_file import camera_from_attributes, slm_from_attributes
from holoview.captures.dataset import Camera, SlmSpec
from holoview.captures.nominal_stops import STOP_KEYS, stops_from_attributes
from holoview.model.bench_parts import Relay
from holoview.model.field_types import FieldType, Number
from holoview.util.errors import UserError, suggest_matches

_SLM_KEYS: dict[str, Number] = {"pitch": Number("um"), "num_levels": Number(), "opd_range": Number("nm")}
_CAMERA_KEYS: dict[str, Number] = {
    "pitch": Number("um"),
    "bit_depth": Number(),
    "electrons_per_count": Number(),
    "read_noise": Number(),
    "black_level": Number(),
}
_GEOMETRY_KEYS: dict[str, FieldType] = {
    "gap": Number("mm"),
    "focal_length": Number("mm"),
    **STOP_KEYS,
}
KEYS: Mapping[str, Mapping[str, FieldType]] = {
    "slm1": _SLM_KEYS,
    "slm2": _SLM_KEYS,
    "camera": _CAMERA_KEYS,
    "geometry": _GEOMETRY_KEYS,
}
"""Type of each key of each table."""


@dataclass(frozen=True)
class BenchTables:
    """The nominal bench that the tables describe; the fields are those of `Captures`."""

    slms: tuple[SlmSpec, ...]
    camera: Camera
    gap_m: float | None
    relay1: Relay
    relay2: Relay
    focal_length_m: float | None

    def as_fields(self) -> dict[str, Any]:
        """The fields of `Captures` that are the bench's."""
        return dict(vars(self))


def parse_bench_tables(tables: Mapping[str, Any], where: str) -> BenchTables:
    """The bench of the tables of a TOML file. where: names the file in errors.

    Raises UserError where a table or key is unknown, missing or wrong.
    """
    bench: dict[str, dict[str, Any]] = {}
    for name, table in tables.items():
        if name not in KEYS or not isinstance(table, Mapping):
            raise UserError(f"{where}: {name}", "unknown table", remedy=suggest_matches(name, KEYS))
        bench[name] = {key: _value(KEYS[name], key, value, f"{where}: {name}") for key, value in table.items()}
    for name in ("slm1", "camera", *(["slm2"] if "slm2" in bench else [])):
        for key in KEYS[name]:
            if key not in bench.get(name, {}):
                raise UserError(f"{where}: {name}.{key}", "is missing")
    geometry, place = bench.get("geometry", {}), f"{where}: geometry."
    return BenchTables(
        slms=tuple(slm_from_attributes(bench[name]) for name in ("slm1", "slm2") if name in bench),
        camera=camera_from_attributes(bench["camera"]),
        gap_m=geometry.get("gap"),
        relay1=stops_from_attributes(geometry, 1, place),
        relay2=stops_from_attributes(geometry, 2, place),
        focal_length_m=geometry.get("focal_length"),
    )


def _value(known: Mapping[str, FieldType], key: str, value: Any, where: str) -> Any:
    if key not in known:
        raise UserError(f"{where}.{key}", "unknown key", remedy=suggest_matches(key, known))
    return known[key].parse(value, f"{where}.{key}")
