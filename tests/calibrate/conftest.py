"""Virtual captures of a bench with several faults, and a calibration that is trained on them once for all tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest

from holoview.bench.calibrate.train import (
    CalibrationSettings,
    DataSplit,
    TrainingState,
    map_layout_for,
    split_captures,
    train,
)
from holoview.bench.captures.dataset import Captures
from holoview.bench.captures.virtual_measurement import AcquisitionSettings, make_captures
from holoview.light.model.bench_parts import Modulator, Relay
from holoview.light.model.effects.learned_maps import MapLayout
from holoview.light.model.system import System

SHAPE = (36, 48)
PITCH = 8e-6
TRUTH: dict[str, dict[str, float]] = {
    "lut": {"gamma1": 1.25, "gamma2": 0.85},
    "crosstalk": {"sigma": 0.35},
    "slm_alignment": {"shift_y": 3e-6, "shift_x": -2e-6, "rotation": 6e-3},
    "source_profile": {"fall": 0.3, "slope_x": 0.15},
    "aberration1": {"z5": 60e-9, "z6": -40e-9},
    "aberration2": {"z7": 80e-9, "z5_slope": 20e-9},
    "laser_power": {"exponent": 0.15},
}


@dataclass(frozen=True)
class TrainedCalibration:
    """A calibration: the hidden effects of the bench, captures, split, layout of the maps, and state of each epoch."""

    hidden: dict[str, dict[str, float]]
    captures: Captures
    split: DataSplit
    layout: MapLayout
    states: list[TrainingState]


def bench(wavelengths: int = 3, planes: tuple[float, ...] = (3e-3,)) -> System:
    """A small dual-modulator bench without faults."""
    modulator = Modulator(pitch_m=PITCH, shape=SHAPE, stroke_m=825e-9, levels=16)
    return System(
        wavelengths_m=[460e-9, 532e-9, 638e-9, 600e-9][:wavelengths],
        amplitudes=[[1.0] * wavelengths],
        modulators=(modulator, modulator),
        gap_m=1e-3,
        planes_m=planes,
        relay1=Relay(iris_na=0.03),
        relay2=Relay(iris_na=0.03),
        observer="mono",
    )


def session(each: int = 7, seed: int = 1, **changes: object) -> Captures:
    """Virtual captures of the small bench with all its faults, `each` for every wavelength and plane."""
    return make_captures(bench(**changes), TRUTH, AcquisitionSettings(captures_per_condition=each, seed=seed))  # type: ignore[arg-type]


@pytest.fixture
def make_bench() -> Callable[..., System]:
    """The function `bench`, for a number of wavelengths and planes."""
    return bench


@pytest.fixture(scope="session")
def small() -> Captures:
    """Two captures for each wavelength, for tests that need no trained maps."""
    return session(each=2)


@pytest.fixture(scope="session")
def trained() -> TrainedCalibration:
    """A calibration of 40 epochs, trained on 17 of 21 captures."""
    captures = session()
    split = split_captures(captures)
    layout = map_layout_for(captures, split.train)
    states = list(train(captures, {}, split, layout, CalibrationSettings(epochs=40, batch=2)))
    return TrainedCalibration(TRUTH, captures, split, layout, states)
