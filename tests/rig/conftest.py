"""A small rig of virtual devices, described in a folder of the test's own."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from holoview.bench.rig import RigDescription, read_rig
from holoview.bench.rig.devices import DeviceError, DeviceGone, Devices, limit_devices
from holoview.bench.rig.virtual.client import (
    Disconnected,
    Packet,
    VirtualCamera,
    VirtualClock,
    VirtualModulator,
    VirtualStage,
)
from holoview.bench.rig.virtual.server import BenchServer, FaultInjector, VirtualBench, read_virtual_settings

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


MakeRig = Callable[..., RigDescription]


@pytest.fixture
def make_rig(tmp_path: Path) -> MakeRig:
    """`make_rig({"slm2": None})` reads a small rig with changes."""

    def make(changes: Mapping[str, Any] | None = None) -> RigDescription:
        return read_rig(write_rig(tmp_path / "rig.toml", changes))

    return make


class DirectBench:
    """A virtual bench in this process, asked as `VirtualBenchProcess` is; faults as its settings say."""

    def __init__(self, rig: RigDescription) -> None:
        settings = read_virtual_settings(rig)
        self.light = VirtualBench(rig, settings)
        self._faults = FaultInjector(settings.faults, lambda: None)
        self._server = BenchServer(self.light, self._faults)

    def ask(self, table: dict[str, Any], array: Any = None) -> Packet:
        """As of `VirtualBenchProcess`."""
        try:
            answer = self._faults.answer(Packet(table, array), self._server.answer)
        except Disconnected as error:
            raise DeviceGone("virtual bench", "is gone") from error
        if "error" in answer.table:
            raise DeviceError("virtual bench", str(answer.table["error"]))
        return answer

    def close(self) -> None:
        """As of `VirtualBenchProcess`."""


class DirectLasers:
    """The lasers of a bench in this process. log: "on" and "off" in turn."""

    def __init__(self, bench: DirectBench, rig: RigDescription) -> None:
        self._bench, self.wavelengths_m, self.log = bench, rig.wavelengths_m, list[str]()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.log.append("on")
        self._bench.light.switch_on(wavelength_m, power)

    def switch_off(self) -> None:
        self.log.append("off")
        self._bench.light.switch_off()

    def close(self) -> None:
        pass


@pytest.fixture
def bench_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Virtual benches that are opened are computed in this process: one of its own takes seconds to begin."""
    opening = import_module("holoview.bench.rig.open_rig")  # the package has a function of this name
    monkeypatch.setattr(opening, "VirtualBenchProcess", lambda path: DirectBench(read_rig(path, is_registered=False)))
    monkeypatch.setattr(opening, "VirtualLasers", DirectLasers)


def direct_devices(rig: RigDescription) -> Devices:
    """The devices of a virtual rig in this process, within its limits."""
    bench: Any = DirectBench(rig)
    settles = [float(rig.devices[name].options.get("settle", 0.0)) for name in rig.modulator_names]
    modulators = tuple(VirtualModulator(bench, rig, number, settle_s) for number, settle_s in enumerate(settles))
    camera, stage, clock = VirtualCamera(bench, rig), VirtualStage(bench, rig), VirtualClock(bench)
    return limit_devices(Devices(modulators, camera, DirectLasers(bench, rig), stage, clock), rig.limits)
