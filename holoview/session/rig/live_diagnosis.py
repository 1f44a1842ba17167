"""A diagnosis that follows the captures as they come: begun after a few, and again with more, in the background."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from holoview.captures.dataset import Captures
from holoview.diagnose.diagnosis import Cause, Diagnosis
from holoview.diagnose.formatting import format_value
from holoview.diagnose.pipeline import diagnose
from holoview.rig.measure.capture_store import join_captures
from holoview.session.editing_session import EditingSession
from holoview.session.jobs import BackgroundJob, JobControl

FIRST, FEW = 4, 3
"""Captures after which the first diagnosis begins; further ones after which, at least, the next one does."""
_GROWTH = 0.5  # of the captures, after which a running diagnosis is worth beginning again
TIME_S = 30.0
"""How long a search may take; records and intervals take a little longer."""

Diagnose = Callable[..., Diagnosis]


@dataclass(frozen=True, eq=False)
class CauseText:
    """A cause in words: its sentence, a line for each parameter with its interval, and what looks like it."""

    sentence: str
    intervals: tuple[str, ...]
    doubts: tuple[str, ...]


class LiveDiagnosis:
    """Diagnoses captures of a rig as jobs of the session; a running one gives way to one of more captures.

    time_s: how long a search may take. diagnosis: the last result, None before the first. count: its captures.
    so_far: a sentence of the running one, or "". is_on: whether it begins by itself.
    """

    def __init__(self, session: EditingSession, run: Diagnose = diagnose) -> None:
        self._session, self._run = session, run
        self.time_s, self.is_on = TIME_S, True
        self.diagnosis: Diagnosis | None = None
        self.count, self.so_far = 0, ""
        self._job: BackgroundJob | None = None
        self._begun = 0

    @property
    def job(self) -> BackgroundJob | None:
        """The running diagnosis; None while there is none."""
        return self._job if self._job is not None and self._job.is_active else None

    def offer(self, captures: Sequence[Captures], *, is_all: bool = False) -> None:
        """Diagnoses these captures if that is due. is_all: no more come for now."""
        count = len(captures)
        step = 1 if is_all else max(FEW, round(_GROWTH * self._begun))
        if self.is_on and count >= max(FIRST, self._begun + step):
            self.start(captures)

    def start(self, captures: Sequence[Captures]) -> None:
        """Diagnoses these captures, each a session of one, in place of what is being diagnosed."""
        self.cancel()
        self._begun, self.so_far = len(captures), ""
        work = partial(self._work, list(captures), self.time_s)
        self._job = self._session.jobs.start("Diagnosis", work, partial(self._show, len(captures)))

    def cancel(self) -> None:
        """Ends a running diagnosis without a result."""
        if self._job is not None:
            self._job.cancel()

    def clear(self) -> None:
        """Forgets the diagnosis, as for other captures."""
        self.cancel()
        self.diagnosis, self.count, self._begun, self.so_far = None, 0, 0, ""

    def _work(self, captures: list[Captures], time_s: float, control: JobControl) -> Diagnosis:
        found = self._run(
            join_captures(captures),
            progress=control.report,
            time_s=time_s,
            is_asked_to_end=lambda: control.is_cancelled,
            so_far=lambda text: self._session.call_on_owner(partial(self._note, control, text)),
        )
        control.check()
        return found

    def _note(self, control: JobControl, text: str) -> None:
        if self._job is not None and self._job.control is control and not control.is_cancelled:
            self.so_far = text

    def _show(self, count: int, found: Diagnosis) -> None:
        self.diagnosis, self.count, self.so_far = found, count, ""


def cause_text(cause: Cause) -> CauseText:
    """A named cause as a panel shows it."""
    intervals = tuple(f"{name} = {format_value(cause.effect, name, own)}" for name, own in cause.intervals.items())
    alike = ", ".join(f"{name} ({share:.2f})" for name, share in cause.confounded_with.items())
    doubts = (f"looks much like {alike}" if alike else "", f"to tell: {cause.separate_by}" if cause.separate_by else "")
    return CauseText(cause.sentence, intervals, tuple(filter(None, doubts)))
