"""The devices of a rig in an editing session: what they are set to, and live pictures with their prediction.

All methods belong to the owner of the session and return at once. Calls of devices are made by a thread of their own;
only the lasers are switched off by another one, so that a device that hangs holds up nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from holoview.document.editing_session import EditingSession
from holoview.document.jobs import Cancelled
from holoview.experiment.live.bench_state import BenchState
from holoview.experiment.live.laser_interlock import LasersForbidden
from holoview.experiment.live.live_view import LiveView
from holoview.experiment.live.rig_connection import OpenDevices, RigConnection
from holoview.experiment.live.sent_pattern import SentPattern
from holoview.rig.description import RigDescription, read_rig
from holoview.rig.devices import Counts, DeviceError, Devices
from holoview.rig.measure.exposure_search import take_exposed
from holoview.rig.open_rig import open_rig
from holoview.util.errors import UserError

LIVE_PERIOD_S = 0.1
"""The least time between live pictures."""
_FIRST_EXPOSURE_S = 1e-2
_SHOWN_AFTER_S = 0.5  # waiting for a device for so long is told
_LIVE = "live"


class RigDevices:
    """A rig of an editing session, or none.

    open_devices: opens the devices of a rig. rig: its description; None while there is none. status: "closed",
    "opening", "open", or "failed" after an error of a device, until it is opened again. problem: that error.
    state: what the devices are set to. is_live: whether pictures are taken all the time. view: the newest picture with
    its prediction.
    """

    def __init__(self, session: EditingSession, open_devices: OpenDevices = open_rig) -> None:
        self._session, self._open_devices = session, open_devices
        self.rig: RigDescription | None = None
        self.status, self.problem = "closed", ""
        self.state, self.is_live = BenchState(), False
        self.view = LiveView(session)
        self._connection: RigConnection | None = None
        self._pending = set[str]()
        self._off_count = 0
        self._shown: BenchState | None = None

    # --- opening and closing ----------------------------------------------------------------------------------------

    @property
    def is_open(self) -> bool:
        """Whether the devices can be used."""
        return self.status == "open"

    @property
    def is_busy(self) -> bool:
        """Whether something that was asked for isn't done, or the newest picture is of other settings."""
        is_stale = self.is_live and (self._shown is not self.state or self.view.prediction_is_due)
        return self.status == "opening" or bool(self._pending) or is_stale

    @property
    def waiting(self) -> str:
        """What has been waited for, as in "waiting for the camera (3 s)"; "" while nothing takes long."""
        found = None if self._connection is None else self._connection.watch.waiting
        return "" if found is None or found[1] < _SHOWN_AFTER_S else f"waiting for {found[0]} ({found[1]:.0f} s)"

    def open(self, path: str | Path) -> None:
        """Reads rig.toml and opens its devices in the background. Raises UserError for a wrong description."""
        rig = read_rig(path)
        self.close_rig()
        self.rig = rig
        self.reconnect()

    def reconnect(self) -> None:
        """Closes what is open of the rig and opens it again, in the background."""
        if self.rig is None:
            return
        before = self._connection
        if before is not None:
            self._stop()
            before.abandon()
        self.status, self.problem, self.state = "opening", "", BenchState()
        self._pending.clear()
        self._connection = RigConnection(self.rig, self._open_devices, self._session.call_on_owner, before)
        self._connection.open(self._on_open, self._on_error)

    def close_rig(self) -> None:
        """Closes the rig in the background, with the lasers off first."""
        if self._connection is not None:
            self._stop()
            connection, self._connection = self._connection, None
            connection.abandon()
            self._session.jobs.start("Close the rig", lambda _: connection.close(), self._report_problem)
        self.rig, self.status, self.problem, self.state = None, "closed", "", BenchState()
        self.view.clear()

    def close(self) -> str:
        """Switches the lasers off and closes the devices, before the program ends; returns why lasers may be on, or "".

        Takes less than nine seconds, also where a device hangs.
        """
        self._stop()
        self.view.close()
        connection, self._connection, self.status = self._connection, None, "closed"
        return "" if connection is None else connection.close()

    # --- lasers -----------------------------------------------------------------------------------------------------

    def lasers_off(self) -> None:
        """Switches all lasers off at once, whatever the devices do."""
        if self._connection is not None:
            self._off_count += 1
            self._pending.clear()
            self._connection.lasers_off()
            self.state = replace(self.state, wavelength_m=None)
            self._go_on_live()

    @property
    def off_problem(self) -> str:
        """Why lasers may be on although they were switched off, or ""."""
        return "" if self._connection is None else self._connection.off_problem

    @property
    def is_switching_off(self) -> bool:
        """Whether lasers were switched off and haven't confirmed it."""
        return self._connection is not None and self._connection.is_switching_off

    def switch_on(self, wavelength_m: float, power: float) -> None:
        """Switches a laser on, and the others off. Raises UserError for a power that isn't allowed."""
        rig = self._require_open()
        rig.limits.require_power(power)
        self._submit(
            "lasers",
            lambda devices: devices.lasers.switch_on(wavelength_m, power),
            partial(self._on_laser, self._off_count, wavelength_m, power),
        )

    # --- camera, stage, modulators ----------------------------------------------------------------------------------

    def set_exposure(self, exposure_s: float) -> None:
        """Sets the exposure time. Raises UserError for one that isn't allowed."""
        self._require_open().limits.require_exposure(exposure_s)
        self._submit(
            "exposure",
            lambda devices: devices.camera.set_exposure(exposure_s),
            lambda taken: self._set(exposure_s=taken),
        )

    def search_exposure(self) -> None:
        """Searches an exposure time that uses the camera's range without saturation."""
        facts, start_s = self._require_open().bench.camera, self.state.exposure_s or _FIRST_EXPOSURE_S
        self._submit("exposure", lambda devices: take_exposed(devices.camera, facts, start_s), self._on_exposed)

    def move_to(self, distance_m: float) -> None:
        """Moves the stage. Raises UserError for a distance that isn't allowed."""
        self._require_open().limits.require_distance(distance_m)
        self._submit(
            "stage", lambda devices: devices.stage.move_to(distance_m), lambda place: self._set(distance_m=place)
        )

    def send(self, pattern: SentPattern) -> None:
        """Sends a pattern to the modulators, and waits until it has settled."""
        self._require_open()
        self._submit("pattern", partial(_show, pattern), lambda _: self._set(pattern=pattern))

    def set_live(self, is_live: bool) -> None:
        """Takes pictures all the time, or ends it."""
        self.is_live = is_live and self.is_open
        self._go_on_live()

    # --- results of the devices' thread -----------------------------------------------------------------------------

    def _submit(self, key: str, work: Callable[[Devices], Any], on_result: Callable[[Any], None]) -> None:
        """Has a call of devices made in its turn; one of the same key that hasn't begun gives way to it."""
        assert self._connection is not None
        is_live = key == _LIVE
        if not is_live:
            self._pending.add(key)

        def end(then: Callable[[Any], None], found: Any) -> None:
            self._pending.discard(key)
            then(found)

        ends = partial(end, on_result), partial(end, self._on_error)
        self._connection.submit(work, *ends, key=key, delay_s=LIVE_PERIOD_S if is_live else 0.0)

    def _on_open(self) -> None:
        self.status = "open"
        assert self.rig is not None
        low, high = self.rig.limits.exposures_s
        self.set_exposure(min(max(_FIRST_EXPOSURE_S, low), high))
        self.set_live(True)

    def _on_error(self, error: BaseException) -> None:
        """An error of a device ends all, with the lasers off; other errors are told."""
        if isinstance(error, Cancelled | LasersForbidden):
            return
        if isinstance(error, UserError) and not isinstance(error, DeviceError):
            if self.status == "opening":
                self.status, self.problem = "failed", str(error)
            self._session.messages.post_error(error)
            return
        self.status, self.problem, self.is_live = "failed", str(error) or type(error).__name__, False
        self.lasers_off()
        self._session.messages.post_error(error)

    def _on_exposed(self, found: tuple[Counts, float]) -> None:
        counts, exposure_s = found
        self._set(exposure_s=exposure_s)
        self._show(self.state, counts)

    def _set(self, **fields: Any) -> None:
        self.state = replace(self.state, **fields)

    def _on_laser(self, offs: int, wavelength_m: float, power: float, _: object) -> None:
        if offs == self._off_count:  # else all were switched off since
            self._set(wavelength_m=wavelength_m, power=power)

    def _show(self, state: BenchState, counts: Counts) -> None:
        if self.rig is not None:
            self._shown = self.state
            self.view.show(self.rig, counts, state.capture(self.rig, counts))

    def _go_on_live(self) -> None:
        """Has the next live picture taken, unless one is waiting."""
        if self.is_live and self.is_open:
            self._submit(_LIVE, lambda devices: devices.camera.take(), self._on_live)

    def _on_live(self, counts: Counts) -> None:
        self._show(self.state, counts)
        self._go_on_live()

    def _report_problem(self, problem: str) -> None:
        if problem:
            self._session.messages.post(problem, "error")

    def _require_open(self) -> RigDescription:
        if self.rig is None or not self.is_open:
            remedy = "open a rig" if self.rig is None else "connect again"
            raise UserError("rig", f"is {self.status}", expected="an open rig", remedy=remedy)
        return self.rig

    def _stop(self) -> None:
        """Ends what goes on by itself."""
        self.is_live = False


def _show(pattern: SentPattern, devices: Devices) -> None:
    for modulator, own in zip(devices.modulators, pattern.levels, strict=True):
        modulator.show(own)
    devices.clock.wait(max(modulator.settle_s for modulator in devices.modulators))
