"""An optimisation in the background that the view follows: kept as one edit that undo takes back, or thrown away."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from threading import Event
from time import monotonic

import numpy as np

from holoview.model.scheme import with_scheme
from holoview.model.system import System
from holoview.optimise.iteration_state import IterationState as Found
from holoview.optimise.memory import with_compact_grid
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.optimise.torch_device import resolve_torch_device
from holoview.session.document import Document, Drive
from holoview.session.editing_session import EditingSession
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.target_spec import TargetSpec
from holoview.util import units
from holoview.util.errors import UserError

START_PATTERNS = ("now", "random", "smooth")
_QUICK_PIXELS = 100_000
_SHOWN_EVERY_S = 0.25
"""The view is handed new patterns no more often, however fast iterations are."""


@dataclass(frozen=True)
class OptimisationRequest:
    """What to optimise, and how.

    settings: of the optimiser. scheme: a colour scheme to change the bench to first. begin: patterns to begin with,
    those of "now", or "random", "smooth". every: iterations between two looks. coarse: modulator pixels a side that
    move together: a pattern of larger pixels, physically what it says, found coarse² times as fast. only_m: the one
    focal plane that counts; all of the bench's when None. device: of torch, "auto" for the fastest.
    Raises UserError for values that make no sense.
    """

    settings: Settings = field(default_factory=Settings)
    scheme: str | None = None
    start_patterns: str = "random"
    preview_every: int = 3
    superpixel: int = 1
    only_plane_m: float | None = None
    device: str = "auto"

    def __post_init__(self) -> None:
        if self.start_patterns not in START_PATTERNS:
            raise UserError("begin", f'"{self.start_patterns}"', expected=", ".join(START_PATTERNS))
        for key, count in (("every", self.preview_every), ("coarse", self.superpixel)):
            if count < 1:
                raise UserError(key, str(count), expected="at least 1")
        if self.superpixel > 1 and self.start_patterns == "now":
            raise UserError("begin", '"now" with larger pixels', expected='"random" or "smooth"')


@dataclass(frozen=True)
class OptimisationProgress:
    """Where an optimisation stands: iteration of iterations, loss, PSNR (dB) now and of the best."""

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float


class OptimisationJob(BackgroundJob):
    """The job, with what it reached; `keep` ends it with the best so far, `cancel` leaves the old patterns."""

    def __init__(self, session: EditingSession, plan: OptimisationRequest, begun: Document, system: System) -> None:
        super().__init__("Optimise", session.call_on_owner, session.wake)
        self.request, self.start_document, self.system = plan, begun, system
        self.progress: list[OptimisationProgress] = []
        self._session, self._keep = session, Event()
        self.control.total = plan.settings.iterations

    @property
    def latest(self) -> OptimisationProgress | None:
        """Where it stands, None before the first iteration has ended."""
        return self.progress[-1] if self.progress else None

    def stop_and_keep(self) -> None:
        """Ends it after this iteration; the best so far becomes an edit."""
        self._keep.set()
        self.resume()

    def run(self, control: JobControl) -> Document:
        """Iterates on the compact grid; the best hologram on the bench's own. Runs on the job's thread."""
        plan, begun = self.request, self.start_document
        wanted = begun.target_spec
        assert wanted is not None
        control.report(0, plan.settings.iterations, "building the target")
        bench = with_superpixels(self.system, plan.superpixel)
        bench = bench if plan.only_plane_m is None else bench.edit({"planes": [plan.only_plane_m]})
        stack = wanted.build(bench).stack
        control.report(0, plan.settings.iterations, "preparing")
        start = begun.drive if plan.start_patterns == "now" and begun.drive.shape == bench.drive_shape else None
        found, shown, device = None, 0.0, resolve_torch_device(plan.device)
        for found in iterate(with_compact_grid(bench), stack, plan.settings, start, device=device):
            self._report(control, found)
            due = found.iteration % plan.preview_every == 0 and monotonic() - shown >= _SHOWN_EVERY_S
            if due or found.iteration == 0:
                shown = monotonic()
                state = self._as_document(found)
                self._session.call_on_owner(lambda state=state: self._show_preview(state))  # type: ignore[misc]
            if self._keep.is_set():
                break
        assert found is not None
        return self._as_document(found)

    def _report(self, control: JobControl, found: Found) -> None:
        reached = OptimisationProgress(found.iteration, found.iterations, found.loss, found.psnr_db, found.best_psnr_db)
        self.progress.append(reached)
        control.report(found.iteration, found.iterations, f"loss {found.loss:.4g}, PSNR {found.best_psnr_db:.2f} dB")

    def _as_document(self, found: Found) -> Document:
        """The best so far as a document, on the bench's own grid."""
        lasers = {"wavelengths": found.best.system.wavelengths_m, "amplitudes": found.best.system.amplitudes}
        drive = _expand_superpixels(found.best.drive, self.request.superpixel, self.system.modulators[0].shape)
        pixels = (
            f" with {self.request.superpixel} x {self.request.superpixel} pixels as one"
            if self.request.superpixel > 1
            else ""
        )
        plane = (
            "" if self.request.only_plane_m is None else f" for {units.format_rounded(self.request.only_plane_m, 'mm')}"
        )
        words = f"optimised{pixels}{plane}, {found.iteration} iterations, PSNR {found.best_psnr_db:.1f} dB"
        return replace(self.start_document, system=self.system.edit(lasers), drive=drive, origin=words, path=None)

    def _show_preview(self, state: Document) -> None:
        if self.is_active:
            self._session.set_preview(self.start_document, state)

    def commit(self, state: Document) -> None:
        """Makes the result an edit. Runs on the owner's thread."""
        latest, session = self.latest, self._session
        assert latest is not None
        if session.system != self.start_document.system:
            session.messages.post(
                "the bench is as it was when the optimisation began; undo brings your changes back", "warning"
            )
        label = f"Optimise, {latest.iteration} iterations, {latest.best_psnr_db:.1f} dB"
        session.edit(label, system=state.system, drive=state.drive, origin=state.origin, path=None)
        session.messages.post(f"{label}: {latest.loss:.4g} loss")


def start_optimisation(session: EditingSession, plan: OptimisationRequest | None = None) -> OptimisationJob:
    """Starts an optimisation of the session's patterns for its target.

    Raises UserError without a target, while another one runs, and for a scheme or settings that make no sense.
    """
    plan = plan or OptimisationRequest()
    if session.target_spec is None:
        raise UserError("optimise", "there is no target", remedy="open a picture, or drop one on the window")
    if running_optimisation(session) is not None:
        raise UserError("optimise", "one is running", remedy="keep or cancel it first")
    if plan.start_patterns in ("random", "smooth"):
        plan = replace(plan, settings=replace(plan.settings, begin=plan.start_patterns))
    system = session.system if plan.scheme is None else with_scheme(session.system, plan.scheme)
    job = OptimisationJob(session, plan, session.document, system)
    session.jobs.start("Optimise", job.run, job.commit, on_end=lambda: session.set_preview(None), job=job)
    return job


def running_optimisation(session: EditingSession) -> OptimisationJob | None:
    """The optimisation that hasn't ended yet, if there is one."""
    return next((job for job in session.jobs.active if isinstance(job, OptimisationJob)), None)


def last_optimisation(session: EditingSession) -> OptimisationJob | None:
    """The optimisation that was started last, ended or not."""
    return next((job for job in reversed(session.jobs.all) if isinstance(job, OptimisationJob)), None)


def start_quick_optimisation(
    session: EditingSession, wanted: TargetSpec | None = None, iterations: int = 10
) -> OptimisationJob:
    """A few iterations for one plane, with large pixels and a smooth phase: something of a picture within seconds."""
    if wanted is not None:
        session.edit(f"Target {wanted.title}", target_spec=wanted)
    rows, columns = session.system.modulators[0].shape
    settings = Settings(iterations=iterations, amplitudes_every=max(iterations // 2, 1))
    coarse = math.ceil(math.sqrt(rows * columns / _QUICK_PIXELS))
    nearest = float(min(session.system.planes_m, key=lambda z: abs(z - session.view_settings.plane_m)))
    return start_optimisation(
        session,
        OptimisationRequest(
            settings, start_patterns="smooth", preview_every=1, superpixel=coarse, only_plane_m=nearest
        ),
    )


def with_superpixels(system: System, factor: int) -> System:
    """The bench with `factor` × `factor` modulator pixels joined to one, cut off evenly where that doesn't divide."""
    if factor == 1:
        return system
    shape = [-(-side // factor) for side in system.modulators[0].shape]
    return system.edit({"shape": shape, "pitch": system.modulators[0].pitch_m * factor})


def _expand_superpixels(drive: Drive, factor: int, shape: tuple[int, int]) -> Drive:
    """A coarsened bench's patterns on the pixels of the bench itself: the same light."""
    if factor == 1:
        return drive
    fine = drive.repeat(factor, axis=-2).repeat(factor, axis=-1)
    top, left = ((have - want) // 2 for have, want in zip(fine.shape[-2:], shape, strict=True))
    return np.ascontiguousarray(fine[..., top : top + shape[0], left : left + shape[1]])
