"""A hologram that follows pictures: the target of the session changes with them, until the result is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import holoview as hv
from holoview.holograms.optimise.eyes import OptimisedEyes
from holoview.holograms.optimise.memory import with_compact_grid
from holoview.holograms.optimise.settings import Settings
from holoview.holograms.optimise.solve import follow
from holoview.holograms.targets.picture import read_picture
from holoview.light.model.system import System
from holoview.util.errors import UserError
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.optimisation_job import (
    LiveOptimisationJob,
    OptimisationRequest,
    running_optimisation,
    start_live_optimisation,
    unfinished_optimisation,
)
from holoview.viewer.document.target_builder import TargetSpec
from tests.document.test_chain_edits import chain
from tests.patience import wait_until


def _two() -> System:
    return hv.load("holochrome-8").edit({"shape": [12, 16], "planes": ["10 mm"]})


@pytest.fixture
def session(request: pytest.FixtureRequest) -> EditingSession:
    """A session of the system that a test names, else of two modulators."""
    return EditingSession(getattr(request, "param", _two)())


def _write(folder: Path, name: str, left: int) -> None:
    pixels = np.zeros((24, 32, 3), np.uint8)
    pixels[:, left : left + 16] = 200
    Image.fromarray(pixels).save(folder / f".{name}", format="png")
    (folder / f".{name}").rename(folder / name)  # at once, as a careful program writes


def _request(**changes: object) -> OptimisationRequest:
    return OptimisationRequest(Settings(iterations=20), device="cpu", **changes)  # type: ignore[arg-type]


def _until(session: EditingSession, condition: object) -> None:
    wait_until(condition, meanwhile=session.poll)  # type: ignore[arg-type]


@pytest.mark.parametrize("session", [_two, chain], indirect=True)
def test_the_target_and_the_hologram_follow_a_folder(session: EditingSession, tmp_path: Path) -> None:
    old = session.drive
    _write(tmp_path, "a.png", 0)
    job = start_live_optimisation(session, str(tmp_path), _request())
    assert isinstance(job, LiveOptimisationJob)
    _until(session, lambda: len(job.progress) == 1 and session.displayed_document.drive is not old)
    first = session.target_spec
    assert first is not None
    _write(tmp_path, "b.png", 16)
    _until(session, lambda: len(job.progress) == 2 and session.target_spec is not first)
    assert session.target_spec is not None and session.target_spec.source.source.endswith("b.png")  # type: ignore[union-attr]
    unfinished = unfinished_optimisation(session)
    assert unfinished is not None and unfinished.rest is None
    job.stop_and_keep()
    _until(session, lambda: not job.is_active)
    assert job.status == "done" and session.drive is not old and job.progress_range == (1, 2)
    session.undo()
    session.undo()
    assert session.drive is old and session.target_spec is None, "two edits: the target and the patterns"


def test_a_picture_that_stays_gets_as_many_iterations_as_the_first(session: EditingSession, tmp_path: Path) -> None:
    """Twenty, here as two runs of ten that each begin with the hologram before."""
    _write(tmp_path, "a.png", 0)
    job = start_live_optimisation(session, str(tmp_path), _request())
    _until(session, lambda: len(job.progress) == 1)
    _write(tmp_path, "b.png", 16)
    targets = (TargetSpec(read_picture(tmp_path / name), name) for name in ("a.png", "b.png"))
    first, second = (target.stack_for(session.system) for target in targets)
    states = follow(with_compact_grid(session.system), [first, second, second], job.request.settings)
    _, once, twice = (state.best_psnr_db for state in states if state.iteration == state.iterations)
    assert twice > once + 0.01
    _until(session, lambda: len(job.progress) == 2 and abs(job.progress[1].best_psnr_db - twice) < 0.001)
    job.cancel()
    _until(session, lambda: not job.is_active)


def test_a_cancelled_one_leaves_the_patterns(session: EditingSession, tmp_path: Path) -> None:
    old = session.drive
    _write(tmp_path, "a.png", 0)
    job = start_live_optimisation(session, str(tmp_path), _request())
    _until(session, lambda: job.latest is not None)
    job.cancel()
    _until(session, lambda: not job.is_active)
    assert job.status == "cancelled" and session.drive is old


def test_a_source_that_cannot_be_read_ends_with_its_reason(session: EditingSession, tmp_path: Path) -> None:
    job = start_live_optimisation(session, str(tmp_path), _request())
    _until(session, lambda: not job.is_active)
    assert job.status == "failed" and "has no pictures" in str(job.error)


@pytest.mark.parametrize(
    "request_", [_request(eyes=OptimisedEyes.from_text("3x3:0.5mm", "compensate")), _request(scheme="holochrome-8")]
)
def test_what_it_cannot_follow_is_refused(session: EditingSession, request_: OptimisationRequest) -> None:
    with pytest.raises(UserError, match="live target"):
        start_live_optimisation(session, "nothing", request_)
    assert running_optimisation(session) is None
