"""Safety limits: what they don't allow never reaches a device; lasers go off whatever ends a block."""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from holoview.bench.rig.devices import Counts, DeviceError, Devices, Levels, SafetyLimits, call_device, limit_devices
from holoview.bench.rig.open_rig import SystemClock
from holoview.util.errors import UserError

LIMITS = SafetyLimits(power=0.5, exposures_s=(1e-3, 0.1), stage_m=(1e-3, 5e-3))


@dataclass
class Recorder:
    """Every device in one: notes what it is asked."""

    asked: list[Any] = field(default_factory=list)
    shape: tuple[int, int] = (2, 3)
    settle_s: float = 0.0
    exposures_s: tuple[float, float] = (1e-4, 0.05)
    wavelengths_m: tuple[float, ...] = (500e-9,)
    range_m: tuple[float, float] = (2e-3, 9e-3)
    close_raises: bool = False

    def show(self, levels: Levels) -> None:
        self.asked.append(levels)

    def set_exposure(self, exposure_s: float) -> float:
        self.asked.append(exposure_s)
        return exposure_s

    def take(self) -> Counts:
        return np.zeros(self.shape, np.uint16)

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.asked.append(power)

    def switch_off(self) -> None:
        self.asked.append("off")

    def move_to(self, distance_m: float) -> float:
        self.asked.append(distance_m)
        return distance_m

    def close(self) -> None:
        self.asked.append("close")
        if self.close_raises:
            raise DeviceError("it", "can't be closed")


def _devices(**parts: Recorder) -> Devices:
    names = ("modulator", "camera", "lasers", "stage")
    modulator, camera, lasers, stage = (parts.get(name, Recorder()) for name in names)
    return Devices((modulator,), camera, lasers, stage, SystemClock())


ALLOWED: dict[str, tuple[Callable[[Devices, float], Any], float, float]] = {
    "power": (lambda d, value: d.lasers.switch_on(500e-9, value), 0.0, 0.5),
    "exposure": (lambda d, value: d.camera.set_exposure(value), 1e-3, 0.1),
    "stage": (lambda d, value: d.stage.move_to(value), 1e-3, 5e-3),
}


@pytest.mark.parametrize("name", ALLOWED)
def test_both_ends_of_a_limit_pass_and_nothing_beyond_them_does(name: str) -> None:
    call, low, high = ALLOWED[name]
    every = Recorder()
    devices = limit_devices(_devices(camera=every, lasers=every, stage=every), LIMITS)
    for value in (low, high):
        call(devices, value)
    for value in (np.nextafter(low, -1), np.nextafter(high, 1), -1.0, float("nan"), float("inf")):
        with pytest.raises(UserError, match=rf"^{name}:.*\[limits\]"):
            call(devices, value)
    assert every.asked == [low, high]


def test_ranges_are_what_device_and_limits_both_allow() -> None:
    devices = limit_devices(_devices(), LIMITS)
    assert devices.camera.exposures_s == (1e-3, 0.05)
    assert devices.stage.range_m == (2e-3, 5e-3)
    assert devices.lasers.wavelengths_m == (500e-9,) and devices.camera.shape == (2, 3)


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, RuntimeError, DeviceError])
def test_lasers_go_off_first_and_every_device_is_closed_whatever_ends_the_block(error: type[BaseException]) -> None:
    every = Recorder()
    arguments = ("it", "is gone") if error is DeviceError else ("it",)
    with (
        pytest.raises(error),
        limit_devices(_devices(modulator=every, camera=every, lasers=every, stage=every), LIMITS),
    ):
        raise error(*arguments)
    assert every.asked == ["off", *["close"] * 4]


def test_a_device_that_cant_be_closed_keeps_no_other_one_open() -> None:
    lasers, stage, camera = Recorder(close_raises=True), Recorder(close_raises=True), Recorder()
    with pytest.raises(DeviceError, match="can't be closed"), _devices(lasers=lasers, stage=stage, camera=camera):
        pass
    assert lasers.asked == ["off", "close"] and stage.asked == ["close"] and camera.asked == ["close"]


@pytest.mark.parametrize(("signals", "asked"), [(0, ["off"]), (1, ["off"]), (2, [])])
def test_an_impatient_second_interrupt_comes_after_the_lasers_are_off(signals: int, asked: list[str]) -> None:
    """Not so a third one, for a laser that doesn't answer."""

    class Slow(Recorder):
        def switch_off(self) -> None:
            for _ in range(signals):
                signal.raise_signal(signal.SIGINT)
            super().switch_off()

    lasers, stage = Slow(), Recorder()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), _devices(lasers=lasers, stage=stage):
            raise KeyboardInterrupt
    finally:
        signal.signal(signal.SIGINT, before)
    assert lasers.asked == [*asked, "close"] and stage.asked == ["close"]


def test_what_a_library_raises_names_the_device_and_a_remedy() -> None:
    def fail() -> None:
        raise OSError("no such port")

    with pytest.raises(DeviceError, match=r"^stage: didn't move: no such port; plug it in$"):
        call_device("stage", "move", "plug it in", fail)
    assert call_device("stage", "move", "", lambda: 3) == 3
