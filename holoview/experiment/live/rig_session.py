"""A rig in an editing session: its devices, the captures that are taken with them, plans, and a diagnosis."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from holoview.captures.dataset import Captures
from holoview.document.editing_session import EditingSession
from holoview.document.jobs import BackgroundJob
from holoview.experiment.live.bench_state import state_of
from holoview.experiment.live.live_comparison import PictureModel
from holoview.experiment.live.live_diagnosis import LiveDiagnosis
from holoview.experiment.live.plan_run import PlannedRun, PlanRun
from holoview.experiment.live.rig_connection import OpenDevices
from holoview.experiment.live.rig_devices import RigDevices
from holoview.experiment.live.taken_captures import TakenCaptures
from holoview.rig.devices import Devices
from holoview.rig.measure.capture_plan import CaptureRequest
from holoview.rig.measure.session import MeasurementSession
from holoview.rig.open_rig import open_rig
from holoview.util.errors import UserError

_PLAN = "Plan"
MODELS = ("rig.toml", "the viewer's bench", "the diagnosis")
"""What pictures can be predicted with: the nominal bench, the document's with its effects, the nominal one as found."""


class RigSession(RigDevices):
    """A rig of an editing session, or none. captures: those taken. diagnosis: of them."""

    def __init__(self, session: EditingSession, open_devices: OpenDevices = open_rig) -> None:
        super().__init__(session, open_devices)
        self.diagnosis, self.captures = LiveDiagnosis(session), TakenCaptures(None)
        self._plan_job: BackgroundJob | None = None
        self._count = 0

    def open(self, path: str | Path) -> None:
        """Reads rig.toml and opens its devices in the background. Raises UserError for a wrong description."""
        super().open(path)
        assert self.rig is not None
        self.diagnosis.placement = self.rig.placement
        started = time.strftime("%Y%m%d-%H%M%S")
        self.captures = TakenCaptures(self.rig.path.with_name(f"{self.rig.path.stem}-{started}.captures"))

    def close_rig(self) -> None:
        """Closes the rig in the background, with the lasers off first; its captures are forgotten."""
        super().close_rig()
        self.captures.clear()
        self.diagnosis.clear()

    def lasers_off(self) -> None:
        """Switches all lasers off at once, whatever the devices do; ends a plan."""
        self.cancel_plan()
        super().lasers_off()

    def take_capture(self, *, searches_exposure: bool) -> None:
        """Takes a capture as the devices are set, and writes it. Raises UserError while something isn't set."""
        rig, state, store = self._require_open(), self.state, self.captures
        state.require_all()
        assert state.pattern is not None and state.wavelength_m is not None and state.distance_m is not None
        exposure_s = None if searches_exposure else state.exposure_s
        request = CaptureRequest(state.wavelength_m, state.distance_m, state.power, 0.0, (0, 0), exposure_s)
        pattern = state.pattern

        def take(devices: Devices) -> Captures:
            capture = MeasurementSession(rig, devices, self._tell).take(request, pattern.levels)
            store.write(capture)
            return capture

        self._count += 1
        self._submit(f"capture {self._count}", take, partial(self._add, pattern.label, self._off_count))

    def save_captures(self, path: Path) -> None:
        """Writes all captures as one file. Raises UserError."""
        self.captures.save(path)
        self._session.messages.post(f"{path.name}: {len(self.captures)} captures")

    @property
    def plan_job(self) -> BackgroundJob | None:
        """The plan that is run; None while there is none."""
        return self._plan_job if self._plan_job is not None and self._plan_job.is_active else None

    def run_plan(self, plan: Path | None, output: Path | None = None) -> None:
        """Takes the captures of a plan into a capture file beside the rig's, or `output`. plan: None for the default.

        Raises UserError for a plan that the rig can't or mustn't do, and while another one is run.
        """
        rig = self._require_open()
        if self.plan_job is not None:
            raise UserError("plan", "another one is run", remedy="cancel it first")
        name = f"{rig.path.stem}-{time.strftime('%Y%m%d-%H%M%S')}.h5"
        planned = PlannedRun.prepare(rig, plan, output or rig.path.with_name(name))
        offs = self._off_count
        run = PlanRun(
            rig, planned, lambda c: self._session.call_on_owner(lambda: self._add("of the plan", offs, c)), self._tell
        )
        self._plan_job = self._session.jobs.start(
            _PLAN, run.wait, lambda _: self._on_plan_done(planned), on_end=self._on_plan_end
        )
        self._submit(_PLAN, run.take, lambda _: None)

    def cancel_plan(self) -> None:
        """Ends the plan after the capture in flight; its captures stay, and the same plan goes on with them."""
        if self._plan_job is not None:
            self._plan_job.cancel()

    def diagnose(self) -> None:
        """Diagnoses all captures now. Raises UserError if there are none."""
        if not len(self.captures):
            raise UserError("diagnosis", "there are no captures", remedy="take some, or run a plan")
        self.diagnosis.start(self.captures.all)

    # --- prediction -------------------------------------------------------------------------------------------------

    def choose_model(self, name: str) -> None:
        """Predicts pictures with a model of MODELS; call it again when the document or the diagnosis may have changed.

        Before the first diagnosis, that is the nominal bench.
        """
        found = self.diagnosis.diagnosis
        models = {
            MODELS[0]: PictureModel(name),
            MODELS[1]: PictureModel(name, system=self._session.system),
            MODELS[2]: PictureModel(name, values=None if found is None else found.all_values),
        }
        new, old = models[name], self.view.model
        if new.name != old.name or new.system is not old.system or new.values != old.values:
            self.view.set_model(new)

    # --- results ----------------------------------------------------------------------------------------------------

    def _add(self, label: str, offs: int, capture: Captures) -> None:
        """A capture that is on the disk: shown, and offered to the diagnosis. offs: as when it was asked for."""
        taken = state_of(capture, label)
        self.state = taken if offs == self._off_count else replace(taken, wavelength_m=None)
        self._show(taken, capture.images[0])
        self.captures.add(capture)
        self.diagnosis.offer(self.captures.all)

    def _tell(self, text: str) -> None:
        """Posts a message. May be called on any thread."""
        self._session.call_on_owner(partial(self._session.messages.post, text))

    def _on_plan_end(self) -> None:
        self._set(wavelength_m=None)
        self._go_on_live()
        self.diagnosis.offer(self.captures.all, is_all=True)

    def _on_plan_done(self, planned: PlannedRun) -> None:
        self._session.messages.post(f"{planned.output}: {len(planned.plan.requests)} captures")

    def _stop(self) -> None:
        self.cancel_plan()
        self.diagnosis.cancel()
        super()._stop()
