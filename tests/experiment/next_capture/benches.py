"""Small virtual benches for closed loops, within this process: starting one of their own takes seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import tomli_w

from holoview.bench.rig import RigDescription, read_rig
from holoview.bench.rig.devices import Counts, Devices, Levels
from holoview.bench.rig.virtual.server import VirtualBench, read_virtual_settings

_SLM = {
    "device": "virtual",
    "shape": [24, 32],
    "pitch": "8 um",
    "num_levels": 256,
    "opd_range": "825 nm",
    "settle": 0.1,
}


def write_rig(folder: Path, effects: dict[str, dict[str, Any]], stage: tuple[str, str] = ("0 mm", "10 mm")) -> Path:
    """rig.toml of two modulators and two lasers with these effects hidden."""
    tables = {
        "slm1": _SLM,
        "slm2": _SLM,
        "camera": {
            "device": "virtual",
            "shape": [48, 64],
            "pitch": "4 um",
            "bit_depth": 12,
            "electrons_per_count": 4.0,
            "read_noise": 3.0,
            "black_level": 64,
        },
        "lasers": {"device": "virtual", "wavelengths": ["450 nm", "638 nm"]},
        "stage": {"device": "virtual", "range": list(stage)},
        "limits": {"power": 1.0, "exposure": [1e-5, 0.5]},
        "geometry": {"gap": "1 mm", "iris1_na": 0.03, "iris2_na": 0.03},
        "virtual": {"seed": 5, "effects": effects},
    }
    (folder / "rig.toml").write_text(tomli_w.dumps(tables), encoding="utf-8")
    return folder / "rig.toml"


class BenchInProcess:
    """All devices of a virtual bench. switched: what was asked of the lasers, None for off."""

    def __init__(self, rig: RigDescription) -> None:
        self.bench, self.rig = VirtualBench(rig, read_virtual_settings(rig)), rig
        self.exposures_s, self.range_m, self.wavelengths_m = rig.limits.exposures_s, rig.stage_m, rig.wavelengths_m
        self.shape, self.switched = rig.camera_shape, list[float | None]()
        self.is_closed = False

    def devices(self) -> Devices:
        return Devices((_Modulator(self, 0), _Modulator(self, 1)), self, self, self, self)

    def set_exposure(self, exposure_s: float) -> float:
        self.bench.exposure_s = exposure_s
        return exposure_s

    def take(self) -> Counts:
        return self.bench.take()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.switched.append(wavelength_m)
        self.bench.laser = (wavelength_m, power)

    def switch_off(self) -> None:
        self.switched.append(None)
        self.bench.laser = None

    def move_to(self, distance_m: float) -> float:
        return self.bench.move_to(distance_m)

    def now(self) -> float:
        return self.bench.time_s

    def wait(self, seconds: float) -> None:
        self.bench.wait(seconds)

    def close(self) -> None:
        self.is_closed = True


class _Modulator:
    def __init__(self, owner: BenchInProcess, number: int) -> None:
        self._owner, self._number, self.shape, self.settle_s = owner, number, owner.rig.slm_shape, 0.1

    def show(self, levels: Levels) -> None:
        self._owner.bench.show(self._number, levels)

    def close(self) -> None:
        self._owner.close()


def make_bench(
    folder: Path, effects: dict[str, dict[str, Any]], stage: tuple[str, str] = ("0 mm", "10 mm")
) -> BenchInProcess:
    """A virtual bench with these effects hidden."""
    return BenchInProcess(read_rig(write_rig(folder, effects, stage)))
