"""The contrast on the retina against the pupil: measured on what is seen, kept while the document stays, cancelled."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from holoview.holograms.metrics.retinal import retinal_contrast
from holoview.holograms.view import simulate
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.focus_edits import move_pupil, toggle_eye
from holoview.viewer.document.measurements import measure_image
from holoview.viewer.document.optimisation_job import RetinalCurves
from holoview.viewer.document.target_builder import TargetSpec
from tests.document.conftest import small_system
from tests.patience import PATIENCE_S

PUPILS_M = (1e-3, 2e-3)


@pytest.fixture
def watcher(target_spec: TargetSpec) -> Iterator[EditingSession]:
    """A session with an eye and a target."""
    made = EditingSession(small_system(eye={}), target_spec=target_spec)
    yield made
    made.close()


@pytest.mark.long
def test_each_contrast_is_that_of_what_is_seen_through_its_pupil(watcher: EditingSession) -> None:
    curves = RetinalCurves(watcher)
    job = curves.start(PUPILS_M)
    assert curves.curve is None and curves.job is job
    assert watcher.wait_until_idle(PATIENCE_S) and job.status == "done", watcher.messages.all
    curve = curves.curve
    assert curve is not None and curves.job is None
    plane_m, region = watcher.view_settings.plane_m, watcher.document.measured_region
    for found, pupil_m in zip(curve.contrasts, PUPILS_M, strict=True):
        system = watcher.system.edit({"eye.pupil": pupil_m})
        luminance = simulate(system, watcher.drive, [plane_m], "torch64").xyz[0, ..., 1]
        assert watcher.target_spec is not None
        target = watcher.target_spec.build(system, np.array([plane_m])).stack[0]
        known = retinal_contrast(system, luminance, region, target)
        assert found.pupil_m == pupil_m
        assert known.withheld and found.contrast is None and found.cone_contrast is None  # random patterns
        assert found.withheld.split(":")[0] == known.withheld.split(":")[0] == curve.withheld.split(":")[0]
    watcher.edit("Target", target_spec=None)
    curves.start(PUPILS_M)
    assert watcher.wait_until_idle(PATIENCE_S) and curves.curve is not None and not curves.curve.withheld
    for found, pupil_m in zip(curves.curve.contrasts, PUPILS_M, strict=True):
        system = watcher.system.edit({"eye.pupil": pupil_m})
        raw = retinal_contrast(system, simulate(system, watcher.drive, [plane_m], "torch64").xyz[0, ..., 1], region)
        assert [found.contrast, found.cone_contrast] == pytest.approx([raw.contrast, raw.cone_contrast], rel=1e-4)


def test_it_is_kept_while_the_pupil_only_widens_and_forgotten_when_the_picture_changes(
    watcher: EditingSession,
) -> None:
    curves = RetinalCurves(watcher)
    curves.start(PUPILS_M)
    assert watcher.wait_until_idle(PATIENCE_S)
    watcher.change("Pupil", {"eye.pupil": 4e-3})
    watcher.edit_view("Exposure", exposure_stops=1.0)
    assert curves.curve is not None
    for edit in (
        lambda: move_pupil(watcher, (0.0, 1e-3)),
        lambda: watcher.edit_view("Plane", plane_m=3.5e-3),
        lambda: watcher.edit_view("Region", region=(0, 0, 20, 20)),
        lambda: watcher.edit("Target", target_spec=None),
        lambda: watcher.edit("Drive", drive=1 - watcher.drive),
        lambda: toggle_eye(watcher),
    ):
        position = watcher.history_position
        edit()
        assert curves.curve is None
        watcher.undo() if watcher.history_position > position else watcher.look_back()
        assert curves.curve is not None


def test_a_job_of_a_document_that_has_changed_is_cancelled(watcher: EditingSession) -> None:
    curves = RetinalCurves(watcher)
    job = curves.start(PUPILS_M * 10)
    move_pupil(watcher, (0.0, 1e-3))
    assert curves.job is None
    assert watcher.wait_until_idle(PATIENCE_S) and job.status == "cancelled" and curves.curve is None
    again = curves.start(PUPILS_M)
    assert watcher.wait_until_idle(PATIENCE_S) and again.status == "done" and curves.curve is not None


def test_without_an_eye_there_is_no_retina(session: EditingSession) -> None:
    with pytest.raises(UserError, match="no eye"):
        RetinalCurves(session).start()
    assert RetinalCurves(session).curve is None
    xyz = np.random.default_rng(0).random((48, 64, 3))
    assert measure_image(session.document, xyz).retinal is None
    toggle_eye(session)
    found = measure_image(session.document, xyz)
    assert found.retinal is not None and found.region is not None
    assert found.retinal.contrast == found.region.contrast
