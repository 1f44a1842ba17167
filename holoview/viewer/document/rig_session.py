"""A rig beside the document that a viewer edits: its devices, live pictures, captures, plans, and a diagnosis.

BenchState      the patterns that are sent to the modulators, the settings of the devices, captures with these settings
RigSession      controlled by a front end; all of its methods belong to the owner of the session and return at once
TakenCaptures   the captures that were taken, each on the disk
PlanRun         a plan of captures, as a job

Calls of devices are made by a thread of their own; only the lasers are switched off by another thread, so that a device
that hangs holds up nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.bench.captures.dataset import Captures
from holoview.bench.rig.camera_pictures import take_exposed
from holoview.bench.rig.capture_folder import CaptureFolder, CaptureStore
from holoview.bench.rig.capture_plan import CapturePlan, CaptureRequest, default_plan, read_plan
from holoview.bench.rig.description import RigDescription, read_rig
from holoview.bench.rig.devices import Counts, DeviceError, Devices, Levels
from holoview.bench.rig.live_devices import LasersForbidden, RigConnection
from holoview.bench.rig.measurement import Measurement
from holoview.bench.rig.open_rig import open_rig
from holoview.holograms.hologram import load_hologram
from holoview.util.errors import UserError
from holoview.util.files import read_text
from holoview.util.text import printable
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.jobs import BackgroundJob, Cancelled, JobControl
from holoview.viewer.document.live_view import LiveDiagnosis, LiveView, PictureModel

Patterns = NDArray[Any] | Mapping[str, NDArray[Any]]
_REMEDY = "take the bench of the rig (menu Rig), then find patterns for it"


@dataclass(frozen=True, eq=False)
class BenchState:
    """Settings of the devices as they last confirmed them; None where nothing was set yet.

    wavelength_m: of the laser that is on; None while all are off. power: relative, of that laser.
    """

    pattern: SentPattern | None = None
    wavelength_m: float | None = None
    power: float = 0.0
    distance_m: float | None = None
    exposure_s: float | None = None

    @property
    def missing(self) -> str:
        """The next step that is needed before a picture can be predicted, or ""."""
        if self.pattern is None:
            return "send a pattern"
        if self.distance_m is None:
            return "move the stage, so that its place is known"
        if self.exposure_s is None:
            return "set an exposure"
        return "switch a laser on" if self.wavelength_m is None else ""

    def require_all(self) -> None:
        """Raises UserError while a setting is missing."""
        if self.missing:
            raise UserError("capture", "can't be taken yet", remedy=self.missing)

    def capture(self, rig: RigDescription, picture: Counts) -> Captures | None:
        """A picture (y, x) with these settings as a capture; None while a setting is missing."""
        if self.pattern is None or self.distance_m is None or self.exposure_s is None or self.wavelength_m is None:
            return None
        return rig.capture(
            self.pattern.levels,
            picture,
            wavelength_m=self.wavelength_m,
            distance_m=self.distance_m,
            power=self.power,
            exposure_s=self.exposure_s,
            lasers_m=rig.wavelengths_m,
        )


def state_of(capture: Captures, label: str) -> BenchState:
    """The settings with which a capture was taken. label: of its pattern."""
    return BenchState(
        pattern=SentPattern(capture.levels[0], label),
        wavelength_m=float(capture.wavelength_m[0]),
        power=float(capture.power[0]),
        distance_m=float(capture.distance_m[0]),
        exposure_s=float(capture.exposure_s[0]),
    )


@dataclass(frozen=True, eq=False)
class SentPattern:
    """Grey levels (modulator, y, x), and where they come from, in words."""

    levels: Levels
    label: str


def drive_pattern(rig: RigDescription, drive: Patterns, label: str, frame: int = 0) -> SentPattern:
    """A frame of a drive in 0…1, rounded to the nearest levels of the rig's modulators.

    drive: (frame, modulator, y, x), of a chain (frame, y, x) by the names of its elements, where one frame may be all.
    Raises UserError where it has another shape.
    """
    if not isinstance(drive, Mapping):
        drive = {f"slm{number + 1}": drive[:, number] for number in range(drive.shape[1])}
    shown = {name: own[min(frame, len(own) - 1)] for name, own in drive.items()}
    found, wanted = {name: own.shape for name, own in shown.items()}, dict(_named_shapes(rig))
    if found != wanted or any(map(np.iscomplexobj, shown.values())):
        words = [", ".join(f"{n} {y} × {x}" for n, (y, x) in shapes.items()) for shapes in (found, wanted)]
        expected = f"{words[1]} as the rig has"
        raise UserError(label, f"patterns of {words[0]}", expected=expected, remedy=_REMEDY)
    levels = [
        slm.levels_of(np.clip(np.asarray(shown[name], np.float64), 0.0, 1.0)).astype(rig.levels_type)
        for name, slm in zip(rig.modulator_names, rig.bench.slms, strict=True)
    ]
    return SentPattern(rig.together(levels), label)


def _named_shapes(rig: RigDescription) -> zip[tuple[str, tuple[int, int]]]:
    return zip(rig.modulator_names, rig.slm_shapes, strict=True)


def random_pattern(rig: RigDescription, sigma_px: float, seed: int) -> SentPattern:
    """Random levels, blurred by a Gaussian of `sigma_px` modulator pixels."""
    levels = rig.random_levels(np.random.default_rng(seed), sigma_px)
    return SentPattern(levels.astype(rig.levels_type), f"random, smooth over {sigma_px:g} px")


def flat_pattern(rig: RigDescription, share: float) -> SentPattern:
    """The same level everywhere, `share` of the highest one."""
    drive = {name: np.full((1, *shape), share) for name, shape in _named_shapes(rig)}
    return drive_pattern(rig, drive, f"flat, {share:.2f} of the stroke")


def file_pattern(rig: RigDescription, path: Path) -> SentPattern:
    """The first frame of a hologram file. Raises UserError."""
    return drive_pattern(rig, load_hologram(path).drive, printable(path.name))


# --- the rig ---


LIVE_PERIOD_S = 0.1
"""The least time between live pictures."""
_FIRST_EXPOSURE_S = 1e-2
_SHOWN_AFTER_S = 0.5  # waiting for a device for so long is told
_POLL_S = 0.1  # between looks whether a plan was cancelled
_LIVE, _PLAN = "live", "Plan"
MODELS = ("rig.toml", "the viewer's bench", "the diagnosis")
"""Models that predict pictures: the nominal bench, the document's with its effects, the nominal one as diagnosed."""


class RigSession:
    """A rig of an editing session, or none.

    rig: its description; None while there is none. status: "closed",
    "opening", "open", or "failed" after an error of a device, until it is opened again. problem: the error.
    state: the settings of the devices. is_live: whether pictures are taken all the time. view: the newest picture with
    its prediction. captures: taken so far. diagnosis: of the captures.
    """

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self.rig: RigDescription | None = None
        self.status, self.problem = "closed", ""
        self.state, self.is_live = BenchState(), False
        self.view, self.diagnosis = LiveView(session), LiveDiagnosis(session)
        self.captures = TakenCaptures(None)
        self._connection: RigConnection | None = None
        self._pending = set[str]()
        self._off_count, self._capture_count = 0, 0
        self._shown: BenchState | None = None
        self._plan_job: BackgroundJob | None = None

    # --- opening and closing ------------------------------------------------------------------------------------------

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
        """The device that has been waited for, as in "waiting for the camera (3 s)"; "" while nothing takes long."""
        found = None if self._connection is None else self._connection.watch.waiting
        return "" if found is None or found[1] < _SHOWN_AFTER_S else f"waiting for {found[0]} ({found[1]:.0f} s)"

    def open(self, path: str | Path) -> None:
        """Reads rig.toml and opens its devices in the background. Raises UserError for a wrong description."""
        rig = read_rig(path)
        self.close_rig()
        self.rig, self.diagnosis.registration = rig, rig.registration
        self.captures = TakenCaptures(rig.path.with_name(f"{rig.path.stem}-{_now()}.captures"))
        self.reconnect()

    def reconnect(self) -> None:
        """Closes the open devices of the rig and opens it again, in the background."""
        if self.rig is None:
            return
        before = self._connection
        if before is not None:
            self._stop()
            before.abandon()
        self.status, self.problem, self.state = "opening", "", BenchState()
        self._pending.clear()
        self._connection = RigConnection(self.rig, open_rig, self._session.call_on_owner, before)
        self._connection.open(self._on_open, self._on_error)

    def close_rig(self) -> None:
        """Closes the rig in the background, with the lasers off first; its captures are forgotten."""
        if self._connection is not None:
            self._stop()
            connection, self._connection = self._connection, None
            connection.abandon()
            self._session.jobs.start("Close the rig", lambda _: connection.close(), self._report_problem)
        self.rig, self.status, self.problem, self.state = None, "closed", "", BenchState()
        self.view.clear()
        self.captures.clear()
        self.diagnosis.clear()

    def close(self) -> str:
        """Switches the lasers off and closes the devices, before the program ends; returns why lasers may be on, or "".

        Takes less than nine seconds, also where a device hangs.
        """
        self._stop()
        self.view.close()
        connection, self._connection, self.status = self._connection, None, "closed"
        return "" if connection is None else connection.close()

    # --- lasers, camera, stage, modulators ----------------------------------------------------------------------------

    def lasers_off(self) -> None:
        """Switches all lasers off at once, whatever the devices do; ends a plan."""
        self.cancel_plan()
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

    def set_exposure(self, exposure_s: float) -> None:
        """Sets the exposure time. Raises UserError for a value that isn't allowed."""
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
        self._submit("pattern", partial(_show_settled, pattern), lambda _: self._set(pattern=pattern))

    def set_live(self, is_live: bool) -> None:
        """Takes pictures all the time, or ends it."""
        self.is_live = is_live and self.is_open
        self._go_on_live()

    # --- captures, plans, diagnosis -----------------------------------------------------------------------------------

    def take_capture(self, *, searches_exposure: bool) -> None:
        """Takes a capture as the devices are set, and writes it. Raises UserError while something isn't set."""
        rig, state, store = self._require_open(), self.state, self.captures
        state.require_all()
        assert state.pattern is not None and state.wavelength_m is not None and state.distance_m is not None
        exposure_s = None if searches_exposure else state.exposure_s
        request = CaptureRequest(state.wavelength_m, state.distance_m, state.power, 0.0, (0, 0), exposure_s)
        pattern = state.pattern

        def take(devices: Devices) -> Captures:
            capture = Measurement(rig, devices, self._tell).take(request, pattern.levels)
            store.write(capture)
            return capture

        self._capture_count += 1
        self._submit(f"capture {self._capture_count}", take, partial(self._add, pattern.label, self._off_count))

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

        Raises UserError for a plan that the rig can't or mustn't do, and while another plan is run.
        """
        rig = self._require_open()
        if self.plan_job is not None:
            raise UserError("plan", "another one is run", remedy="cancel it first")
        output = output or rig.path.with_name(f"{rig.path.stem}-{_now()}.h5")
        captures = default_plan(rig) if plan is None else read_plan(plan, rig)
        offs = self._off_count

        def on_capture(capture: Captures) -> None:
            self._session.call_on_owner(partial(self._add, "of the plan", offs, capture))

        run = PlanRun(rig, captures, output, on_capture, self._tell)
        done = f"{output}: {len(captures.requests)} captures"
        self._plan_job = self._session.jobs.start(
            _PLAN, run.wait, lambda _: self._session.messages.post(done), on_end=self._on_plan_end
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

    # --- results of the devices' thread -------------------------------------------------------------------------------

    def _submit(self, key: str, work: Callable[[Devices], Any], on_result: Callable[[Any], None]) -> None:
        """Has a call of devices made in its turn; a call of the same key that hasn't begun gives way to it."""
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
        """Has the next live picture taken, unless a picture is waited for."""
        if self.is_live and self.is_open:
            self._submit(_LIVE, lambda devices: devices.camera.take(), self._on_live)

    def _on_live(self, counts: Counts) -> None:
        self._show(self.state, counts)
        self._go_on_live()

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

    def _report_problem(self, problem: str) -> None:
        if problem:
            self._session.messages.post(problem, "error")

    def _require_open(self) -> RigDescription:
        if self.rig is None or not self.is_open:
            remedy = "open a rig" if self.rig is None else "connect again"
            raise UserError("rig", f"is {self.status}", expected="an open rig", remedy=remedy)
        return self.rig

    def _stop(self) -> None:
        """Ends the plan, the diagnosis and live pictures."""
        self.cancel_plan()
        self.diagnosis.cancel()
        self.is_live = False


class TakenCaptures:
    """Captures of one rig in the order in which they were taken.

    folder: where single captures are written, one file each; None writes none. Captures of a plan are in its own
    folder.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._files = None if folder is None else CaptureFolder(folder)
        self._all: list[Captures] = []
        self._written = 0

    def __len__(self) -> int:
        return len(self._all)

    @property
    def all(self) -> tuple[Captures, ...]:
        """The captures, each by itself."""
        return tuple(self._all)

    def write(self, capture: Captures) -> None:
        """Writes a single capture into the folder, which is made for the first one. Raises WriteError."""
        if self._files is not None:
            self._files.begin()
            self._files.write(self._written, capture)
            self._written += 1

    def add(self, capture: Captures) -> None:
        """Adds a capture that is on the disk."""
        self._all.append(capture)

    def clear(self) -> None:
        """Forgets all; their files stay."""
        self._all = []

    def save(self, path: Path) -> None:
        """Writes all as one capture file, and removes the folder of single captures. Raises UserError."""
        if not self._all or self._files is None:
            raise UserError("captures", "there are none yet", remedy="take a capture or run a plan")
        self._files.join_into(path, self._all)


class PlanRun:
    """A run of a plan, which fills a capture file; captures of the same plan in the file aren't taken again.

    on_capture: called on the devices' thread with each capture that is on the disk. tell: there, with sentences that a
    user should read at once.
    """

    def __init__(
        self,
        rig: RigDescription,
        plan: CapturePlan,
        output: Path,
        on_capture: Callable[[Captures], None],
        tell: Callable[[str], None],
    ) -> None:
        self._rig, self._plan, self._tell = rig, plan, tell
        self._store = CaptureStore(output, plan, read_text(rig.path, "a rig"), on_capture)
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
        """On the devices' thread: takes the missing captures, with the lasers off at the end, however that comes."""
        try:
            self._store.open()
            try:
                measurement = Measurement(self._rig, devices, self._tell)
                is_complete = measurement.run(self._plan, self._store, self._report, self._is_cancelled)
            finally:
                devices.lasers.switch_off()
            if is_complete:
                self._store.finish()
            self._is_complete = is_complete
        finally:
            self._ended.set()

    def _report(self, done: int, total: int, note: str) -> None:
        if self._control is not None and not self._is_cancelled():
            self._control.report(done, total, note)

    def _is_cancelled(self) -> bool:
        return self._control is not None and self._control.is_cancelled


def _show_settled(pattern: SentPattern, devices: Devices) -> None:
    devices.show(pattern.levels)
    devices.clock.wait(devices.settle_s)


def _now() -> str:
    return time.strftime("%Y%m%d-%H%M%S")
