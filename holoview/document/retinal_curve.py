"""Speckle contrast on the retina against the diameter of the pupil, for the hologram and the region of a session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from holoview.document.document import Document
from holoview.document.editing_session import EditingSession
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.document.measure import luminance_of
from holoview.metrics.speckle import RetinalContrast, default_pupils, independent_contrast, pupils_of, retinal_contrast
from holoview.model.system import System
from holoview.render.plane_images import render_each

_ANY_PUPIL_M = 1e-3


@dataclass(frozen=True, eq=False)
class RetinalCurve:
    """Contrasts for pupils of rising diameter, and the contrast of independent patterns of the same lasers.

    has_target: whether the structure of the target was divided out.
    """

    contrasts: tuple[RetinalContrast, ...]
    independent: float
    has_target: bool


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
    plane_m, region, contrasts = document.view_settings.plane_m, document.measured_region, []
    images = render_each([(system, plane_m) for system in systems], document.drive, control.check)
    has_target = False
    for number, (system, xyz) in enumerate(zip(systems, images, strict=True)):
        target = _target_luminance(document, system)
        has_target |= target is not None
        contrasts.append(retinal_contrast(system, xyz[..., 1], region, target))
        control.report(number + 1, len(systems), f"{contrasts[-1].pupil_m * 1e3:.3g} mm")
    return RetinalCurve(tuple(contrasts), independent_contrast(document.system), has_target)


def _target_luminance(document: Document, system: System) -> NDArray[np.floating] | None:
    """Luminance (y, x) of what the eye of a system would see of the scene; None where there is no target of it."""
    spec, plane_m = document.target_spec, document.view_settings.plane_m
    if spec is None:
        return None
    target = spec.build(system, np.array([plane_m]))
    at = np.flatnonzero(np.asarray(target.planes_m) == plane_m)
    return luminance_of(target.stack[at[0]], document.measured_region) if len(at) else None
