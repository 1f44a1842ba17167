"""Simultaneous colour beside HoloChrome on the same bench and target, each with its speckle contrast: what is gained.

Both get the same random patterns, or the same number of iterations from the same seed, and the label says which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from holoview.model.scheme import with_scheme
from holoview.model.system import System
from holoview.optimise.memory import with_compact_grid
from holoview.optimise.settings import Settings
from holoview.optimise.solve import iterate
from holoview.optimise.torch_device import resolve_torch_device
from holoview.session.document import Document
from holoview.session.editing_session import EditingSession
from holoview.session.jobs import BackgroundJob, JobControl
from holoview.session.measure import measure_region
from holoview.session.rendering import render_planes
from holoview.session.view_settings import SPECKLE_EXPOSURE_STOPS, ComparisonSide
from holoview.view import random_drive

SCHEMES = ("simultaneous", "holochrome-8")
NAMES = ("Simultaneous, 3 wavelengths", "HoloChrome, 8 wavelengths")


@dataclass(frozen=True, eq=False)
class ComparedScheme:
    """One of the two: its name, its state, and the speckle contrast of the region."""

    name: str
    document: Document
    contrast: float


@dataclass(frozen=True, eq=False)
class SchemeComparison:
    """Both sides, and in words how they came about."""

    left: ComparedScheme
    right: ComparedScheme
    method: str

    @property
    def summary(self) -> str:
        """The comparison in a line."""
        sides = "; ".join(f"{shown.name}: speckle contrast {shown.contrast:.3f}" for shown in (self.left, self.right))
        return f"{sides} ({self.method})"


class SchemeComparisonJob(BackgroundJob):
    """The job; `result` once it is done."""

    result: SchemeComparison | None = None


def start_scheme_comparison(session: EditingSession, iterations: int = 0) -> SchemeComparisonJob:
    """Pins both and shows them side by side: with random patterns, or optimised for the target by `iterations`.

    Without a target random patterns are taken, and the result says so.
    """
    begun = session.document
    target = session.target_at()
    iterations = iterations if begun.target_spec is not None else 0
    job = SchemeComparisonJob("Compare schemes", session.call_on_owner, session.wake)

    def work(control: JobControl) -> SchemeComparison:
        shown = []
        for number, (scheme, name) in enumerate(zip(SCHEMES, NAMES, strict=True)):
            control.report(number, 2, name)
            state = _state(begun, with_scheme(begun.system, scheme), iterations, control, number)
            (xyz,) = render_planes(state.system, state.drive, [state.view_settings.plane_m], control.check)
            structure = target if iterations else None
            shown.append(ComparedScheme(name, state, measure_region(xyz, begun.measured_region, structure).contrast))
        control.report(2, 2)
        how = f"{iterations} iterations each, structure of the target divided out" if iterations else "random patterns"
        return SchemeComparison(shown[0], shown[1], how)

    def done(result: SchemeComparison) -> None:
        job.result = result
        for old in [pinned for pinned in session.snapshots if pinned.startswith(NAMES)]:
            session.unpin(old)
        names = [f"{shown.name}: contrast {shown.contrast:.2f}" for shown in (result.left, result.right)]
        a, b = (
            ComparisonSide("snapshot", session.pin(name, shown.document))
            for name, shown in zip(names, (result.left, result.right), strict=True)
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


def _state(begun: Document, system: System, iterations: int, control: JobControl, number: int) -> Document:
    """The scheme with random patterns, or with those found in some iterations."""
    if not iterations:
        return replace(begun, system=system, drive=random_drive(system), origin="random patterns", path=None)
    assert begun.target_spec is not None
    found, settings = None, Settings(iterations=iterations)
    stack = begun.target_spec.build(system).stack
    for found in iterate(with_compact_grid(system), stack, settings, device=resolve_torch_device("auto")):
        control.report(number + found.iteration / iterations, 2, f"iteration {found.iteration}")
    assert found is not None
    lasers = {"wavelengths": found.best.system.wavelengths_m, "amplitudes": found.best.system.amplitudes}
    origin = f"optimised, {iterations} iterations, PSNR {found.best_psnr_db:.1f} dB"
    return replace(begun, system=system.edit(lasers), drive=found.best.drive, origin=origin, path=None)
