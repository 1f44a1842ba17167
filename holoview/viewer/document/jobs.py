"""Background jobs with progress, pause and cancellation; results are delivered to the thread that owns the session."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from holoview.util.processes import last_work_s
from holoview.util.text import printable

T = TypeVar("T")
CallOnOwner = Callable[[Callable[[], None]], None]
"""Has the owner's thread make a call."""

_MAX_ENDED_JOBS = 20


class Cancelled(Exception):
    """Raised inside the work of a job that was cancelled."""


class JobControl:
    """The interface between a job and the work it runs: progress in one direction, pause and cancel in the other.

    done, total: progress in any unit; total is 0 while it is unknown. paused_s: the time spent paused so far. noted_s:
    when the present note was first reported.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._may_run, self._is_cancelled = threading.Event(), threading.Event()
        self._may_run.set()
        self.done, self.total, self.note = 0.0, 0.0, ""
        self.paused_s, self.noted_s = 0.0, time.monotonic()

    def report(self, done: float, total: float, note: str = "") -> None:
        """Reports progress, then does as `check`."""
        shown = self._shown
        if note != self.note:
            self.noted_s = time.monotonic()
        self.done, self.total, self.note = done, total, note
        if self._shown != shown:  # a window in software takes longer to draw than many a step
            self._wake()
        self.check()

    @property
    def _shown(self) -> tuple[int, str]:
        """The part of the progress that a window shows."""
        return int(100 * self.done / self.total) if self.total > 0 else 0, self.note

    def check(self) -> None:
        """Waits while the job is paused. Raises Cancelled once it was cancelled."""
        if not self._may_run.is_set():
            since = time.monotonic()
            self._may_run.wait()
            self.paused_s += time.monotonic() - since
        if self._is_cancelled.is_set():
            raise Cancelled

    @property
    def is_cancelled(self) -> bool:
        """Whether the job was cancelled."""
        return self._is_cancelled.is_set()

    def sleep(self, seconds: float) -> None:
        """Waits for some time, or until the job is cancelled. Raises Cancelled then."""
        self._is_cancelled.wait(seconds)
        self.check()

    def pause(self) -> None:
        """Makes the work wait at its next check."""
        self._may_run.clear()

    def resume(self) -> None:
        """Lets paused work continue."""
        self._may_run.set()

    def cancel(self) -> None:
        """Makes the work end at its next check."""
        self._is_cancelled.set()
        self._may_run.set()


class BackgroundJob:
    """Work that runs on a thread.

    status: "running", "paused", "done", "cancelled" or "failed"; changed on the owner's thread only. error: the
    exception of a job that failed.
    """

    def __init__(self, title: str, deliver: CallOnOwner, wake: Callable[[], None]) -> None:
        self.title, self.status = printable(title), "running"  # which may name a file
        self.error: BaseException | None = None
        self.control = JobControl(wake)
        self._deliver, self._start_s = deliver, time.monotonic()
        self._ended = threading.Event()

    @property
    def is_active(self) -> bool:
        """Whether the job is running or paused."""
        return self.status in ("running", "paused")

    @property
    def fraction(self) -> float:
        """The fraction that is done, 0…1."""
        control = self.control
        return min(control.done / control.total, 1.0) if control.total > 0 else 0.0

    @property
    def note(self) -> str:
        """The last report of the work, in words."""
        return self.control.note

    @property
    def step(self) -> str:
        """What the work does now, and for how many seconds it has done so."""
        return f"{self.note or 'beginning'} … {time.monotonic() - self.control.noted_s:.0f} s"

    @property
    def seconds_left(self) -> float | None:
        """The time left, extrapolated from the progress so far; None before there is any."""
        if not self.is_active or self.fraction <= 0:
            return None
        spent = time.monotonic() - self._start_s - self.control.paused_s
        return spent * (1 / self.fraction - 1)

    def pause(self) -> None:
        """Pauses the work at its next check."""
        if self.status == "running":
            self.status = "paused"
            self.control.pause()

    def resume(self) -> None:
        """Continues paused work."""
        if self.status == "paused":
            self.status = "running"
            self.control.resume()

    def cancel(self) -> None:
        """Ends the work at its next check, without a result."""
        self.control.cancel()

    def join(self, timeout_s: float | None = None) -> bool:
        """Waits until the work has ended; returns False after the timeout. The result is delivered at the next poll."""
        return self._ended.wait(timeout_s)

    def start(
        self, work: Callable[[JobControl], T], end: Callable[[str, T | None, BaseException | None], None]
    ) -> None:
        """Runs the work on a thread, then calls `end(status, result, error)` on the owner's."""

        def run() -> None:
            status, result, error = "done", None, None
            try:
                result = work(self.control)
            except Cancelled:
                status = "cancelled"
            except BaseException as raised:  # reported to the user whatever it is, as nobody else can
                status, error = "failed", raised
            self._deliver(lambda: self._finish(status, result, error, end))
            self._ended.set()

        threading.Thread(target=run, name=f"holoview: {self.title}", daemon=True).start()

    def _finish(self, status: str, result: Any, error: BaseException | None, end: Callable[..., None]) -> None:
        if status == "done" and self.control.is_cancelled:  # after its last check
            status = "cancelled"
        self.status, self.error = status, error
        end(status, result, error)


class JobManager:
    """The jobs of a session.

    all: all active jobs, and the last that ended, in the order in which they were started.
    """

    def __init__(
        self, deliver: CallOnOwner, wake: Callable[[], None], on_error: Callable[[BaseException, str], None]
    ) -> None:
        self._deliver, self._wake, self._on_error = deliver, wake, on_error
        self.all: list[BackgroundJob] = []

    @property
    def active(self) -> list[BackgroundJob]:
        """The jobs that haven't ended, oldest first."""
        return [job for job in self.all if job.is_active]

    def start(
        self,
        title: str,
        work: Callable[[JobControl], T],
        on_result: Callable[[T], None] | None = None,
        *,
        on_end: Callable[[], None] = lambda: None,
        job: BackgroundJob | None = None,
    ) -> BackgroundJob:
        """Runs `work` on a thread, then on the owner's `on_end`, however it ended, and `on_result` with its result.

        An exception becomes a message. job: the job to start; a new one with the title when None.
        """
        job = job or BackgroundJob(title, self._deliver, self._wake)
        ended = [old for old in self.all if not old.is_active]
        self.all = [*[old for old in self.all if old not in ended[:-_MAX_ENDED_JOBS]], job]

        def end(status: str, result: T | None, error: BaseException | None) -> None:
            on_end()
            if error is not None:
                self._on_error(error, job.title)
            elif status == "done" and on_result is not None:
                on_result(result)  # type: ignore[arg-type]

        job.start(work, end)
        return job

    def cancel_all(self) -> None:
        """Cancels all active jobs."""
        for job in self.active:
            job.cancel()

    def close(self) -> None:
        """Cancels all jobs and waits a little: a thread inside a native library may abort an exiting process."""
        self.cancel_all()
        until = time.monotonic() + last_work_s()
        for job in self.active:
            job.join(max(until - time.monotonic(), 0.0))


def format_job(job: BackgroundJob) -> str:
    """A job in a line: title, percentage where its end is known, its note, and the time left."""
    left, title = job.seconds_left, job.title if job.control.total <= 0 else f"{job.title} {job.fraction:.0%}"
    parts = [title, job.note, "" if left is None else f"{left:.0f} s left"]
    return ", ".join(part for part in parts if part)
