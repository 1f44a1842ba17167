"""A diagnosis that follows the captures as they come: begun after a few, and again with more, in the background."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from holoview.captures.dataset import Captures, join_captures
from holoview.diagnose.intervals import format_value
from holoview.diagnose.pipeline import diagnose
from holoview.diagnose.report.diagnosis import Cause, Diagnosis
from holoview.document.editing_session import EditingSession
from holoview.document.jobs import BackgroundJob, JobControl
from holoview.experiment.known_alignment import diagnosis_options
from holoview.rig.registration import Registration

FIRST, FEW = 4, 3
"""Captures after which the first diagnosis begins; further ones after which, at least, the next one does."""
MOST = 6
"""A diagnosis that begins by itself is of so many captures, spread evenly over all, so that it is quick."""
_GROWTH = 0.5  # of the captures, after which a running diagnosis is worth beginning again
TIME_S = 120.0
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

    time_s: how long a search may take. diagnosis: the last result, None before the first. seen: captures that were
    there when it was begun. so_far: a sentence of the running one, or "". is_on: whether it begins by itself.
    registration: of the rig, if it was aligned; the effects that it knows aren't named as causes.
    """

    def __init__(self, session: EditingSession, run: Diagnose = diagnose) -> None:
        self._session, self._run = session, run
        self.time_s, self.is_on = TIME_S, True
        self.diagnosis: Diagnosis | None = None
        self.seen, self.so_far = 0, ""
        self.registration: Registration | None = None
        self._job: BackgroundJob | None = None
        self._next: tuple[list[Captures], int] | None = None
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
            chosen = np.unique(np.rint(np.linspace(0, count - 1, MOST)).astype(int))
            self._start([captures[k] for k in chosen], count)

    def start(self, captures: Sequence[Captures]) -> None:
        """Diagnoses all these captures, each a session of one, in place of those that are being diagnosed."""
        self._start(list(captures), len(captures))

    def cancel(self) -> None:
        """Ends a running diagnosis without a result."""
        self._next = None
        if self._job is not None:
            self._job.cancel()

    def clear(self) -> None:
        """Forgets the diagnosis, as for other captures."""
        self.cancel()
        self.diagnosis, self.seen, self._begun, self.so_far = None, 0, 0, ""

    def _start(self, captures: list[Captures], seen: int) -> None:
        self.cancel()
        self._begun, self.so_far, self._next = seen, "", (captures, seen)
        self._start_next()

    def _start_next(self) -> None:
        """Starts what is waiting, unless one is still running: it takes a moment to end, and two would take turns."""
        if self._next is None or self.job is not None:
            return
        (captures, seen), self._next = self._next, None
        work, show = partial(self._work, captures, self.time_s), partial(self._show, seen)
        self._job = self._session.jobs.start("Diagnosis", work, show, on_end=self._start_next)

    def _work(self, captures: list[Captures], time_s: float, control: JobControl) -> Diagnosis:
        found = self._run(
            join_captures(captures),
            **diagnosis_options(self.registration),
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

    def _show(self, seen: int, found: Diagnosis) -> None:
        self.diagnosis, self.seen, self.so_far = found, seen, ""


def cause_text(cause: Cause) -> CauseText:
    """A named cause as a panel shows it."""
    intervals = tuple(f"{name} = {format_value(cause.effect, name, own)}" for name, own in cause.intervals.items())
    alike = ", ".join(f"{name} ({share:.2f})" for name, share in cause.confounded_with.items())
    doubts = (f"looks much like {alike}" if alike else "", f"to tell: {cause.separate_by}" if cause.separate_by else "")
    return CauseText(cause.sentence, intervals, tuple(filter(None, doubts)))
