"""An optimisation in the background that the view follows: kept as one edit that undo takes back, or thrown away."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from threading import Event
from time import monotonic

import numpy as np

from holoview import units
from holoview.errors import UserError
from holoview.optimise.device import find_device
from holoview.optimise.memory import on_compact_grid
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.optimise.state import State as Found
from holoview.scheme import with_scheme
from holoview.session.jobs import Control, Job
from holoview.session.session import Session
from holoview.session.state import Drive, State
from holoview.session.wanted import Wanted
from holoview.system import System

BEGINS = ("now", "random", "smooth")
_QUICK_PIXELS = 100_000
_SHOWN_EVERY_S = 0.25
"""The view is handed new patterns no more often, however fast iterations are."""


@dataclass(frozen=True)
class OptimisePlan:
    """What to optimise, and how.

    settings: of the optimiser. scheme: a colour scheme to change the bench to first. begin: patterns to begin with,
    those of "now", or "random", "smooth". every: iterations between two looks. coarse: modulator pixels a side that
    move together: a pattern of larger pixels, physically what it says, found coarse² times as fast. only_m: the one
    focal plane that counts; all of the bench's when None. device: of torch, "auto" for the fastest.
    Raises UserError for values that make no sense.
    """

    settings: Settings = field(default_factory=Settings)
    scheme: str | None = None
    begin: str = "random"
    every: int = 3
    coarse: int = 1
    only_m: float | None = None
    device: str = "auto"

    def __post_init__(self) -> None:
        if self.begin not in BEGINS:
            raise UserError("begin", f'"{self.begin}"', expected=", ".join(BEGINS))
        for key, count in (("every", self.every), ("coarse", self.coarse)):
            if count < 1:
                raise UserError(key, str(count), expected="at least 1")
        if self.coarse > 1 and self.begin == "now":
            raise UserError("begin", '"now" with larger pixels', expected='"random" or "smooth"')


@dataclass(frozen=True)
class Reached:
    """Where an optimisation stands: iteration of iterations, loss, PSNR (dB) now and of the best."""

    iteration: int
    iterations: int
    loss: float
    psnr_db: float
    best_psnr_db: float


class Optimisation(Job):
    """The job, with what it reached; `keep` ends it with the best so far, `cancel` leaves the old patterns."""

    def __init__(self, session: Session, plan: OptimisePlan, begun: State, system: System) -> None:
        super().__init__("Optimise", session.deliver, session.wake)
        self.plan, self.begun, self.system = plan, begun, system
        self.reached: list[Reached] = []
        self._session, self._keep = session, Event()
        self.control.total = plan.settings.iterations

    @property
    def latest(self) -> Reached | None:
        """Where it stands, None before the first iteration has ended."""
        return self.reached[-1] if self.reached else None

    def keep(self) -> None:
        """Ends it after this iteration; the best so far becomes an edit."""
        self._keep.set()
        self.resume()

    def work(self, control: Control) -> State:
        """Iterates on the compact grid; the best hologram on the bench's own. Runs on the job's thread."""
        plan, begun = self.plan, self.begun
        wanted = begun.wanted
        assert wanted is not None
        control.report(0, plan.settings.iterations, "building the target")
        bench = coarsened(self.system, plan.coarse)
        bench = bench if plan.only_m is None else bench.edit({"planes": [plan.only_m]})
        stack = wanted.build(bench).stack
        control.report(0, plan.settings.iterations, "preparing")
        start = begun.drive if plan.begin == "now" and begun.drive.shape == bench.drive_shape else None
        found, shown, device = None, 0.0, find_device(plan.device)
        for found in iterate(on_compact_grid(bench), stack, plan.settings, start, device=device):
            self._report(control, found)
            due = found.iteration % plan.every == 0 and monotonic() - shown >= _SHOWN_EVERY_S
            if due or found.iteration == 0:
                shown = monotonic()
                state = self._as_state(found)
                self._session.deliver(lambda state=state: self._follow(state))  # type: ignore[misc]
            if self._keep.is_set():
                break
        assert found is not None
        return self._as_state(found)

    def _report(self, control: Control, found: Found) -> None:
        reached = Reached(found.iteration, found.iterations, found.loss, found.psnr_db, found.best_psnr_db)
        self.reached.append(reached)
        control.report(found.iteration, found.iterations, f"loss {found.loss:.4g}, PSNR {found.best_psnr_db:.2f} dB")

    def _as_state(self, found: Found) -> State:
        """The best so far as a document, on the bench's own grid."""
        lasers = {"wavelengths": found.best.system.wavelengths_m, "amplitudes": found.best.system.amplitudes}
        drive = _refined(found.best.drive, self.plan.coarse, self.system.modulators[0].shape)
        pixels = f" with {self.plan.coarse} x {self.plan.coarse} pixels as one" if self.plan.coarse > 1 else ""
        plane = "" if self.plan.only_m is None else f" for {units.short(self.plan.only_m, 'mm')}"
        words = f"optimised{pixels}{plane}, {found.iteration} iterations, PSNR {found.best_psnr_db:.1f} dB"
        return replace(self.begun, system=self.system.edit(lasers), drive=drive, origin=words, path=None)

    def _follow(self, state: State) -> None:
        if self.is_active:
            self._session.preview(self.begun, state)

    def finish(self, state: State) -> None:
        """Makes the result an edit. Runs on the owner's thread."""
        latest, session = self.latest, self._session
        assert latest is not None
        if session.system != self.begun.system:
            session.messages.post(
                "the bench is as it was when the optimisation began; undo brings your changes back", "warning"
            )
        label = f"Optimise, {latest.iteration} iterations, {latest.best_psnr_db:.1f} dB"
        session.edit(label, system=state.system, drive=state.drive, origin=state.origin, path=None)
        session.messages.post(f"{label}: {latest.loss:.4g} loss")


def optimise(session: Session, plan: OptimisePlan | None = None) -> Optimisation:
    """Starts an optimisation of the session's patterns for its target.

    Raises UserError without a target, while another one runs, and for a scheme or settings that make no sense.
    """
    plan = plan or OptimisePlan()
    if session.wanted is None:
        raise UserError("optimise", "there is no target", remedy="open a picture, or drop one on the window")
    if running(session) is not None:
        raise UserError("optimise", "one is running", remedy="keep or cancel it first")
    if plan.begin in ("random", "smooth"):
        plan = replace(plan, settings=replace(plan.settings, begin=plan.begin))
    system = session.system if plan.scheme is None else with_scheme(session.system, plan.scheme)
    job = Optimisation(session, plan, session.state, system)
    session.jobs.start("Optimise", job.work, job.finish, ended=lambda: session.preview(None), job=job)
    return job


def running(session: Session) -> Optimisation | None:
    """The optimisation that hasn't ended yet, if there is one."""
    return next((job for job in session.jobs.active if isinstance(job, Optimisation)), None)


def last(session: Session) -> Optimisation | None:
    """The optimisation that was started last, ended or not."""
    return next((job for job in reversed(session.jobs.all) if isinstance(job, Optimisation)), None)


def quick_look(session: Session, wanted: Wanted | None = None, iterations: int = 10) -> Optimisation:
    """A few iterations for one plane, with large pixels and a smooth phase: something of a picture within seconds."""
    if wanted is not None:
        session.edit(f"Target {wanted.title}", wanted=wanted)
    rows, columns = session.system.modulators[0].shape
    settings = Settings(iterations=iterations, amplitudes_every=max(iterations // 2, 1))
    coarse = math.ceil(math.sqrt(rows * columns / _QUICK_PIXELS))
    nearest = float(min(session.system.planes_m, key=lambda z: abs(z - session.look.plane_m)))
    return optimise(session, OptimisePlan(settings, begin="smooth", every=1, coarse=coarse, only_m=nearest))


def coarsened(system: System, factor: int) -> System:
    """The bench with `factor` × `factor` modulator pixels joined to one, cut off evenly where that doesn't divide."""
    if factor == 1:
        return system
    shape = [-(-side // factor) for side in system.modulators[0].shape]
    return system.edit({"shape": shape, "pitch": system.modulators[0].pitch_m * factor})


def _refined(drive: Drive, factor: int, shape: tuple[int, int]) -> Drive:
    """A coarsened bench's patterns on the pixels of the bench itself: the same light."""
    if factor == 1:
        return drive
    fine = drive.repeat(factor, axis=-2).repeat(factor, axis=-1)
    top, left = ((have - want) // 2 for have, want in zip(fine.shape[-2:], shape, strict=True))
    return np.ascontiguousarray(fine[..., top : top + shape[0], left : left + shape[1]])
