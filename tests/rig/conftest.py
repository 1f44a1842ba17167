"""A small rig of virtual devices, described in a folder of the test's own."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from holoview.rig import RigDescription, read_rig

SHAPE, CAMERA_SHAPE = (16, 24), (32, 48)
LASERS_M = (450e-9, 638e-9)
_SLM: dict[str, Any] = {
    "device": "virtual",
    "shape": list(SHAPE),
    "pitch": "8 um",
    "num_levels": 256,
    "opd_range": "825 nm",
    "settle": 0.1,
}
TABLES: dict[str, Any] = {
    "name": "small bench",
    "slm1": dict(_SLM),
    "slm2": dict(_SLM),
    "camera": {
        "device": "virtual",
        "shape": list(CAMERA_SHAPE),
        "pitch": "4 um",
        "bit_depth": 12,
        "electrons_per_count": 4.0,
        "read_noise": 3.0,
        "black_level": 64,
    },
    "lasers": {"device": "virtual", "wavelengths": ["450 nm", "638 nm"]},
    "stage": {"device": "virtual", "range": ["0 mm", "10 mm"]},
    "limits": {"power": 1.0, "exposure": [1e-5, 0.5]},
    "geometry": {"gap": "1 mm", "iris1_na": 0.03, "iris2_na": 0.03},
    "virtual": {"seed": 3, "settle": 0.02},
}


def write_rig(path: Path, changes: Mapping[str, Any] | None = None) -> Path:
    """Writes rig.toml with changes {"table.key": value}; None removes a key or table."""
    tables = copy.deepcopy(TABLES)
    for name, value in (changes or {}).items():
        *groups, key = name.split(".")
        table = tables
        for group in groups:
            table = table.setdefault(group, {})
        if value is None:
            del table[key]
        else:
            table[key] = value
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path


@pytest.fixture
def make_rig(tmp_path: Path) -> Callable[..., RigDescription]:
    """`make_rig({"slm2": None})` reads a small rig with changes."""

    def make(changes: Mapping[str, Any] | None = None) -> RigDescription:
        return read_rig(write_rig(tmp_path / "rig.toml", changes))

    return make
