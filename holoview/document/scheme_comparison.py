"""Compares simultaneous colour with HoloChrome on the same system and target by their speckle contrasts.

Both get random patterns, or the same number of optimisation iterations from the same seed; the result says which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.document.measure import measure_region
from holoview.document.optimisation_job import with_lasers_of
from holoview.model.scheme import with_scheme
from holoview.model.system import System
from holoview.optimise.memory import with_compact_grid
from holoview.optimise.settings import Settings
from holoview.render.plane_images import render_planes
from holoview.render.view_settings import SPECKLE_EXPOSURE_STOPS, ComparisonSide
from holoview.view import random_drive

SCHEMES = ("simultaneous", "holochrome-8")
NAMES = ("Simultaneous, 3 wavelengths", "HoloChrome, 8 wavelengths")


@dataclass(frozen=True, eq=False)
class ComparedScheme:
    """One of the two schemes: its name, its document, and the speckle contrast of the measured region."""

    name: str
    document: Document
    contrast: float


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
            f"{compared.name}: speckle contrast {compared.contrast:.3f}" for compared in (self.left, self.right)
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
    target = session.target_at()
    iterations = iterations if start.target_spec is not None else 0
    job = SchemeComparisonJob("Compare schemes", session.call_on_owner, session.wake)

    def work(control: JobControl) -> SchemeComparison:
        compared = []
        for number, (scheme, name) in enumerate(zip(SCHEMES, NAMES, strict=True)):
            control.report(number, 2, name)
            document = _document_of_scheme(start, with_scheme(start.system, scheme), iterations, control, number)
            (xyz,) = render_planes(document.system, document.drive, [document.view_settings.plane_m], control.check)
            reference = target if iterations else None
            contrast = measure_region(xyz, start.measured_region, reference).contrast
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
        names = [f"{compared.name}: contrast {compared.contrast:.2f}" for compared in (result.left, result.right)]
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
    from holoview.optimise.parallel import resolve_torch_device
    from holoview.optimise.solve import iterate  # slow start: it imports torch, which a viewer doesn't begin with

    assert start.target_spec is not None
    state, settings = None, Settings(iterations=iterations)
    stack = start.target_spec.build(system).stack
    for state in iterate(with_compact_grid(system), stack, settings, device=resolve_torch_device("auto")):
        control.report(number + state.iteration / iterations, 2, f"iteration {state.iteration}")
    assert state is not None
    origin = f"optimised, {iterations} iterations, PSNR {state.best_psnr_db:.1f} dB"
    system = with_lasers_of(system, state.best.system)
    return replace(start, system=system, drive=state.best.drive, origin=origin, path=None)
