"""Open devices with the thread that uses them; the lasers go off at any time, and closing takes a bounded time."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from threading import Thread
from typing import Any

from holoview.experiment.live.device_worker import Deliver, DeviceWorker
from holoview.experiment.live.laser_interlock import LaserInterlock, OffThread
from holoview.experiment.live.watched_devices import DeviceWatch, watch_devices
from holoview.rig.description import RigDescription
from holoview.rig.devices import Devices

OFF_TIMEOUT_S = 3.0
"""How long lasers may take to confirm that they are off."""
_CALL_TIMEOUT_S, _CLOSE_TIMEOUT_S = 2.0, 3.0  # for the call in flight to end; for the devices to close
_MAY_BE_ON = "the lasers may be on: switch them off by hand"

OpenDevices = Callable[[RigDescription], Devices]


class RigConnection:
    """The devices of a rig, from opening to closing.

    deliver: has the owner make a call. open_devices: opens the devices. before: a connection to the same rig that is
    closed before this one is opened. watch: what the thread waits for.
    """

    def __init__(
        self, rig: RigDescription, open_devices: OpenDevices, deliver: Deliver, before: RigConnection | None = None
    ) -> None:
        self.rig, self.watch = rig, DeviceWatch()
        self._open_devices, self._before = open_devices, before
        self._devices: Devices | None = None
        self._lasers: LaserInterlock | None = None
        self._off: OffThread | None = None
        self._asked_off_s = 0.0
        self._worker = DeviceWorker(deliver, self._on_begin)

    def open(self, on_open: Callable[[], None], on_error: Callable[[BaseException], None]) -> None:
        """Opens the devices on their thread, with all lasers off."""
        self._worker.submit(self._open, lambda _: on_open(), on_error, key="open")

    def submit(
        self,
        work: Callable[[Devices], Any],
        on_result: Callable[[Any], None],
        on_error: Callable[[BaseException], None],
        *,
        key: str,
        delay_s: float = 0.0,
    ) -> None:
        """Has the thread make a call with the open devices; see `DeviceWorker.submit`."""
        self._worker.submit(lambda: work(self._opened()), on_result, on_error, key=key, delay_s=delay_s)

    def lasers_off(self) -> None:
        """Switches all lasers off, whatever the devices' thread does; nothing that was asked for before undoes it."""
        if self._lasers is None:
            return
        self._lasers.forbid(self._worker.count)
        self._worker.forget_waiting()
        if self._off is None or self._off.has_ended:
            self._off, self._asked_off_s = OffThread(self._lasers), time.monotonic()

    @property
    def off_problem(self) -> str:
        """Why the lasers may be on although they were switched off; "" if they are off or weren't asked."""
        if self._off is None:
            return ""
        if self._off.problem:
            return f"{self._off.problem}; {_MAY_BE_ON}"
        is_late = not self._off.has_ended and time.monotonic() - self._asked_off_s > OFF_TIMEOUT_S
        return f"the lasers don't answer; {_MAY_BE_ON}" if is_late else ""

    @property
    def is_switching_off(self) -> bool:
        """Whether the lasers were switched off and haven't confirmed it."""
        return self._off is not None and not self._off.has_ended

    def abandon(self) -> None:
        """Switches the lasers off and lets nothing more happen; the devices are still to be closed."""
        self.lasers_off()
        self._worker.abandon()

    def close(self) -> str:
        """Switches the lasers off first, then closes all devices; returns why the lasers may be on, or "".

        Takes less than nine seconds, also where a device hangs.
        """
        self.abandon()
        if self._off is not None:
            self._off.join(OFF_TIMEOUT_S)
        self._worker.join(_CALL_TIMEOUT_S)
        if self._devices is None or self._lasers is None:
            return ""
        problem = "" if self._off is None or self._off.join(0.0) else self._off.problem or "the lasers don't answer"
        closing = Thread(target=_close_quietly, args=(self._devices,), name="holoview: closing devices", daemon=True)
        closing.start()
        closing.join(_CLOSE_TIMEOUT_S)
        return f"{problem}; {_MAY_BE_ON}" if problem else ""

    def _open(self) -> None:
        if self._before is not None:
            with self.watch.waiting_for("the devices to close"):
                self._before.close()
            self._before = None
        with self.watch.waiting_for("the devices to open"):
            devices = self._open_devices(self.rig)
        lasers = LaserInterlock(devices.lasers)
        if self._worker.is_abandoned:  # meanwhile
            devices.close()
            return
        self._devices, self._lasers = watch_devices(devices, lasers, self.watch), lasers
        self._devices.lasers.switch_off()

    def _on_begin(self, number: int) -> None:
        if self._lasers is not None:
            self._lasers.begin(number)

    def _opened(self) -> Devices:
        assert self._devices is not None, "opened by the call before"
        return self._devices


def _close_quietly(devices: Devices) -> None:
    """Closes devices; one that fails leaves nothing to be done."""
    with suppress(Exception):  # whatever a device's library raises; the lasers were seen to before
        devices.close()
