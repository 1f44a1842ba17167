"""Devices that a window uses: no call holds it up, lasers go off at any time, and closing takes a bounded time.

RigConnection     opens the devices, has a thread use them, and closes them
LaserInterlock    lasers that another thread switches off, and that no earlier request switches on again
DeviceWatch       which device the thread is waiting for
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from threading import Lock, Thread
from typing import Any

from holoview.bench.rig.description import RigDescription
from holoview.bench.rig.devices import DeviceError, Devices, LasersDevice, Wrapped
from holoview.util.mailbox import Deliver, Mailbox

OFF_TIMEOUT_S = 3.0
"""How long lasers may take to confirm that they are off."""
_CALL_TIMEOUT_S, _CLOSE_TIMEOUT_S = 2.0, 3.0  # for the call in flight to end; for the devices to close
_PATIENCE_S = 1.0  # with a call of the lasers that another thread makes: a serial line takes one at a time
_MAY_BE_ON = "the lasers may be on: switch them off by hand"

OpenDevices = Callable[[RigDescription], Devices]


class RigConnection:
    """The devices of a rig, from opening to closing.

    deliver: has the owner make a call. open_devices: opens the devices. before: a connection to the same rig that is
    closed before this one is opened. watch: notes the device that the thread is waiting for.
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
        self._worker = Mailbox("devices", deliver, self._on_begin)

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
        """Has the thread make a call with the open devices; see `Mailbox.submit`."""
        self._worker.submit(lambda: work(self._opened()), on_result, on_error, key=key, delay_s=delay_s)

    def lasers_off(self) -> None:
        """Switches all lasers off, whatever the devices' thread does; no earlier request switches them on again."""
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
        """Switches the lasers off and drops all further calls; the devices are still to be closed."""
        self.lasers_off()
        self._worker.close()

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
        if self._worker.is_closed:  # meanwhile
            devices.close()
            return
        words = self.rig.slm_words if len(devices.modulators) > 1 else ("the modulator",)
        self._devices, self._lasers = watch_devices(devices, lasers, self.watch, words), lasers
        self._devices.lasers.switch_off()

    def _on_begin(self, number: int) -> None:
        if self._lasers is not None:
            self._lasers.begin(number)

    def _opened(self) -> Devices:
        assert self._devices is not None, "opened by the call before"
        return self._devices


def _close_quietly(devices: Devices) -> None:
    """Closes devices and ignores failures."""
    with suppress(Exception):  # whatever a device's library raises; the lasers were seen to before
        devices.close()


class LaserInterlock(Wrapped[LasersDevice]):
    """Lasers of a rig. Calls have rising numbers: calls up to the last `forbid` can't switch a laser on any more.

    A thread that is inside a call of another device may go on with a plan long after the lasers were switched off by
    hand; then, too, they stay off.
    """

    def __init__(self, device: LasersDevice) -> None:
        super().__init__(device)
        self._present, self._forbidden, self._lock = 0, -1, Lock()
        self._in_use = Lock()

    def begin(self, number: int) -> None:
        """The call of this number begins, on the thread of the devices."""
        self._present = number

    def forbid(self, number: int) -> None:
        """Calls up to this number can't switch a laser on any more. May be called on any thread."""
        with self._lock:
            self._forbidden = max(self._forbidden, number)

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """As of the device. Raises DeviceError where it is forbidden; then all lasers are off."""
        self._require_allowed()
        with self._in_use:
            self.device.switch_on(wavelength_m, power)
            if self._is_forbidden:  # meanwhile
                self.device.switch_off()
        self._require_allowed()

    def switch_off(self) -> None:
        """Switches all lasers off, also while a call of another thread that switches one on doesn't return."""
        is_free = self._in_use.acquire(timeout=_PATIENCE_S)
        try:
            self.device.switch_off()
        finally:
            if is_free:
                self._in_use.release()

    @property
    def _is_forbidden(self) -> bool:
        return self._present <= self._forbidden

    def _require_allowed(self) -> None:
        if self._is_forbidden:
            raise LasersForbidden("lasers", "were switched off by hand", remedy="switch them on again if it is safe")


class LasersForbidden(DeviceError):
    """A laser was to be switched on by a request from before all lasers were switched off."""


class OffThread:
    """Switches lasers off on a thread of its own, which a device that hangs doesn't stop.

    problem: why they may be on, or "". It is known once `has_ended`.
    """

    def __init__(self, lasers: LaserInterlock) -> None:
        self._lasers, self.problem = lasers, ""
        self._thread = Thread(target=self._run, name="holoview: lasers off", daemon=True)
        self._thread.start()

    @property
    def has_ended(self) -> bool:
        """Whether the lasers answered."""
        return not self._thread.is_alive()

    def join(self, timeout_s: float) -> bool:
        """Waits; returns whether the lasers have confirmed that they are off."""
        self._thread.join(timeout_s)
        return self.has_ended and not self.problem

    def _run(self) -> None:
        try:
            self._lasers.switch_off()
        except Exception as error:  # of any device's library
            self.problem = str(error) or type(error).__name__


class DeviceWatch:
    """Notes which device the thread of the devices is waiting for."""

    def __init__(self) -> None:
        self._waiting: tuple[str, float] | None = None

    @contextmanager
    def waiting_for(self, name: str) -> Iterator[None]:
        """A context within which the thread waits for something, such as "the camera"."""
        self._waiting = (name, time.monotonic())
        try:
            yield
        finally:
            self._waiting = None

    @property
    def waiting(self) -> tuple[str, float] | None:
        """The device that is being waited for, and for how many seconds; None while there is none."""
        found = self._waiting
        return None if found is None else (found[0], time.monotonic() - found[1])


def watch_devices(devices: Devices, lasers: LasersDevice, watch: DeviceWatch, words: Sequence[str]) -> Devices:
    """The same devices, with `lasers` as lasers, each call of which is seen by `watch`. words: for the modulators."""
    return Devices(
        tuple(_Watched(own, name, watch) for own, name in zip(devices.modulators, words, strict=True)),
        _Watched(devices.camera, "the camera", watch),
        _Watched(lasers, "the lasers", watch),
        _Watched(devices.stage, "the stage", watch),
        _Watched(devices.clock, "the patterns to settle", watch),
    )


class _Watched(Wrapped[Any]):
    """A device of any kind, also a clock, each call of whose methods is seen by `watch` as of `name`."""

    def __init__(self, device: object, name: str, watch: DeviceWatch) -> None:
        super().__init__(device)
        self._name, self._watch = name, watch

    def __getattr__(self, name: str) -> Any:
        found = super().__getattr__(name)
        if not callable(found):
            return found

        def call(*arguments: Any, **keywords: Any) -> Any:
            with self._watch.waiting_for(self._name):
                return found(*arguments, **keywords)

        return call
