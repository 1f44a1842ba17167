"""Jobs: progress, pause, cancel, failure; and an optimisation that the view follows."""

from __future__ import annotations

import time
from threading import Event

import pytest

from holoview.holograms.optimise.settings import Settings
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.jobs import BackgroundJob, JobControl, format_job
from holoview.viewer.document.optimisation_job import (
    OptimisationRequest,
    last_optimisation,
    running_optimisation,
    start_optimisation,
    start_quick_optimisation,
    with_superpixels,
)
from holoview.viewer.document.target_builder import TargetSpec
from tests.patience import PATIENCE_S, wait_until

SHORT = OptimisationRequest(Settings(iterations=4), preview_every=1, device="cpu")
ENDLESS = OptimisationRequest(Settings(iterations=100_000), preview_every=1, device="cpu")


def test_a_job_reports_and_its_result_arrives_on_the_owners_thread(session: EditingSession) -> None:
    results: list[int] = []

    def work(control: JobControl) -> int:
        control.report(1, 2, "half way")
        return 42

    job = session.jobs.start("Answer", work, results.append)
    assert job.join(PATIENCE_S) and results == [] and job.is_active, "nothing happens before the owner polls"
    session.poll()
    assert format_job(job) == "Answer 50%, half way"
    assert results == [42] and job.status == "done" and (job.fraction, job.note) == (0.5, "half way")


def test_a_failure_is_told_and_a_users_mistake_reads_as_one(session: EditingSession) -> None:
    def mistake(control: JobControl) -> None:
        raise UserError("file", "is broken")

    def defect(control: JobControl) -> None:
        raise RuntimeError("oops")

    jobs = [session.jobs.start("Open", mistake), session.jobs.start("Save", defect)]
    assert session.wait_until_idle(PATIENCE_S)
    assert [job.status for job in jobs] == ["failed", "failed"]
    texts = sorted((m.text, bool(m.details)) for m in session.messages.all)
    assert texts == [("Open: file: is broken", False), ("Save: RuntimeError: oops", True)]


def test_a_paused_job_waits_and_a_cancelled_one_ends_without_a_result(session: EditingSession) -> None:
    entered, results = Event(), []

    def work(control: JobControl) -> None:
        while True:
            entered.set()
            control.report(1, 10)
            time.sleep(0.001)

    job = session.jobs.start("Long", work, results.append)
    assert entered.wait(PATIENCE_S)
    job.pause()

    def rests() -> bool:
        entered.clear()
        return not entered.wait(0.1)

    wait_until(rests, session.poll)
    assert job.status == "paused"
    job.cancel()
    assert job.join(PATIENCE_S)
    session.poll()
    assert job.status == "cancelled" and results == []


def test_an_optimisation_is_one_edit_that_undo_takes_back(session: EditingSession, target_spec: TargetSpec) -> None:
    session.edit("Target", target_spec=target_spec)
    old = session.drive
    job = start_optimisation(session, SHORT)
    with pytest.raises(UserError, match="one is running"):
        start_optimisation(session, SHORT)
    assert session.wait_until_idle(PATIENCE_S)
    assert job.status == "done" and running_optimisation(session) is None and last_optimisation(session) is job
    assert [reached.iteration for reached in job.progress] == [0, 1, 2, 3, 4]
    assert job.progress[-1].best_psnr_db > job.progress[0].psnr_db
    assert session.drive is not old and "4 iterations" in session.document.origin
    label = session.undo()
    assert label is not None and label.startswith("Optimise") and session.drive is old


def test_the_view_follows_and_cancelling_leaves_the_old_patterns(
    session: EditingSession, target_spec: TargetSpec
) -> None:
    session.edit("Target", target_spec=target_spec)
    job = start_optimisation(session, ENDLESS)
    wait_until(lambda: session.displayed_document.drive is not session.drive, session.poll)
    job.pause()
    session.change("Gap", {"gap": 2e-3})
    assert session.displayed_document.drive is session.drive, (
        "another bench isn't covered by what was found for this one"
    )
    session.undo()
    assert session.displayed_document.drive is not session.drive
    job.cancel()
    wait_until(lambda: not job.is_active, session.poll)
    assert (
        job.status == "cancelled"
        and session.displayed_document.drive is session.drive
        and session.history_position == 1
    )


def _optimise_while_editing(session: EditingSession, target_spec: TargetSpec, changes: dict[str, object]) -> str:
    """Optimises patterns and amplitudes, edits the bench meanwhile, and returns the warning at the end."""
    session.edit("Target", target_spec=target_spec)
    settings = Settings(iterations=100_000, amplitudes_every=1)
    job = start_optimisation(session, OptimisationRequest(settings, preview_every=1, device="cpu"))
    wait_until(lambda: job.latest is not None and job.latest.iteration >= 2, session.poll)
    session.change("Edit", changes)
    job.stop_and_keep()
    wait_until(lambda: not job.is_active, session.poll)
    assert job.status == "done" and "optimised" in session.document.origin
    return next(message.text for message in session.messages.all if message.kind == "warning")


def test_an_edit_of_the_bench_during_an_optimisation_is_kept(session: EditingSession, target_spec: TargetSpec) -> None:
    before = session.system.amplitudes
    told = _optimise_while_editing(session, target_spec, {"gap": 2e-3})
    assert session.system.gap_m == 2e-3 and "the patterns are for the bench as it was before" in told
    assert (session.system.amplitudes != before).any(), "lasers that weren't edited are those of the result"


def test_an_edit_of_the_lasers_during_an_optimisation_is_kept(session: EditingSession, target_spec: TargetSpec) -> None:
    edited = [470e-9, 540e-9, 630e-9]
    _optimise_while_editing(session, target_spec, {"wavelengths": edited})
    assert session.system.wavelengths_m.tolist() == edited
    assert session.system.amplitudes.tolist() == [[1.0, 1.0, 1.0]]


def test_a_result_for_which_the_edited_bench_has_no_pixels_comes_with_its_own(
    session: EditingSession, target_spec: TargetSpec
) -> None:
    old = session.system
    told = _optimise_while_editing(session, target_spec, {"shape": [12, 16]})
    assert session.system.modulators == old.modulators and "undo brings your changes back" in told
    session.undo()
    assert session.system.modulators[0].shape == (12, 16)


def test_keeping_ends_an_optimisation_with_the_best_so_far(session: EditingSession, target_spec: TargetSpec) -> None:
    session.edit("Target", target_spec=target_spec)
    old, job = session.drive, start_optimisation(session, ENDLESS)
    wait_until(lambda: job.latest is not None and job.latest.iteration >= 2, session.poll)
    job.stop_and_keep()
    wait_until(lambda: not job.is_active, session.poll)
    assert job.status == "done" and session.drive is not old


def test_a_scheme_changes_the_bench_with_the_patterns(session: EditingSession, target_spec: TargetSpec) -> None:
    session.edit("Target", target_spec=target_spec)
    start_optimisation(session, OptimisationRequest(Settings(iterations=1), scheme="holochrome-4x2", device="cpu"))
    assert session.wait_until_idle(PATIENCE_S)
    assert session.drive.shape[0] == 2 and len(session.system.wavelengths_m) == 4
    session.undo()
    assert session.drive.shape[0] == 1


def test_optimising_needs_a_target(session: EditingSession) -> None:
    with pytest.raises(UserError, match="there is no target"):
        start_optimisation(session, SHORT)


def test_a_quick_look_moves_large_pixels_and_stays_on_the_bench(
    session: EditingSession, target_spec: TargetSpec
) -> None:
    bench = with_superpixels(session.system, 3)
    assert bench.modulators[0].shape == (8, 11) and bench.modulators[0].pitch_m == pytest.approx(24e-6)
    session.edit("Target", target_spec=target_spec)
    job = start_optimisation(
        session, OptimisationRequest(Settings(iterations=2), superpixel=2, only_plane_m=3e-3, device="cpu")
    )
    assert session.wait_until_idle(PATIENCE_S) and job.status == "done"
    drive = session.drive
    assert drive.shape == session.system.drive_shape
    assert (drive[..., ::2, ::2] == drive[..., 1::2, 1::2]).all()
    assert start_quick_optimisation(session, iterations=1).request.only_plane_m == 4e-3, "the plane that is looked at"
    assert session.wait_until_idle(PATIENCE_S)


def test_jobs_are_listed_in_the_order_of_their_starts_and_old_ended_ones_dropped(
    session: EditingSession, target_spec: TargetSpec
) -> None:
    """The optimisation that was started last stays the last one, whatever is started after it has begun."""
    session.edit("Target", target_spec=target_spec)
    first = start_optimisation(session, SHORT)
    assert session.wait_until_idle(PATIENCE_S) and not first.is_active
    second = start_optimisation(session, ENDLESS)
    third = session.jobs.start("Export", lambda control: control.sleep(PATIENCE_S))
    assert session.jobs.all == [first, second, third] and last_optimisation(session) is second
    second.cancel()
    assert second.join(PATIENCE_S)
    session.poll()
    short = [session.jobs.start(f"Short {number}", lambda control: None) for number in range(30)]
    assert all(job.join(PATIENCE_S) for job in short)
    session.poll()
    last = session.jobs.start("Last", lambda control: None)
    assert session.jobs.all == [third, *short[-20:], last]
    third.cancel()
    assert session.wait_until_idle(PATIENCE_S)


def test_a_job_that_is_cancelled_after_its_last_check_has_no_result(session: EditingSession) -> None:
    results: list[int] = []
    job = session.jobs.start("Answer", lambda control: 42, results.append)
    assert job.join(PATIENCE_S)
    job.cancel()
    session.poll()
    assert job.status == "cancelled" and results == []


def test_a_title_that_names_a_file_can_be_shown() -> None:
    """Half of a surrogate pair stands for a byte that isn't UTF-8; no window draws it."""
    assert BackgroundJob("Open \udcff.png", lambda call: call(), lambda: None).title == r"Open \udcff.png"
