"""The path of the pupil: recorded with its rests, played, undone, saved with the session, read, and exported."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from holoview.holograms.files.pupil_path_file import load_pupil_path, save_pupil_path
from holoview.holograms.view import simulate
from holoview.light.model.focus import PupilPath, system_at
from holoview.util.errors import UserError
from holoview.viewer.document.archive import SessionArchive, SessionData, read_session
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.exports import save_path, save_path_animation, save_path_pictures
from holoview.viewer.document.file_loader import FileLoader
from holoview.viewer.document.focus_edits import PupilMotion, focus_at, move_pupil, plane_of, toggle_eye
from holoview.viewer.render.tone_mapping import tone_map
from tests.document.conftest import small_system
from tests.patience import PATIENCE_S

PATH = PupilPath((0.0, 1.0), (-2e-4, 2e-4), (0.0, 3e-4), (1e-3, 1.5e-3), (0.25, 0.5))


class Clock:
    """Seconds that a test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def watcher() -> Iterator[EditingSession]:
    """A session with an eye."""
    made = EditingSession(small_system(eye={"pupil": "1 mm", "chromatic": False}))
    yield made
    made.close()


def test_a_recording_keeps_each_place_with_its_time_and_rests_between_frames(watcher: EditingSession) -> None:
    clock = Clock()
    motion = PupilMotion(watcher, clock)
    motion.record()
    for time_s, x_m in ((0.02, 0.0), (0.5, 1e-4), (0.52, 2e-4), (0.54, 2e-4)):
        clock.now_s = 100.0 + time_s
        move_pupil(watcher, (0.0, x_m))
        motion.advance()
    assert motion.places_m[-1] == (0.0, 2e-4) and motion.elapsed_s == pytest.approx(0.54)
    clock.now_s = 101.0
    motion.stop()
    path = watcher.view_settings.pupil_path
    assert path is not None and motion.state == ""
    assert path.times_s == (0.0, 0.47, 0.5, 0.52, 1.0), "at rest until just before it moves"
    assert path.x_m == (0.0, 0.0, 1e-4, 2e-4, 2e-4)
    assert path.pupil_m == (1e-3,) * 5
    assert path.accommodation_dpt is not None and path.accommodation_dpt[0] == pytest.approx(1e-3 / 0.04**2)


def test_diameter_and_accommodation_are_recorded_as_well(watcher: EditingSession) -> None:
    clock = Clock()
    motion = PupilMotion(watcher, clock)
    motion.record()
    clock.now_s += 0.05
    watcher.change("Pupil", {"eye.pupil": "auto"})
    focus_at(watcher, plane_of(watcher.system, 0.25))
    motion.advance()
    motion.stop()
    path = watcher.view_settings.pupil_path
    assert path is not None and path.pupil_m is not None and path.accommodation_dpt is not None
    assert path.times_s == (0.0, 0.05)
    assert path.pupil_m[1] == pytest.approx(watcher.system.eye.pupil_diameter_m(watcher.system.field_m), rel=1e-6)  # type: ignore[union-attr]
    assert path.accommodation_dpt[1] == pytest.approx(0.25)


def test_the_pupil_moves_along_its_path_in_one_step_of_undo(watcher: EditingSession) -> None:
    clock = Clock()
    motion = PupilMotion(watcher, clock)
    watcher.edit_view("Path", pupil_path=PATH)
    steps, before = len(watcher.history), watcher.document
    motion.play()
    for time_s in (0.25, 0.5, 0.75, 1.2):
        clock.now_s = 100.0 + time_s
        motion.advance()
        assert watcher.system == system_at(watcher.system, PATH.at(time_s))
        assert watcher.view_settings.plane_m == pytest.approx(3e-3 + 0.04**2 * min(0.25 + 0.25 * time_s, 0.5))
    assert motion.state == "", "at its end"
    assert len(watcher.history) == steps + 1
    watcher.undo()
    assert watcher.system == before.system and watcher.view_settings.pupil_path is PATH


def test_a_place_is_waited_for_until_it_is_seen(watcher: EditingSession) -> None:
    clock = Clock()
    motion = PupilMotion(watcher, clock)
    watcher.edit_view("Path", pupil_path=PATH)
    motion.play()
    clock.now_s += 0.5
    motion.advance(shows_last_edit=False)
    assert watcher.system.eye is not None and watcher.system.eye.pupil_x_m == 0.0
    motion.advance(shows_last_edit=True)
    assert watcher.system.eye.pupil_x_m == pytest.approx(1.5e-4)


def test_a_path_that_the_eye_cannot_follow_ends_with_its_reason(watcher: EditingSession) -> None:
    motion = PupilMotion(watcher, Clock())
    watcher.edit_view("Path", pupil_path=PupilPath((0.0, 1.0), (0.05, 0.05), (0.0, 0.0)))  # 50 mm behind 40 mm
    before = watcher.document
    motion.play()
    with pytest.raises(UserError, match="doesn't reach the pupil"):
        motion.advance()
    assert motion.state == "" and watcher.document is before


def test_without_an_eye_or_a_path_there_is_nothing_to_do(watcher: EditingSession) -> None:
    motion = PupilMotion(watcher)
    with pytest.raises(UserError, match="record one"):
        motion.play()
    motion.record()
    toggle_eye(watcher)
    motion.advance()
    assert motion.state == "" and watcher.view_settings.pupil_path is not None, "what was recorded is kept"
    for begin in (motion.record, motion.play):
        with pytest.raises(UserError, match="switch it on"):
            begin()


def test_a_path_is_saved_once_with_the_session_and_comes_back(watcher: EditingSession, tmp_path: Path) -> None:
    watcher.edit_view("Path", pupil_path=PATH)
    watcher.edit("Pattern", drive=1 - watcher.drive)
    watcher.pin("kept")
    data = SessionData(watcher.history, watcher.history_position, watcher.snapshots)
    SessionArchive(tmp_path).write(data, {})
    assert (tmp_path / "session.json").read_text().count("times_s") == 1
    read, unreadable = read_session(tmp_path)
    assert not unreadable
    assert [step.document.view_settings.pupil_path for step in read.steps] == [None, PATH, PATH]
    assert read.snapshots["kept"].view_settings == watcher.view_settings


def test_a_damaged_path_of_a_saved_session_is_reported(watcher: EditingSession, tmp_path: Path) -> None:
    watcher.edit_view("Path", pupil_path=PATH)
    SessionArchive(tmp_path).write(SessionData(watcher.history, 1, {}), {})
    text = (tmp_path / "session.json").read_text()
    (tmp_path / "session.json").write_text(text.replace('"times_s": [0.0, 1.0]', '"times_s": [0.0, -1.0]'))
    read, unreadable = read_session(tmp_path)
    assert len(read.steps) == 1 and len(unreadable) == 1 and "follows" in unreadable[0]


def test_a_file_that_is_opened_becomes_the_path_and_brings_an_eye(session: EditingSession, tmp_path: Path) -> None:
    loader = FileLoader(session)
    save_pupil_path(tmp_path / "path.csv", PATH)
    loader.open(tmp_path / "path.csv")
    assert session.wait_until_idle(PATIENCE_S)
    assert session.view_settings.pupil_path == PATH and session.system.eye is not None
    assert session.undo() == "Open path.csv" and session.system.eye is None
    (tmp_path / "path.csv").write_text("nothing")
    loader.open(tmp_path / "path.csv")
    assert session.wait_until_idle(PATIENCE_S)
    assert session.messages.all[-1].kind == "error" and "no points" in session.messages.all[-1].text
    loader.close()


@pytest.mark.long
def test_what_is_seen_along_it_is_written(watcher: EditingSession, tmp_path: Path) -> None:
    watcher.edit_view("Path", pupil_path=PATH)
    save_path(watcher, tmp_path / "path")
    assert load_pupil_path(tmp_path / "path.csv") == PATH
    save_path_animation(watcher, tmp_path / "a.png", frames=3)
    save_path_pictures(watcher, tmp_path / "b.png", frames=3)
    assert watcher.wait_until_idle(PATIENCE_S)
    assert [message.kind for message in watcher.messages.all] == ["info"] * 3, watcher.messages.all
    with Image.open(tmp_path / "a.png") as image:
        assert image.n_frames == 3 and image.info["duration"] == pytest.approx(1000 / 3, rel=1e-3)
        animated = []
        for number in range(3):
            image.seek(number)
            animated.append(np.asarray(image.convert("RGB")))
    for number, time_s in enumerate((0.0, 0.5, 1.0)):
        system, state = system_at(watcher.system, PATH.at(time_s)), PATH.at(time_s)
        assert state.accommodation_dpt is not None
        xyz = simulate(system, watcher.drive, [plane_of(system, state.accommodation_dpt)], "torch64").xyz[0]
        known = tone_map(xyz, watcher.view_settings).astype(int)
        written = np.asarray(Image.open(tmp_path / f"b-{number:03}.png")).astype(int)
        assert np.array_equal(animated[number], written)
        assert np.abs(known - written).max() <= 1, "rounding of single precision at the edge of a level"


def test_an_export_can_be_cancelled_and_what_cannot_be_written_is_refused(
    watcher: EditingSession, tmp_path: Path
) -> None:
    for save in (save_path, save_path_animation, save_path_pictures):
        with pytest.raises(UserError, match="there is none"):
            save(watcher, tmp_path / ("a.csv" if save is save_path else "a.png"))
    watcher.edit_view("Path", pupil_path=PATH)
    with pytest.raises(UserError, match="suffix"):
        save_path(watcher, tmp_path / "a.txt")
    with pytest.raises(UserError, match="1 to"):
        save_path_pictures(watcher, tmp_path / "a.png", frames=0)
    job = save_path_animation(watcher, tmp_path / "a.gif", frames=1000)
    job.cancel()
    assert watcher.wait_until_idle(PATIENCE_S) and job.status == "cancelled"
    assert list(tmp_path.iterdir()) == []
