"""Optimises the patterns of a session as a job with a preview, and goes on with it after a crash of the viewer.

Two jobs measure speckle: `RetinalCurveJob` on the retina, against the diameter of the pupil, and
`SchemeComparisonJob` with both ways to make colours.

The ways to make colours, simultaneous colour and HoloChrome, are compared on the same system and target. Both get
random patterns, or the same number of optimisation iterations from the same seed; the result says which.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from threading import Event, Thread
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from holoview.holograms.metrics.retinal import RetinalCurve, default_pupils, pupils_of, retinal_curve
from holoview.holograms.optimise.checkpoint import IterationState
from holoview.holograms.optimise.eyes import OptimisedEyes, PupilPlaces, StacksAt, target_at_places
from holoview.holograms.optimise.memory import with_compact_grid
from holoview.holograms.optimise.settings import FIELD_LOSS, NEXT_ITERATIONS, Settings
from holoview.holograms.targets.live_pictures import LivePictures, open_live_pictures
from holoview.holograms.targets.picture import Picture
from holoview.holograms.view import random_drive
from holoview.light.model.drives import drive_fits
from holoview.light.model.fields import (
    Choice,
    Integer,
    Maybe,
    Nested,
    Number,
    Truth,
    described_field,
    fields_by_key,
    same_field,
    spaced_key,
    to_mapping,
    validate,
    with_field_docs,
)
from holoview.light.model.scheme import with_scheme
from holoview.light.model.system import System
from holoview.util import units
from holoview.util.errors import UserError
from holoview.util.packages import load_torch_libraries
from holoview.util.processes import garbage_kept, lock_passed_on
from holoview.util.tables import ValueType, read_record, read_table
from holoview.viewer.document.document import Document, as_readonly_drive
from holoview.viewer.document.editing_session import EditingSession, OptimisationChoices
from holoview.viewer.document.jobs import BackgroundJob, JobControl
from holoview.viewer.document.measurements import measure_region
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.planes import render_each, render_planes
from holoview.viewer.render.scene import Drive
from holoview.viewer.render.view_settings import SPECKLE_EXPOSURE_STOPS, ComparisonSide

_QUICK_PIXELS = 100_000  # of a modulator, at most, in a quick optimisation
_PREVIEW_INTERVAL_S = 0.25  # between previews, at least
_POLL_S = 0.05  # between two looks for another picture, or for the target
_LONGEST_WAIT_S = 10.0  # for a target that the window builds
_MOST_PICTURES = 200  # whose results are remembered


_COUNT = Integer(1, words="at least 1")


@with_field_docs
@dataclass(frozen=True)
class OptimisationRequest:
    """A request for an optimisation: its settings, target planes and eyes. Raises UserError for invalid values.

    Fields:
    """

    settings: Settings = described_field(Nested(Settings), "Of the optimiser.", default_factory=Settings)
    scheme: str | None = described_field(
        Maybe(Choice()), "A colour scheme that the system is changed to first.", default=None
    )
    start_patterns: str = same_field(OptimisationChoices, "start_patterns")
    eyes: OptimisedEyes = described_field(
        Nested(OptimisedEyes), "For which ones; that of the system by default.", default_factory=OptimisedEyes
    )
    preview_every: int = described_field(_COUNT, "Iterations between previews.", default=3)
    superpixel: int = described_field(
        _COUNT, "Modulator pixels a side that are driven together: superpixel² times fewer are optimised.", default=1
    )
    only_plane_m: float | None = described_field(
        Number("mm", optional=True), "A single focal plane to optimise for; all of the system if absent.", default=None
    )
    device: str = described_field(Choice(), 'Of torch, "auto" for the fastest.', default="auto")
    compares_fields: bool = described_field(
        Truth(), "The complex fields of lasers are compared, with a target that is one.", default=False
    )
    done: int = described_field(
        Integer(0), 'How many of the settings\' iterations the patterns "now" have had.', default=0
    )

    def __post_init__(self) -> None:
        validate(self, spaced_key)
        if not 0 <= self.done < self.settings.iterations:
            raise UserError("done", str(self.done), expected=f"fewer than {self.settings.iterations} iterations")
        if self.superpixel > 1 and self.start_patterns == "now":
            raise UserError("begin", '"now" with larger pixels', expected='"random" or "smooth"')


@dataclass(frozen=True)
class OptimisationProgress:
    """The progress after an iteration: its number, of how many, the loss, the present PSNR and the best so far (dB).

    light: of a chain of elements, the share of the lasers' light that is in the picture; else NaN.
    """

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float
    light: float = math.nan

    @property
    def light_text(self) -> str:
        """The light of a chain, whose elements may absorb most of it; else nothing."""
        return "" if math.isnan(self.light) else f"{self.light:.1%} of the light"


class OptimisationJob(BackgroundJob):
    """An optimisation in the background.

    `stop_and_keep` ends it early with the best result so far; `cancel` ends it and leaves the patterns unchanged.
    start_drive: patterns that "now" stands for; those of the document `start` when None.
    progress: one entry for each iteration. unit: what they count.
    """

    unit = "iteration"

    def __init__(
        self,
        session: EditingSession,
        request: OptimisationRequest,
        start: Document,
        system: System,
        start_drive: Drive | None = None,
    ) -> None:
        super().__init__("Optimise", session.call_on_owner, session.wake)
        self._start_drive = start.drive if start_drive is None else start_drive
        self.request, self.start_document, self.system = request, start, system
        self.progress: list[OptimisationProgress] = []
        self._session, self._keep = session, Event()
        self.control.total = request.settings.iterations

    @property
    def progress_range(self) -> tuple[int, int]:
        """The first number of the progress, and the last to come or, of a job without an end, so far."""
        return self.request.done, self.request.settings.iterations

    @property
    def latest(self) -> OptimisationProgress | None:
        """The progress after the last iteration; None before the first."""
        return self.progress[-1] if self.progress else None

    def stop_and_keep(self) -> None:
        """Ends the optimisation after the present iteration; the best result so far becomes an edit."""
        self._keep.set()
        self.resume()

    def run(self, control: JobControl) -> Document:
        """Optimises on the compact grid and returns the best result as a document. Called on the job's thread."""
        if not self.system.is_chain:
            Thread(target=load_optimiser, args=(self.request.device,)).start()
        request, target_spec, drive = self.request, self.start_document.target_spec, self._start_drive
        assert target_spec is not None
        control.report(request.done, request.settings.iterations, "building the target")
        system = with_superpixels(self.system, request.superpixel)
        system = system if request.only_plane_m is None else system.edit({"planes": [request.only_plane_m]})
        system = request.eyes.aimed(system)
        places = request.eyes.places_in(system)
        settings = places.in_settings(request.settings)
        seen = None if request.compares_fields else self._seen_target(target_spec, system, places)
        stack = target_spec.fields_for(system) if seen is None else seen
        start = drive if request.start_patterns == "now" and drive_fits(system, drive) else None
        control.report(request.done, request.settings.iterations, "loading the optimiser")
        from holoview.holograms.optimise.parallel import resolve_torch_device
        from holoview.holograms.optimise.solve import (
            iterate,  # slow start: it imports torch, which a viewer doesn't begin with
        )

        state, previewed_at, device = None, 0.0, resolve_torch_device(request.device)
        control.report(request.done, request.settings.iterations, "preparing the bench, first iteration")

        def tell(text: str) -> None:
            control.report(control.done, control.total, text)

        simulated = with_compact_grid(system)
        for state in iterate(simulated, stack, settings, start, done=request.done, device=device, beside=tell):
            self._report(control, state)
            is_due = state.iteration % request.preview_every == 0 and monotonic() - previewed_at >= _PREVIEW_INTERVAL_S
            if is_due or state.iteration == request.done:
                previewed_at = monotonic()
                self._session.call_on_owner(partial(self._show_preview, self._as_document(state)))
            if self._keep.is_set():
                break
        assert state is not None
        return self._as_document(state)

    def _seen_target(
        self, target_spec: TargetSpec, system: System, places: PupilPlaces
    ) -> NDArray[np.float32] | StacksAt:
        """The stacks that an eye sees from places of its pupil; from its own, those that the window has or builds."""
        is_moved, builder = places.drawn or places.fixed, self._session.target_builder
        until = monotonic() + _LONGEST_WAIT_S
        while not is_moved:
            is_awaited = builder.is_building and monotonic() < until  # first: the last build may end meanwhile
            built = builder.built_stack(target_spec, system)
            if built is not None:
                return built
            if not is_awaited:
                break
            self.control.sleep(_POLL_S)
        return target_at_places(target_spec, system, places)

    def _report(self, control: JobControl, state: IterationState) -> None:
        progress = OptimisationProgress(
            state.iteration, state.iterations, state.loss, state.psnr_db, state.best_psnr_db, state.light
        )
        self.progress.append(progress)
        control.report(state.iteration, state.iterations, f"loss {state.loss:.4g}, PSNR {state.best_psnr_db:.2f} dB")

    def _as_document(self, state: IterationState) -> Document:
        """The best result so far as a document, with the system's own grid and pixels."""
        factor, plane_m = self.request.superpixel, self.request.only_plane_m
        drive = state.best.drive
        if factor > 1:
            drive = _expand_superpixels(drive, factor, self.system.modulators[0].shape)
        pixels = f" with {factor} x {factor} pixels as one" if factor > 1 else ""
        plane = "" if plane_m is None else f" for {units.format_rounded(plane_m, 'mm')}"
        eyes = f" for {text}" if (text := self.request.eyes.description) else ""
        origin = f"optimised{pixels}{plane}{eyes}, {state.iteration} iterations"
        system = with_lasers_of(self.system, state.best.system)
        return replace(self.start_document, system=system, drive=as_readonly_drive(drive), origin=origin, path=None)

    def _show_preview(self, document: Document) -> None:
        if self.is_active:
            self._session.set_preview(self.start_document, document)

    def commit(self, result: Document) -> None:
        """Applies the result as an edit. Called on the owner's thread."""
        latest, session = self.latest, self._session
        assert latest is not None
        system = result.system
        if session.system != self.start_document.system:
            system, message = self._with_later_edits(result)
            session.messages.post(message, "warning")
        light = f", {latest.light_text}" if latest.light_text else ""
        label = f"Optimise, {latest.iteration} iterations, {latest.best_psnr_db:.1f} dB{light}"
        session.edit(label, system=system, drive=result.drive, origin=result.origin, path=None)
        session.messages.post(f"{label}: {latest.loss:.4g} loss")

    def _with_later_edits(self, result: Document) -> tuple[System, str]:
        """The bench as it was edited during the optimisation, if it can show the result; and a message for the user."""
        begun, now = self.start_document.system, self._session.system
        if self.system != begun or not drive_fits(now, result.drive):
            return result.system, "the bench is as it was when the optimisation began; undo brings your changes back"
        lasers_are_as_before = all(
            np.array_equal(getattr(now, name), getattr(begun, name)) for name in ("wavelengths_m", "amplitudes")
        )
        system = with_lasers_of(now, result.system) if lasers_are_as_before else now
        return system, "the bench was changed during the optimisation: the patterns are for the bench as it was before"


def load_optimiser(device: str = "auto") -> None:
    """Loads what the first iteration needs, beside a viewer at rest or the building of the target."""
    with suppress(Exception), garbage_kept(), lock_passed_on():  # the job says what is missing; a window goes on
        load_torch_libraries()
        from holoview.holograms.optimise.parallel import resolve_torch_device
        from holoview.holograms.optimise.solve import load_rest

        load_rest(resolve_torch_device(device))


class LiveOptimisationJob(OptimisationJob):
    """An optimisation for pictures that change, until it is ended; the picture of the moment is the session's target.

    source: of the pictures, as `open_live_pictures` takes it. count: of the pictures so far. progress: of each picture
    after its latest run of iterations.
    """

    unit, count = "picture", 0

    def __init__(self, session: EditingSession, request: OptimisationRequest, source: str) -> None:
        super().__init__(session, request, session.document, session.system)
        self._source = source
        self.control.total = 0.0

    @property
    def progress_range(self) -> tuple[int, int]:
        return (self.progress[0].iteration, self.progress[-1].iteration) if self.progress else (0, 1)

    def run(self, control: JobControl) -> Document:
        """Optimises picture after picture, and returns the latest result as a document."""
        from holoview.holograms.optimise.parallel import resolve_torch_device
        from holoview.holograms.optimise.solve import follow

        request, state = self.request, None
        start = self._start_drive if request.start_patterns == "now" else None
        device, grid = resolve_torch_device(request.device), with_compact_grid(self.system)
        control.report(0, 0, f"opening {self._source}")
        pictures = open_live_pictures(self._source)
        try:
            stacks = self._stacks(control, pictures)
            for state in follow(grid, stacks, request.settings, start=start, device=device):
                self._report(control, state)
                if self.count > 1 and state.iteration < state.iterations:
                    continue  # what is shown has had all of its iterations
                self._session.call_on_owner(partial(self._show_preview, self._as_document(state)))
        finally:
            pictures.close()
        assert state is not None
        return self._as_document(state)

    def _stacks(self, control: JobControl, pictures: LivePictures) -> Iterator[NDArray[np.float32]]:
        """A focal stack for each run of iterations, until the result is kept.

        A picture that stays gets further runs, until it has had as many iterations as the first picture.
        """
        shown: Picture | None = None
        stack, left = np.zeros(0, np.float32), 0
        while not self._keep.is_set():
            picture = pictures.next()
            if picture is shown and left <= 0:
                control.sleep(_POLL_S)
                continue
            if picture is not shown:
                shown, self.count = picture, self.count + 1
                stack, left = self._stack_for(picture), self.request.settings.iterations
            left -= self.request.settings.iterations if self.count == 1 else NEXT_ITERATIONS
            yield stack

    def _stack_for(self, picture: Picture) -> NDArray[np.float32]:
        """The focal stack of a picture, which becomes the session's target."""
        now = self._session.target_spec
        if self.count == 1 or now is None:
            now = TargetSpec(picture, self._source)
        target_spec = replace(now, source=picture)
        self._session.call_on_owner(partial(self._show_target, target_spec))
        return target_spec.stack_for(self.system)

    def _show_target(self, target_spec: TargetSpec) -> None:
        if self.is_active:
            self._session.edit("Live target", target_spec=target_spec, undoable=self.count == 1)

    def _report(self, control: JobControl, state: IterationState) -> None:
        if state.iteration == state.iterations:
            made = OptimisationProgress(self.count, self.count, state.loss, state.psnr_db, state.best_psnr_db)
            before = [progress for progress in self.progress if progress.iteration < self.count]
            self.progress = [*before[1 - _MOST_PICTURES :], made]
        control.report(0, 0, f"picture {self.count}, PSNR {state.best_psnr_db:.2f} dB")


def start_live_optimisation(
    session: EditingSession, source: str, request: OptimisationRequest | None = None
) -> OptimisationJob:
    """Starts an optimisation for the pictures of a film, a folder or a camera, as `open_live_pictures` takes them.

    Raises UserError as `start_optimisation` does, and for places of the pupil, a field's loss or another scheme. A
    source that can't be read ends the job.
    """
    request = request or OptimisationRequest()
    _refuse_to_optimise(session)
    if request.eyes.pupils is not None or request.compares_fields or request.scheme is not None:
        found = "with places of the pupil, a field's loss or another scheme"
        raise UserError("live target", found, expected="the bench as it is, and a loss of pictures")
    session.edit("Exposure for a picture", view_settings=session.document.view_settings_for_picture)
    return run_optimisation(session, LiveOptimisationJob(session, _with_first_patterns(request), source))


def start_optimisation(session: EditingSession, request: OptimisationRequest | None = None) -> OptimisationJob:
    """Starts an optimisation of the session's patterns for its target; the low exposure of random patterns is reset.

    Raises UserError for a field, without a target, while another optimisation runs, and for an invalid scheme or
    settings.
    """
    request = request or OptimisationRequest()
    _refuse_to_optimise(session)
    if session.target_spec is None:
        raise UserError("optimise", "there is no target", remedy="open a picture, or drop one on the window")
    if request.compares_fields and not session.target_spec.is_field:
        found = f'"{FIELD_LOSS}" with {session.target_spec.title}'
        raise UserError("loss", found, expected="a complex field as the target", remedy="File → Target from a field…")
    request = _with_first_patterns(request)
    system = session.system if request.scheme is None else with_scheme(session.system, request.scheme)
    request.eyes.places_in(request.eyes.aimed(system))  # an eye that there isn't is refused before the job begins
    session.edit("Exposure for a picture", view_settings=session.document.view_settings_for_picture)
    return run_optimisation(session, OptimisationJob(session, request, session.document, system))


def _refuse_to_optimise(session: EditingSession) -> None:
    """Raises UserError for a field, and while another optimisation runs."""
    if session.system.is_field:
        raise UserError("optimise", "a field has no patterns", remedy="open a preset first: its modulators have some")
    if running_optimisation(session) is not None:
        raise UserError("optimise", "one is running", remedy="keep or cancel it first")


def _with_first_patterns(request: OptimisationRequest) -> OptimisationRequest:
    """The request with the kind of its random patterns in its settings."""
    if request.start_patterns == "now":
        return request
    return replace(request, settings=replace(request.settings, begin=request.start_patterns))


def run_optimisation(session: EditingSession, job: OptimisationJob) -> OptimisationJob:
    """Starts an optimisation of a session, which shows its preview until it ends."""
    session.jobs.start("Optimise", job.run, job.commit, on_end=lambda: session.set_preview(None), job=job)
    return job


def chosen_optimisation(choices: OptimisationChoices, system: System) -> OptimisationRequest:
    """The optimisation that a user has chosen, for a system. Raises UserError for invalid choices."""
    compares_fields = choices.loss == FIELD_LOSS
    loss = None if compares_fields else choices.loss or None
    return OptimisationRequest(
        Settings(iterations=choices.iterations, loss=loss, eyebox=choices.eyebox),
        scheme=choices.scheme or None,
        start_patterns=choices.start_patterns,
        eyes=choices.eyes_for(system),
        compares_fields=compares_fields,
    )


def running_optimisation(session: EditingSession) -> OptimisationJob | None:
    """The optimisation that is running or paused, if any."""
    return next((job for job in session.jobs.active if isinstance(job, OptimisationJob)), None)


def last_optimisation(session: EditingSession) -> OptimisationJob | None:
    """The optimisation that was started last, whether it has ended or not."""
    return next((job for job in reversed(session.jobs.all) if isinstance(job, OptimisationJob)), None)


def start_quick_optimisation(session: EditingSession, iterations: int = 10) -> OptimisationJob:
    """Starts an optimisation that takes seconds: few iterations, one plane, superpixels, and a smooth initial phase."""
    _refuse_to_optimise(session)
    settings, superpixel = Settings(iterations=iterations, amplitudes_every=max(iterations // 2, 1)), 1
    if not session.system.is_chain:  # whose pixels have sizes of their own
        superpixel = math.ceil(math.sqrt(math.prod(session.system.modulators[0].shape) / _QUICK_PIXELS))
    nearest_m = float(min(session.system.planes_m, key=lambda z: abs(z - session.view_settings.plane_m)))
    request = OptimisationRequest(
        settings, start_patterns="smooth", preview_every=1, superpixel=superpixel, only_plane_m=nearest_m
    )
    return start_optimisation(session, request)


def with_lasers_of(system: System, optimised: System) -> System:
    """A system with the wavelengths and amplitudes of another system."""
    return system.edit({"wavelengths": optimised.wavelengths_m, "amplitudes": optimised.amplitudes})


def with_superpixels(system: System, factor: int) -> System:
    """A system whose modulator pixels are `factor` × `factor` larger; rounded up to cover the original pixels."""
    if factor == 1:
        return system
    shape = [-(-side // factor) for side in system.modulators[0].shape]
    return system.edit({"shape": shape, "pitch": system.modulators[0].pitch_m * factor})


def _expand_superpixels(drive: Drive, factor: int, shape: tuple[int, int]) -> Drive:
    """Patterns of superpixels (…, y, x) on single pixels, cropped evenly to `shape` (y, x)."""
    fine = drive.repeat(factor, axis=-2).repeat(factor, axis=-1)
    top, left = (fine.shape[-2] - shape[0]) // 2, (fine.shape[-1] - shape[1]) // 2
    return np.ascontiguousarray(fine[..., top : top + shape[0], left : left + shape[1]])


# --- A running optimisation as a session saves it, and how it goes on after a crash of the viewer ---


_WHAT = "the rest of an optimisation"
_KEPT: dict[str, ValueType] = {
    field.name: field.metadata["kind"]
    for field in dataclasses.fields(OptimisationRequest)
    if field.name in ("only_plane_m", "device", "compares_fields", "done")
}
"""What else is kept of its request."""


@dataclass(frozen=True, eq=False)
class UnfinishedOptimisation:
    """The best result so far, and the request that goes on from it; None where it can't go on."""

    best: Document
    rest: OptimisationRequest | None = None

    def rest_table(self) -> dict[str, Any] | None:
        """The rest as a table: settings as JSON, the eyes as text, and what else the request keeps."""
        if self.rest is None:
            return None
        settings = json.dumps(dataclasses.asdict(self.rest.settings))
        return {"settings": settings, **to_mapping(self.rest.eyes)} | {key: getattr(self.rest, key) for key in _KEPT}


def read_rest(table: Mapping[str, Any] | None) -> OptimisationRequest | None:
    """The request that goes on from the present patterns, from its table. Raises UserError for another table."""
    if table is None:
        return None
    eyes = {key: field.metadata["kind"] for key, field in fields_by_key(OptimisedEyes).items()}
    kinds = {"settings": Choice(), **eyes, **_KEPT}
    found = read_table(table, kinds, "unfinished: ", required=["settings"], expected=_WHAT)
    settings = read_record(Settings, found.pop("settings"), "unfinished: settings", _WHAT)
    seen = OptimisedEyes(**{key: found.pop(key) for key in eyes if key in found})
    return OptimisationRequest(settings, start_patterns="now", eyes=seen, **found)


def unfinished_optimisation(session: EditingSession) -> UnfinishedOptimisation | None:
    """The optimisation that runs now, once there is a result of it.

    An optimisation with larger pixels takes seconds, and its result is no state to go on from.
    """
    best, job = session.preview_document, running_optimisation(session)
    if best is None:
        return None
    if job is None or job.latest is None or job.request.superpixel > 1 or isinstance(job, LiveOptimisationJob):
        return UnfinishedOptimisation(best)
    request, done = job.request, job.latest.iteration
    if done >= request.settings.iterations:
        return UnfinishedOptimisation(best)
    return UnfinishedOptimisation(best, replace(request, start_patterns="now", done=done))


def continue_optimisation(session: EditingSession, unfinished: UnfinishedOptimisation) -> None:
    """Goes on from the best result with the iterations that were left, where that is possible."""
    if unfinished.rest is None or session.target_spec is None or running_optimisation(session) is not None:
        return
    best = unfinished.best
    job = OptimisationJob(session, unfinished.rest, session.document, best.system, start_drive=best.drive)
    session.messages.post("The optimisation goes on from the best patterns so far.")
    run_optimisation(session, job)


# --- speckle ----------------------------------------------------------------------------------------------------------


_ANY_PUPIL_M = 1e-3


class RetinalCurveJob(BackgroundJob):
    """The curve as a background job; `result` is None until it is done."""

    result: RetinalCurve | None = None


class RetinalCurves:
    """The curve of a session's document: computed when asked for, and kept until the document changes.

    The diameter of the pupil may change, as may all that doesn't concern the image.
    """

    def __init__(self, session: EditingSession) -> None:
        self._session = session
        self._job: RetinalCurveJob | None = None
        self._document: Document | None = None

    @property
    def job(self) -> RetinalCurveJob | None:
        """The job while it computes; a job for a document that has changed since is cancelled."""
        if self._job is None or not self._job.is_active:
            return None
        if not self._is_current:
            self._job.cancel()
            return None
        return self._job

    @property
    def curve(self) -> RetinalCurve | None:
        """The curve of the document as it is; None before it is computed."""
        return self._job.result if self._job is not None and self._is_current else None

    def start(self, pupils_m: Sequence[float] | None = None) -> RetinalCurveJob:
        """Computes the curve in the background, for pupils of these diameters, by default of natural diameters.

        Raises UserError without an eye, and as `pupils_of` does.
        """
        document = self._session.displayed_document
        systems = pupils_of(document.system, sorted(pupils_m or default_pupils(document.system)))
        if self._job is not None:
            self._job.cancel()
        job = RetinalCurveJob("Contrast by pupil", self._session.call_on_owner, self._session.wake)
        self._job, self._document = job, document

        def keep(curve: RetinalCurve) -> None:
            job.result = curve

        self._session.jobs.start(job.title, lambda control: _measure(document, systems, control), keep, job=job)
        return job

    @property
    def _is_current(self) -> bool:
        return self._document is not None and _has_same_curve(self._document, self._session.displayed_document)


def _has_same_curve(one: Document, other: Document) -> bool:
    """Whether two documents differ in nothing that the curve depends on."""
    is_same = one.drive is other.drive and one.target_spec is other.target_spec
    planes_m, regions = zip(*((of.view_settings.plane_m, of.measured_region) for of in (one, other)), strict=True)
    return (
        is_same
        and planes_m[0] == planes_m[1]
        and regions[0] == regions[1]
        and _with_any_pupil(one.system) == _with_any_pupil(other.system)
    )


def _with_any_pupil(system: System) -> System:
    return system if system.eye is None else system.with_(eye=replace(system.eye, pupil_m=_ANY_PUPIL_M))


def _measure(document: Document, systems: Sequence[System], control: JobControl) -> RetinalCurve:
    plane_m = document.view_settings.plane_m
    images = render_each([(system, plane_m) for system in systems], document.drive, control.check)
    return retinal_curve(
        systems, images, document.measured_region, control.report, partial(_target_of_eye, document), plane_m
    )


def _target_of_eye(document: Document, system: System) -> NDArray[np.floating] | None:
    """The target (y, x, 3) as the eye of a system would see it; None without a target at the plane."""
    spec, plane_m = document.target_spec, document.view_settings.plane_m
    if spec is None:
        return None
    target = spec.build(system, np.array([plane_m]))
    at = np.flatnonzero(np.asarray(target.planes_m) == plane_m)
    return target.stack[at[0]] if len(at) else None


# --- two ways to make colours ---


SCHEMES = ("simultaneous", "holochrome-8")
NAMES = ("Simultaneous, 3 wavelengths", "HoloChrome, 8 wavelengths")


@dataclass(frozen=True, eq=False)
class ComparedScheme:
    """One of the two schemes: its name, its document, and the speckle contrast of the region, None if withheld."""

    name: str
    document: Document
    contrast: float | None

    def words(self, places: int = 3) -> str:
        """The contrast with some decimal places, or that it is withheld."""
        return "withheld, the target isn't shown" if self.contrast is None else f"{self.contrast:.{places}f}"


@dataclass(frozen=True, eq=False)
class SchemeComparison:
    """Both schemes, and in words how their patterns were made."""

    left: ComparedScheme
    right: ComparedScheme
    method: str

    @property
    def summary(self) -> str:
        """The comparison in one line of text."""
        sides = "; ".join(
            f"{compared.name}: speckle contrast {compared.words()}" for compared in (self.left, self.right)
        )
        return f"{sides} ({self.method})"


class SchemeComparisonJob(BackgroundJob):
    """The comparison as a background job; `result` is None until it is done."""

    result: SchemeComparison | None = None


def start_scheme_comparison(session: EditingSession, iterations: int = 0) -> SchemeComparisonJob:
    """Starts a comparison with random patterns, or with patterns optimised for the target by some iterations.

    Both documents become snapshots and are shown side by side. Without a target, patterns are random.
    """
    start = session.document
    target, others = session.target_at(), session.other_targets()
    iterations = iterations if start.target_spec is not None else 0
    job = SchemeComparisonJob("Compare schemes", session.call_on_owner, session.wake)

    def work(control: JobControl) -> SchemeComparison:
        compared = []
        for number, (scheme, name) in enumerate(zip(SCHEMES, NAMES, strict=True)):
            control.report(number, 2, name)
            document = _document_of_scheme(start, with_scheme(start.system, scheme), iterations, control, number)
            (xyz,) = render_planes(document.system, document.drive, [document.view_settings.plane_m], control.check)
            reference = target if iterations else None
            contrast = measure_region(xyz, start.measured_region, reference, others).contrast
            compared.append(ComparedScheme(name, document, contrast))
        control.report(2, 2)
        method = "random patterns"
        if iterations:
            method = f"{iterations} iterations each, structure of the target divided out"
        return SchemeComparison(compared[0], compared[1], method)

    def done(result: SchemeComparison) -> None:
        job.result = result
        for old in [pinned for pinned in session.snapshots if pinned.startswith(NAMES)]:
            session.unpin(old)
        names = [f"{compared.name}: contrast {compared.words(2)}" for compared in (result.left, result.right)]
        a, b = (
            ComparisonSide("snapshot", session.pin(name, compared.document))
            for name, compared in zip(names, (result.left, result.right), strict=True)
        )
        stops = (
            session.view_settings.exposure_stops
            if iterations
            else min(session.view_settings.exposure_stops, SPECKLE_EXPOSURE_STOPS)
        )
        session.edit_view("Compare schemes", a=a, b=b, compare="side-by-side", page="image", exposure_stops=stops)
        session.messages.post(result.summary)

    session.jobs.start(job.title, work, done, job=job)
    return job


def _document_of_scheme(start: Document, system: System, iterations: int, control: JobControl, number: int) -> Document:
    """The document of a scheme, with random patterns or those of an optimisation. number: 0 or 1, for the progress."""
    if not iterations:
        return replace(start, system=system, drive=random_drive(system), origin="random patterns", path=None)
    from holoview.holograms.optimise.parallel import resolve_torch_device
    from holoview.holograms.optimise.solve import (
        iterate,  # slow start: it imports torch, which a viewer doesn't begin with
    )

    assert start.target_spec is not None
    state, settings = None, Settings(iterations=iterations)
    stack = start.target_spec.build(system).stack
    for state in iterate(with_compact_grid(system), stack, settings, device=resolve_torch_device("auto")):
        control.report(number + state.iteration / iterations, 2, f"iteration {state.iteration}")
    assert state is not None
    origin = f"optimised, {iterations} iterations, PSNR {state.best_psnr_db:.1f} dB"
    system = with_lasers_of(system, state.best.system)
    return replace(start, system=system, drive=state.best.drive, origin=origin, path=None)
