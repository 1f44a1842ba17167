"""Simultaneous colour beside HoloChrome on the same bench and target, each with its speckle contrast: what is gained.

Both get the same random patterns, or the same number of iterations from the same seed, and the label says which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from holoview.optimise.device import find_device
from holoview.optimise.memory import on_compact_grid
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.scheme import with_scheme
from holoview.session.jobs import Control, Job
from holoview.session.look import SPECKLE_STOPS, Side
from holoview.session.measure import measure_region
from holoview.session.rendering import planes_seen
from holoview.session.session import Session
from holoview.session.state import State
from holoview.system import System
from holoview.view import random_drive

SCHEMES = ("simultaneous", "holochrome-8")
NAMES = ("Simultaneous, 3 wavelengths", "HoloChrome, 8 wavelengths")


@dataclass(frozen=True, eq=False)
class Shown:
    """One of the two: its name, its state, and the speckle contrast of the region."""

    name: str
    state: State
    contrast: float


@dataclass(frozen=True, eq=False)
class Showcase:
    """Both sides, and in words how they came about."""

    left: Shown
    right: Shown
    how: str

    @property
    def words(self) -> str:
        """The comparison in a line."""
        sides = "; ".join(f"{shown.name}: speckle contrast {shown.contrast:.3f}" for shown in (self.left, self.right))
        return f"{sides} ({self.how})"


class ShowcaseJob(Job):
    """The job; `result` once it is done."""

    result: Showcase | None = None


def showcase(session: Session, iterations: int = 0) -> ShowcaseJob:
    """Pins both and shows them side by side: with random patterns, or optimised for the target by `iterations`.

    Without a target random patterns are taken, and the result says so.
    """
    begun = session.state
    target = session.target_at()
    iterations = iterations if begun.wanted is not None else 0
    job = ShowcaseJob("Compare schemes", session.deliver, session.wake)

    def work(control: Control) -> Showcase:
        shown = []
        for number, (scheme, name) in enumerate(zip(SCHEMES, NAMES, strict=True)):
            control.report(number, 2, name)
            state = _state(begun, with_scheme(begun.system, scheme), iterations, control, number)
            (xyz,) = planes_seen(state.system, state.drive, [state.look.plane_m], control.check)
            structure = target if iterations else None
            shown.append(Shown(name, state, measure_region(xyz, begun.region, structure).contrast))
        control.report(2, 2)
        how = f"{iterations} iterations each, structure of the target divided out" if iterations else "random patterns"
        return Showcase(shown[0], shown[1], how)

    def done(result: Showcase) -> None:
        job.result = result
        for old in [pinned for pinned in session.snapshots if pinned.startswith(NAMES)]:
            session.unpin(old)
        names = [f"{shown.name}: contrast {shown.contrast:.2f}" for shown in (result.left, result.right)]
        a, b = (
            Side("snapshot", session.pin(name, shown.state))
            for name, shown in zip(names, (result.left, result.right), strict=True)
        )
        stops = session.look.exposure_stops if iterations else min(session.look.exposure_stops, SPECKLE_STOPS)
        session.look_at("Compare schemes", a=a, b=b, compare="side-by-side", page="image", exposure_stops=stops)
        session.messages.post(result.words)

    session.jobs.start(job.title, work, done, job=job)
    return job


def _state(begun: State, system: System, iterations: int, control: Control, number: int) -> State:
    """The scheme with random patterns, or with those found in some iterations."""
    if not iterations:
        return replace(begun, system=system, drive=random_drive(system), origin="random patterns", path=None)
    assert begun.wanted is not None
    found, settings = None, Settings(iterations=iterations)
    stack = begun.wanted.build(system).stack
    for found in iterate(on_compact_grid(system), stack, settings, device=find_device("auto")):
        control.report(number + found.iteration / iterations, 2, f"iteration {found.iteration}")
    assert found is not None
    lasers = {"wavelengths": found.best.system.wavelengths_m, "amplitudes": found.best.system.amplitudes}
    origin = f"optimised, {iterations} iterations, PSNR {found.best_psnr_db:.1f} dB"
    return replace(begun, system=system.edit(lasers), drive=found.best.drive, origin=origin, path=None)
