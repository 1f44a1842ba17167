"""A bench of devices that hang, fail, or do as they are told, described by a rig.toml of the kind "fake"."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from holoview.bench.captures.predictor import Predictor
from holoview.bench.captures.virtual_measurement import read_out
from holoview.bench.rig.description import DeviceSpec, RigDescription, read_rig
from holoview.bench.rig.devices import Counts, DeviceError, Levels
from holoview.bench.rig.open_rig import OpeningRig
from holoview.viewer.document.rig_session import BenchState, SentPattern
from tests.patience import PATIENCE_S

FULL_SHARE = 0.5  # of the camera's range that the brightest pixels reach with power 1 and this exposure
FULL_EXPOSURE_S = 0.01
RIG = """
name = "fake bench"
[slm1]
device = "{kind}"
shape = [24, 32]
pitch = "8 um"
num_levels = 256
opd_range = "825 nm"
[camera]
device = "{kind}"
shape = [48, 64]
pitch = "4 um"
bit_depth = 12
electrons_per_count = 4.0
read_noise = 3.0
black_level = 64
[lasers]
device = "{kind}"
wavelengths = ["450 nm", "638 nm"]
[stage]
device = "{kind}"
range = ["0 mm", "10 mm"]
[limits]
power = 1.0
exposure = [1e-5, 0.5]
stage = ["1 mm", "9 mm"]
[virtual]
seed = 1
"""
PLAN = 'each = 3\nwavelengths = ["638 nm"]\ndistances = ["3 mm"]\nexposure = 0.01\n'


def write_rig(folder: Path, kind: str = "fake") -> Path:
    """Writes rig.toml."""
    path = folder / "rig.toml"
    path.write_text(RIG.format(kind=kind), encoding="utf-8")
    return path


class FakeBench:
    """Devices that show the rig's nominal light.

    laser: (wavelength, power) that is on. hangs: by device, set while it hangs. hangs_while: by device, what it hangs
    by. fails: by device, whether it does. calls: what was asked of the devices. opened: how often.
    """

    def __init__(self, path: Path) -> None:
        self.rig: RigDescription = read_rig(path)
        self.laser: tuple[float, float] | None = None
        self.exposure_s, self.distance_m, self.levels = 0.01, 0.0, np.zeros((24, 32), np.uint8)
        self.hangs, self.fails = defaultdict[str, bool](bool), defaultdict[str, bool](bool)
        self.calls, self.opened, self.hangs_while = list[str](), 0, dict[str, Callable[[], bool]]()
        self.hung, self._rng = Event(), np.random.default_rng(0)
        self._light: dict[tuple[Any, ...], Any] = {}

    def open(self, opening: OpeningRig, spec: DeviceSpec) -> _Fake:
        """A device of the kind "fake"."""
        self.opened += spec.name == "camera"
        return _Fake(self, spec.name)

    def enter(self, device: str, call: str) -> None:
        """A call of a device begins: it may hang, and it may fail."""
        self.calls.append(call)
        until = time.monotonic() + PATIENCE_S
        while self._hangs(device) and time.monotonic() < until:
            self.hung.set()
            time.sleep(0.005)
        if self.fails[device]:
            raise DeviceError(device, "didn't answer", remedy="check its cable")

    def _hangs(self, device: str) -> bool:
        while_so = self.hangs_while.get(device)
        return self.hangs[device] or (while_so is not None and while_so())

    def picture(self) -> Counts:
        """What the camera sees: the nominal light with its noise."""
        camera = self.rig.bench.camera
        if self.laser is None:
            return read_out(camera, np.zeros(self.rig.camera_shape), camera.black_level, self._rng)
        key = (self.laser, self.exposure_s, self.distance_m, self.levels.tobytes())
        if key not in self._light:
            state = BenchState(SentPattern(self.levels[None], ""), *self.laser, self.distance_m, self.exposure_s)
            capture = state.capture(self.rig, np.zeros(self.rig.camera_shape, np.uint16))
            assert capture is not None
            signal = Predictor(capture)([0]).signal[0].double().numpy()
            energy = self.laser[1] * self.exposure_s / FULL_EXPOSURE_S
            self._light[key] = signal * (FULL_SHARE * energy * camera.saturation / np.quantile(signal, 0.999))
        return read_out(camera, self._light[key], camera.black_level, self._rng)


class _Fake:
    """Any of the devices, by its name in rig.toml."""

    settle_s = 0.0

    def __init__(self, bench: FakeBench, name: str) -> None:
        self._bench, self._name = bench, name
        self.shape = bench.rig.slm_shape if name == "slm1" else bench.rig.camera_shape
        self.exposures_s, self.range_m = (1e-6, 10.0), bench.rig.stage_m
        self.wavelengths_m = bench.rig.wavelengths_m

    def show(self, levels: Levels) -> None:
        self._bench.enter(self._name, "show")
        self._bench.levels = levels

    def set_exposure(self, exposure_s: float) -> float:
        self._bench.enter(self._name, "expose")
        self._bench.exposure_s = exposure_s
        return exposure_s

    def take(self) -> Counts:
        self._bench.enter(self._name, "take")
        return self._bench.picture()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self._bench.enter(self._name, "on")
        self._bench.laser = (wavelength_m, power)

    def switch_off(self) -> None:
        self._bench.enter(self._name, "off")
        self._bench.laser = None

    def move_to(self, distance_m: float) -> float:
        self._bench.enter(self._name, "move")
        self._bench.distance_m = distance_m
        return distance_m

    def close(self) -> None:
        self._bench.enter(self._name, f"close {self._name}")
