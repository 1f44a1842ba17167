"""A modulator's table measured on virtual rigs, in the near field and on a Fourier bench, with faults."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from holoview.bench.calibrate.lut_fit import FittedLut, fit_labelled
from holoview.bench.experiment.lut_sweep import LutMeasurement, SweepPlan, SweepReadings
from holoview.bench.rig import RigDescription
from holoview.bench.rig.devices import Devices, Wrapped
from holoview.util.errors import UserError
from tests.rig.conftest import MakeRig, direct_devices

SLM: dict[str, Any] = {
    "device": "virtual",
    "shape": [32, 64],
    "pitch": "8 um",
    "num_levels": 256,
    "opd_range": "800 nm",
    "settle": 0.1,
}
STROKE_M, GAMMA = 800e-9, 1.3
HIDDEN: dict[str, Any] = {
    "seed": 3,
    "settle": 0.02,
    "power_drift": 0.3,
    "placement": {"camera": "rotate_90"},
    "effects": {
        "lut": {"gamma1": GAMMA},
        "camera_alignment": {"shift_y": "20 um", "shift_x": "-30 um"},
        "undiffracted": {"share": 0.1},
    },
}
NEAR: dict[str, Any] = {"slm1": SLM, "slm2": SLM, "camera.shape": [160, 160], "virtual": HIDDEN}
FOURIER: dict[str, Any] = {
    **NEAR,
    "slm2": None,
    "camera.bit_depth": 8,
    "camera.black_level": 6,
    "camera.electrons_per_count": 50.0,
    "geometry": {"focal_length": "20 mm"},
    "stage.range": ["-2 mm", "2 mm"],
}


def _plan(rig: RigDescription, periods: tuple[int, ...], count: int = 48) -> SweepPlan:
    levels = np.linspace(0, 255, count).round().astype(np.int64)
    return SweepPlan(0, rig.wavelengths_m, periods, levels)


def _measured(rig: RigDescription, plan: SweepPlan, file: Path, devices: Devices | None = None) -> SweepReadings:
    readings = SweepReadings.at(file, plan)
    LutMeasurement(rig, devices or direct_devices(rig), lambda _: None).run(plan, readings, lambda *_: None)
    return readings


def _error(lut: FittedLut) -> float:
    """R.m.s. deviation from the true phase, rad, up to the phase of the first step of a level."""
    true = 2 * math.pi * STROKE_M / 450e-9 * (lut.levels / 255) ** GAMMA
    return float(np.sqrt(np.mean((lut.phase - true) ** 2)))


class Watched(Wrapped[Any]):
    """A camera that breaks down after so many pictures. runs: numbers of saturated pixels since each new exposure."""

    def __init__(self, camera: Any, saturation: int, last: int = 10**9) -> None:
        super().__init__(camera)
        self.saturation, self.last, self.pictures = saturation, last, 0
        self.runs = list[list[int]]()

    def set_exposure(self, exposure_s: float) -> float:
        self.runs.append([])
        return float(self.device.set_exposure(exposure_s))

    def take(self) -> Any:
        self.pictures += 1
        if self.pictures > self.last:
            raise KeyboardInterrupt
        picture = self.device.take()
        self.runs[-1].append(int((picture >= self.saturation).sum()))
        return picture


def _watched(rig: RigDescription, last: int = 10**9) -> tuple[Devices, Watched]:
    devices = direct_devices(rig)
    camera = Watched(devices.camera, int(rig.bench.camera.saturation), last)
    return Devices(devices.modulators, camera, devices.lasers, devices.stage, devices.clock), camera


@pytest.mark.long
@pytest.mark.parametrize(("bench", "order"), [(NEAR, "interferometer"), (FOURIER, "0")], ids=["near", "Fourier"])
def test_the_table_is_the_modulators(bench: dict[str, Any], order: str, make_rig: MakeRig, tmp_path: Path) -> None:
    """A camera that is turned and displaced, lasers that drift by 30 % an hour, light that isn't modulated, 450 and 638
    nm. Orders of a modulator of 64 pixels leak into each other by a few per cent, which is 0.01 π of phase and stroke.
    """
    rig = make_rig(bench)
    devices, camera = _watched(rig)
    readings = _measured(rig, _plan(rig, (8, 16)), tmp_path / "t.csv", devices)
    fitted = fit_labelled(readings.sweeps())
    assert {sweep.order for sweep in readings.sweeps()} == {"1", order}
    assert fitted.lut.explains
    assert _error(fitted.lut) < 0.02 * math.pi
    low, high = fitted.lut.stroke_interval
    true = 2 * math.pi * STROKE_M / 450e-9
    assert low - 0.02 * math.pi < true < high + 0.02 * math.pi
    assert fitted.sweeps[-1].wavelength_m == pytest.approx(638e-9)
    assert fitted.lut.fits[-1].factor == pytest.approx(450 / 638, rel=0.02)
    # Not those of the search for an exposure, nor the last one, which may be why the next exposure is shorter.
    sweeps = [run[:-1] for run in camera.runs if len(run) > 16]
    assert len(sweeps) >= 4 and max(map(max, sweeps)) <= 2  # pixels that may be hot


@pytest.mark.long
def test_an_interrupted_sweep_goes_on_and_is_the_same(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig({**NEAR, "lasers.wavelengths": ["450 nm"]})
    plan, file = _plan(rig, (8,)), tmp_path / "t.csv"
    devices, _ = _watched(rig, last=60)
    with pytest.raises(KeyboardInterrupt):
        _measured(rig, plan, file, devices)
    kept = SweepReadings.at(file, plan).count
    assert 0 < kept < 48
    devices, camera = _watched(rig)
    whole = fit_labelled(_measured(rig, plan, file, devices).sweeps()).lut
    again = _measured(rig, plan, file, devices)  # takes nothing
    assert again.count == 48 and camera.pictures < 100
    assert _error(whole) < 0.02 * math.pi


def test_readings_of_another_plan_are_refused(make_rig: MakeRig, tmp_path: Path) -> None:
    rig, file = make_rig({**NEAR, "lasers.wavelengths": ["450 nm"]}), tmp_path / "t.csv"
    _measured(rig, _plan(rig, (8,), 12), file)
    with pytest.raises(UserError, match="holds readings of other levels"):
        SweepReadings.at(file, _plan(rig, (16,), 12))
    file.write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="isn't a table of readings"):
        SweepReadings.at(file, _plan(rig, (8,), 12))


def test_gratings_that_the_camera_cannot_see_are_told(make_rig: MakeRig, tmp_path: Path) -> None:
    """Stripes of half of two pixels, 8 µm, on camera pixels of 4 µm; orders 4.5 mm from the axis of 0.6 mm."""
    rig = make_rig({**NEAR, "lasers.wavelengths": ["450 nm"]})
    with pytest.raises(UserError, match="too fine for the camera"):
        _measured(rig, _plan(rig, (2,), 12), tmp_path / "t.csv")
    rig = make_rig({**FOURIER, "lasers.wavelengths": ["450 nm"], "geometry": {"focal_length": "160 mm"}})
    with pytest.raises(UserError, match="the picture ends before first orders"):
        _measured(rig, _plan(rig, (2,), 12), tmp_path / "t.csv")
