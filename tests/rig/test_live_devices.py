"""Devices of a window: lasers that another thread switches off for good."""

from __future__ import annotations

from threading import Event, Thread

import pytest

from holoview.bench.rig.live_devices import LaserInterlock, LasersForbidden
from tests.patience import PATIENCE_S


class _SlowLasers:
    """Lasers that take until `may_go_on` to switch on."""

    wavelengths_m = (450e-9,)

    def __init__(self) -> None:
        self.is_on, self.began, self.may_go_on = False, Event(), Event()

    def switch_on(self, wavelength_m: float, power: float) -> None:
        self.began.set()
        assert self.may_go_on.wait(PATIENCE_S)
        self.is_on = True

    def switch_off(self) -> None:
        self.is_on = False

    def close(self) -> None:
        pass


def test_a_laser_that_was_being_switched_on_goes_off_again() -> None:
    lasers = _SlowLasers()
    interlock = LaserInterlock(lasers)
    interlock.begin(1)
    raised: list[BaseException] = []

    def switch_on() -> None:
        try:
            interlock.switch_on(450e-9, 1.0)
        except LasersForbidden as error:
            raised.append(error)

    thread = Thread(target=switch_on)
    thread.start()
    assert lasers.began.wait(PATIENCE_S)
    interlock.forbid(1)
    lasers.may_go_on.set()
    thread.join()
    assert raised and not lasers.is_on


def test_a_later_call_may_switch_them_on() -> None:
    lasers = _SlowLasers()
    lasers.may_go_on.set()
    interlock = LaserInterlock(lasers)
    interlock.begin(1)
    interlock.forbid(1)
    with pytest.raises(LasersForbidden):
        interlock.switch_on(450e-9, 1.0)
    assert not lasers.began.is_set()
    interlock.begin(2)
    interlock.switch_on(450e-9, 1.0)
    assert lasers.is_on
