"""Runs a plan of captures as a job; the devices' thread takes them, and hands each over once it is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from holoview.captures.dataset import Captures
from holoview.document.jobs import Cancelled, JobControl
from holoview.rig.description import RigDescription
from holoview.rig.devices import Devices
from holoview.rig.measure.capture_plan import CapturePlan, default_plan, read_plan
from holoview.rig.measure.capture_store import CaptureStore
from holoview.rig.measure.session import MeasurementSession
from holoview.util.files import read_text

_POLL_S = 0.1  # between looks whether the job was cancelled


@dataclass(frozen=True)
class PlannedRun:
    """A plan, and the capture file that it fills. Where captures of the same plan are there, it goes on with them."""

    plan: CapturePlan
    output: Path

    @classmethod
    def prepare(cls, rig: RigDescription, plan: Path | None, output: Path) -> PlannedRun:
        """plan: a file; None for the default plan. Raises UserError for one that the rig can't or mustn't do."""
        return cls(default_plan(rig) if plan is None else read_plan(plan, rig), output)


class PlanRun:
    """A run of a plan.

    on_capture: called on the devices' thread with each capture that is on the disk. tell: there, with what the user
    should know at once.
    """

    def __init__(
        self, rig: RigDescription, run: PlannedRun, on_capture: Callable[[Captures], None], tell: Callable[[str], None]
    ) -> None:
        self._rig, self._run, self._on_capture, self._tell = rig, run, on_capture, tell
        self._control: JobControl | None = None
        self._ended, self._is_complete = Event(), False

    def wait(self, control: JobControl) -> None:
        """The work of the job: waits until `take` has ended. Raises Cancelled where it isn't complete."""
        self._control = control
        while not self._ended.wait(_POLL_S):
            control.check()
        if not self._is_complete:
            raise Cancelled

    def take(self, devices: Devices) -> None:
        """On the devices' thread: takes what is missing, with the lasers off at the end, however that comes."""
        try:
            store = _HandingStore(self._run, self._rig, self._on_capture)
            store.open()
            try:
                session = MeasurementSession(self._rig, devices, self._tell)
                is_complete = session.run(self._run.plan, store, self._report, self._is_cancelled)
            finally:
                devices.lasers.switch_off()
            if is_complete:
                store.finish()
            self._is_complete = is_complete
        finally:
            self._ended.set()

    def _report(self, done: int, total: int, note: str) -> None:
        if self._control is not None and not self._is_cancelled():
            self._control.report(done, total, note)

    def _is_cancelled(self) -> bool:
        return self._control is not None and self._control.is_cancelled


class _HandingStore(CaptureStore):
    """A store that hands each capture on once it is written."""

    def __init__(self, run: PlannedRun, rig: RigDescription, on_capture: Callable[[Captures], None]) -> None:
        super().__init__(run.output, run.plan, read_text(rig.path, "a rig"))
        self._on_capture = on_capture

    def add(self, number: int, capture: Captures) -> None:
        super().add(number, capture)
        self._on_capture(capture)
