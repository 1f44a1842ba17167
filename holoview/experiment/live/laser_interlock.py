"""Lasers that another thread can switch off at any moment, and that nothing asked for earlier switches on again."""

from __future__ import annotations

from threading import Lock, Thread

from holoview.rig.devices import DeviceError, LasersDevice

_PATIENCE_S = 1.0  # with a call of the lasers that another thread makes: a serial line takes one at a time
_REMEDY = "switch them on again if it is safe"


class LaserInterlock:
    """Lasers of a rig. Calls have rising numbers: those up to the last `forbid` can't switch a laser on any more.

    A thread that is inside a call of another device may go on with a plan long after the lasers were switched off by
    hand; then, too, they stay off.
    """

    def __init__(self, device: LasersDevice) -> None:
        self._device = device
        self._present, self._forbidden, self._lock = 0, -1, Lock()
        self._in_use = Lock()

    @property
    def wavelengths_m(self) -> tuple[float, ...]:
        """Of the lasers, ascending."""
        return self._device.wavelengths_m

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
            self._device.switch_on(wavelength_m, power)
            if self._is_forbidden:  # meanwhile
                self._device.switch_off()
        self._require_allowed()

    def switch_off(self) -> None:
        """Switches all lasers off, also while a call of another thread that switches one on doesn't return."""
        is_free = self._in_use.acquire(timeout=_PATIENCE_S)
        try:
            self._device.switch_off()
        finally:
            if is_free:
                self._in_use.release()

    def close(self) -> None:
        """Closes the device."""
        self._device.close()

    @property
    def _is_forbidden(self) -> bool:
        return self._present <= self._forbidden

    def _require_allowed(self) -> None:
        if self._is_forbidden:
            raise LasersForbidden("lasers", "were switched off by hand", remedy=_REMEDY)


class LasersForbidden(DeviceError):
    """A laser was to be switched on by something that was asked for before all were switched off."""


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
        except Exception as error:  # whatever a device's library raises
            self.problem = str(error) or type(error).__name__
