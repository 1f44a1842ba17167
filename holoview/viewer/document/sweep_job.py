"""Sweeps of a session's bench as a job: a curve that grows point by point, each of which can be shown."""

from __future__ import annotations

from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.jobs import BackgroundJob, JobControl
from holoview.viewer.document.sweeper import SweepRequest, SweptCurve, SweptPoint
from holoview.viewer.render.view_settings import NOW


class SweepJob(BackgroundJob):
    """A sweep in the background. curve: what it has found so far, kept when it is cancelled; None before that."""

    def __init__(self, session: EditingSession, request: SweepRequest) -> None:
        super().__init__("Sweep", session.call_on_owner, session.wake)
        self.request, self.start_document = request, session.document
        self.curve: SweptCurve | None = None

    def show(self, session: EditingSession, point: SweptPoint) -> None:
        """Shows a point, in place of another hologram that was looked at.

        Its bench and its patterns become one step of undo, and further points the same one.
        """
        start = self.start_document
        drive = start.drive if point.drive is None else point.drive
        origin = start.origin if point.drive is None else f"optimised for {point.text}"
        key = ("sweep", id(self))
        label = f"Point of the sweep, {point.text}"
        if session.view_settings.shown != NOW:
            session.edit_view("Shown", shown=NOW)
        session.edit(label, system=point.system, drive=drive, origin=origin, path=None, merge_key=key)


def start_sweep(session: EditingSession, request: SweepRequest) -> SweepJob:
    """Starts a sweep of the session's bench as it is now. Raises UserError where the viewer can't sweep."""
    if session.sweeper is None:
        raise UserError("sweep", "this viewer has none", remedy="open it by holoview view")
    sweeper, job = session.sweeper, SweepJob(session, request)

    def keep(curve: SweptCurve) -> None:
        job.curve = curve
        session.wake()

    def work(control: JobControl) -> None:
        control.report(0, 0, "loading")
        sweeper(job.start_document, request, control.report, lambda curve: session.call_on_owner(lambda: keep(curve)))

    session.jobs.start(job.title, work, job=job)
    return job
