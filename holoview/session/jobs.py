"""Work on threads: progress, pause, cancel. Its end is delivered to the session's owner, an exception as a message."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")
CallOnOwner = Callable[[Callable[[], None]], None]
"""Hands a call to the owner's thread."""


_PATIENCE_S = 10.0


class Cancelled(Exception):
    """Raised inside a job's work where it should end."""


class JobControl:
    """What a job's work reports to and asks."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._go, self._stop = threading.Event(), threading.Event()
        self._go.set()
        self.done, self.total, self.note = 0.0, 0.0, ""
        self.paused_s = 0.0

    def report(self, done: float, total: float, note: str = "") -> None:
        """Says how far the work is; then as `check`."""
        self.done, self.total, self.note = done, total, note
        self._wake()
        self.check()

    def check(self) -> None:
        """Waits while the job is paused. Raises Cancelled when it was cancelled."""
        if not self._go.is_set():
            since = time.monotonic()
            self._go.wait()
            self.paused_s += time.monotonic() - since
        if self._stop.is_set():
            raise Cancelled

    def sleep(self, seconds: float) -> None:
        """Waits, but not once the job was cancelled."""
        self._stop.wait(seconds)
        self.check()

    def pause(self) -> None:
        """The work waits at its next check."""
        self._go.clear()

    def resume(self) -> None:
        """The work goes on."""
        self._go.set()

    def cancel(self) -> None:
        """The work ends at its next check."""
        self._stop.set()
        self._go.set()


class BackgroundJob:
    """A piece of work in the background.

    status: "running", "paused", "done", "cancelled" or "failed"; it changes on the owner's thread once the work ended.
    """

    def __init__(self, title: str, deliver: CallOnOwner, wake: Callable[[], None]) -> None:
        self.title, self.status = title, "running"
        self.error: BaseException | None = None
        self.control = JobControl(wake)
        self._deliver, self._began = deliver, time.monotonic()
        self._ended = threading.Event()

    @property
    def is_active(self) -> bool:
        """Whether it runs or is paused."""
        return self.status in ("running", "paused")

    @property
    def fraction(self) -> float:
        """Share that is done, 0…1."""
        control = self.control
        return min(control.done / control.total, 1.0) if control.total > 0 else 0.0

    @property
    def note(self) -> str:
        """What it says of itself."""
        return self.control.note

    @property
    def seconds_left(self) -> float | None:
        """What is left at the pace so far; None until there is a pace."""
        if not self.is_active or self.fraction <= 0:
            return None
        spent = time.monotonic() - self._began - self.control.paused_s
        return spent * (1 / self.fraction - 1)

    def pause(self) -> None:
        """Holds it at the next opportunity."""
        if self.status == "running":
            self.status = "paused"
            self.control.pause()

    def resume(self) -> None:
        """Lets it go on."""
        if self.status == "paused":
            self.status = "running"
            self.control.resume()

    def cancel(self) -> None:
        """Ends it without a result."""
        self.control.cancel()

    def join(self, timeout_s: float | None = None) -> bool:
        """Waits until the work has ended; its result is delivered at the owner's next poll."""
        return self._ended.wait(timeout_s)

    def start(
        self, work: Callable[[JobControl], T], end: Callable[[str, T | None, BaseException | None], None]
    ) -> None:
        """Runs the work on a thread, then `end(status, result, error)` on the owner's."""

        def run() -> None:
            status, result, error = "done", None, None
            try:
                result = work(self.control)
            except Cancelled:
                status = "cancelled"
            except BaseException as raised:  # whatever it is, the user is told
                status, error = "failed", raised
            self._deliver(lambda: self._finish(status, result, error, end))
            self._ended.set()

        threading.Thread(target=run, name=f"holoview: {self.title}", daemon=True).start()

    def _finish(self, status: str, result: Any, error: BaseException | None, end: Callable[..., None]) -> None:
        self.status, self.error = status, error
        end(status, result, error)


class JobManager:
    """The jobs of a session: those that run, and those that ended a while ago."""

    def __init__(
        self, deliver: CallOnOwner, wake: Callable[[], None], on_error: Callable[[BaseException, str], None]
    ) -> None:
        self._deliver, self._wake, self._failed = deliver, wake, on_error
        self.all: list[BackgroundJob] = []

    @property
    def active(self) -> list[BackgroundJob]:
        """Those that haven't ended, oldest first."""
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
        """Runs `work` on a thread; on the owner's then `ended`, however it ended, and `done` with its result.

        A failure becomes a message. job: what it is shown as; one with the title when None.
        """
        job = job or BackgroundJob(title, self._deliver, self._wake)
        self.all = [*self.active, *[old for old in self.all if not old.is_active][-20:], job]

        def end(status: str, result: T | None, error: BaseException | None) -> None:
            on_end()
            if error is not None:
                self._failed(error, job.title)
            elif status == "done" and on_result is not None:
                on_result(result)  # type: ignore[arg-type]

        job.start(work, end)
        return job

    def cancel_all(self) -> None:
        """Asks all to end."""
        for job in self.active:
            job.cancel()

    def close(self) -> None:
        """Ends all, and waits for a while: a thread that is inside a library when the program ends may abort it."""
        self.cancel_all()
        until = time.monotonic() + _PATIENCE_S
        for job in self.active:
            job.join(max(until - time.monotonic(), 0.0))


def format_job(job: BackgroundJob) -> str:
    """A job in a line: title, share, what it says, and what is left."""
    left = job.seconds_left
    parts = [f"{job.title} {job.fraction:.0%}", job.note, "" if left is None else f"{left:.0f} s left"]
    return ", ".join(part for part in parts if part)
