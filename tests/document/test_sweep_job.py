"""Sweeps of the viewer's document: the numbers of `holoview sweep`, a curve that grows, points that can be shown."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from holoview.commands.cli import main
from holoview.evidence.sweep.in_viewer import sweep_document
from holoview.evidence.sweep.measures import MEASURES as MEASURED
from holoview.holograms.files.pictures import write_png
from holoview.holograms.hologram import Hologram
from holoview.holograms.targets.picture import read_picture
from holoview.light.model import preset
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.sweep_job import SweepJob, start_sweep
from holoview.viewer.document.sweeper import MEASURES, SweepRequest, SweptCurve, usual_sweeps
from holoview.viewer.document.target_builder import TargetSpec


def small() -> System:
    return preset.load("simultaneous").with_(shape=[24, 32], planes=["9 mm", "10 mm"])


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    path = tmp_path / "target.png"
    values = np.random.default_rng(0).integers(60, 200, (6, 8, 3)).astype(np.uint8)
    write_png(path, np.kron(values, np.ones((8, 8, 1), np.uint8)), {})
    return path


@pytest.fixture
def session(picture: Path) -> EditingSession:
    made = EditingSession(small(), target_spec=TargetSpec(read_picture(picture), "target"))
    made.sweeper = sweep_document
    return made


def run(session: EditingSession, request: SweepRequest) -> SweepJob:
    job = start_sweep(session, request)
    assert session.wait_until_idle()
    return job


@pytest.mark.parametrize("measure", ["psnr", "contrast", "contrast beside a target"])
def test_the_numbers_are_those_of_the_command(
    session: EditingSession, picture: Path, measure: str, tmp_path: Path
) -> None:
    """Random patterns don't show the target, beside which their contrast is withheld."""
    measured, _, beside = measure.partition(" ")
    has_target = measured == "psnr" or bool(beside)
    if not has_target:
        session = EditingSession(session.system, session.drive)
        session.sweeper = sweep_document
    Hologram(session.drive, session.system).save(tmp_path / "h.safetensors")
    curve = run(session, SweepRequest("gap=1mm:3mm:3", measured)).curve
    command = ("sweep", tmp_path / "h.safetensors", "--set", "gap=1mm:3mm:3", "--measure", measured)
    command = (*command, *(("--target", picture) if has_target else ()), "-o", tmp_path / "found.csv")
    assert main([str(word) for word in command]) == 0
    rows = list(csv.DictReader(io.StringIO((tmp_path / "found.csv").read_text(encoding="utf-8"))))
    assert curve is not None and curve.heading == "gap (mm)"
    assert [point.value for point in curve.points] == [float(row["gap (mm)"]) for row in rows] == [1, 2, 3]
    column = next(name for name in rows[0] if name.partition(" ")[0] == measured)
    expected = [float(row[column]) for row in rows]
    assert [p.measured for p in curve.points] == pytest.approx(expected, rel=1e-9, nan_ok=bool(beside))
    assert np.isnan(expected).all() == bool(beside)
    if measure == "contrast":
        assert all(point.error > 0 for point in curve.points)


def test_what_the_panel_offers_can_be_measured_and_swept(session: EditingSession) -> None:
    assert MEASURES.keys() <= MEASURED.keys()
    assert {name: MEASURED[name].title for name in MEASURES} == MEASURES
    system = small().edit({"relay2.iris_na": 0.05, "effects.gap.gap_error": 1e-4, "effects.stroke.stroke_error": 0.1})
    session.edit("effects", system=system)
    offered = usual_sweeps(system)
    assert [text.partition("=")[0] for text in offered] == [
        "gap", "relay2.iris_na", "effects.gap.gap_error", "effects.stroke.stroke_error"
    ]  # fmt: skip
    for text in offered:
        assert run(session, SweepRequest(text, "light")).curve is not None, text


def test_a_point_is_shown_as_one_step_of_undo(session: EditingSession) -> None:
    before = session.document
    job = run(session, SweepRequest("gap=1mm,3mm", "light"))
    assert session.document is before  # a sweep changes nothing
    assert job.curve is not None
    for point in job.curve.points:
        job.show(session, point)
        assert session.system.gap_m == pytest.approx(point.value * 1e-3, rel=1e-12)
        assert np.array_equal(session.drive, before.drive)
    session.undo()
    assert session.system == before.system and session.drive is before.drive


def test_patterns_that_are_found_anew_come_with_their_point(session: EditingSession) -> None:
    job = run(session, SweepRequest("gap=1mm,3mm", "psnr", iterations=2))
    assert job.curve is not None and len(job.curve.points) == 2
    for point in job.curve.points:
        assert point.drive is not None and not np.array_equal(point.drive, session.drive)
    job.show(session, job.curve.points[1])
    assert np.array_equal(session.drive, job.curve.points[1].drive)


def test_a_cancelled_sweep_keeps_its_points(session: EditingSession) -> None:
    jobs: list[SweepJob] = []

    def sweeper(document: object, request: object, report: Callable[..., None], show: Callable[..., None]) -> None:
        def show_and_cancel(curve: SweptCurve) -> None:
            show(curve)
            if len(curve.points) == 2:
                jobs[0].cancel()

        sweep_document(document, request, report, show_and_cancel)  # type: ignore[arg-type]

    session.sweeper = sweeper
    jobs.append(start_sweep(session, SweepRequest("gap=1mm:3mm:5", "light")))
    assert session.wait_until_idle()
    assert jobs[0].status == "cancelled"
    assert jobs[0].curve is not None and [point.value for point in jobs[0].curve.points] == [1.0, 1.5]


@pytest.mark.parametrize(
    ("values", "measure", "words"),
    [
        ("gap=1mm", "light", "has no values"),
        ("gip=1mm,2mm", "light", "gap"),
        ("gap=-1mm,2mm", "light", "gap"),
        ("shape=[24,32],[32,32]", "light", "has no values"),
        ("frames=1,2", "light", "patterns of shape"),
    ],
)
def test_a_mistake_is_one_sentence(values: str, measure: str, words: str, session: EditingSession) -> None:
    job = run(session, SweepRequest(values, measure))
    assert job.status == "failed" and isinstance(job.error, UserError)
    assert words in session.messages.all[-1].text
    assert job.curve is None


def test_without_a_target_only_what_compares_is_refused() -> None:
    session = EditingSession(small())
    session.sweeper = sweep_document
    assert run(session, SweepRequest("gap=1mm,2mm", "contrast")).curve is not None
    assert run(session, SweepRequest("gap=1mm,2mm", "psnr")).status == "failed"
    assert run(session, SweepRequest("gap=1mm,2mm", "contrast", iterations=2)).status == "failed"
    session.sweeper = None
    with pytest.raises(UserError, match="holoview view"):
        start_sweep(session, SweepRequest("gap=1mm,2mm", "contrast"))
