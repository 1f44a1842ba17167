"""Jobs that measure speckle: on the retina, against the diameter of the pupil, and with both ways to make colours.

The ways to make colours, simultaneous colour and HoloChrome, are compared on the same system and target. Both get
random patterns, or the same number of optimisation iterations from the same seed; the result says which.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.document.measure import luminance_of, measure_region
from holoview.document.optimisation_job import with_lasers_of
from holoview.metrics.speckle import RetinalCurve, default_pupils, pupils_of, retinal_curve
from holoview.model.scheme import with_scheme
from holoview.model.system import System
from holoview.optimise.memory import with_compact_grid
from holoview.optimise.settings import Settings
from holoview.render.planes import render_each, render_planes
from holoview.render.view_settings import SPECKLE_EXPOSURE_STOPS, ComparisonSide
from holoview.view import random_drive

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
        """The job while it computes; one for a document that has changed since is cancelled."""
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
        """Computes the curve in the background, for pupils of these diameters, else for those of natural ones.

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
        systems, images, document.measured_region, control.report, partial(_target_luminance, document)
    )


def _target_luminance(document: Document, system: System) -> NDArray[np.floating] | None:
    """Luminance (y, x) of the target as the eye of a system would see it; None without a target at the plane."""
    spec, plane_m = document.target_spec, document.view_settings.plane_m
    if spec is None:
        return None
    target = spec.build(system, np.array([plane_m]))
    at = np.flatnonzero(np.asarray(target.planes_m) == plane_m)
    return luminance_of(target.stack[at[0]], document.measured_region) if len(at) else None


# --- two ways to make colours ---


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
