"""A session survives its program: killed at any moment, all of it is offered again at the next start."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil
import pytest

import tests.document.conftest as bench
from holoview.util.errors import UserError
from holoview.util.file_writer import WriteError
from holoview.viewer.document.archive import SessionArchive, SessionData
from holoview.viewer.document.editing_session import EditingSession
from holoview.viewer.document.session_store import Preferences, SavedSession, SessionStore
from holoview.viewer.document.target_builder import TargetSpec
from holoview.viewer.render.view_settings import TARGET, ComparisonSide, ViewSettings
from tests.file_limits import limit_of_file_size
from tests.patience import PATIENCE_S, wait_until

_PROGRAM = """
import sys, time
from pathlib import Path
from holoview.viewer.document.session_store import SessionStore
from holoview.viewer.document.file_loader import target_from_pixels
from holoview.viewer.document.editing_session import EditingSession
from tests.document.conftest import small_system
import numpy as np
session = EditingSession(small_system(), seed=7)
np.save(sys.argv[1] + "/drive.npy", session.drive)
autosave = SessionStore(Path(sys.argv[1])).start_autosave(session)
session.edit("Target", target_spec=target_from_pixels(np.full((4, 4, 3), 90, np.uint8)))
session.pin("before")
for n in range(1, 6):
    session.change("Gap", {"gap": n * 1e-3 + 1e-3})
session.undo()
assert autosave.flush()
print("saved", flush=True)
n = 0
while True:  # goes on editing until it is killed, so that the kill falls into a save
    n += 1
    session.edit_view("Wipe", wipe=(n % 100) / 100, merge_key="wipe")
    session.edit("Pattern", drive=np.full(session.drive.shape, (n % 7) / 7, np.float32))
    time.sleep(0.1)  # history keeps a limited number of steps: its beginning must not have gone when a save comes
"""


@pytest.mark.long
def test_a_killed_program_loses_nothing(tmp_path: Path) -> None:
    store = SessionStore(tmp_path)
    program = subprocess.Popen([sys.executable, "-c", _PROGRAM, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None and program.stdout.readline() == "saved\n"
    assert store.crashed_sessions() == [], "its owner is still alive"
    _wait_for_a_later_save(tmp_path)
    os.kill(program.pid, signal.SIGKILL)
    assert program.wait(PATIENCE_S) == -signal.SIGKILL
    program.stdout.close()
    (saved,) = store.crashed_sessions()
    session = saved.restore()
    labels = [step.label for step in session.history]
    assert labels[:7] == ["Start", "Target", "Gap", "Gap", "Gap", "Gap", "Pattern"]
    assert session.messages.all == () and list(session.snapshots) == ["before"]
    session.go_to_step(5)
    assert session.system.gap_m == 5e-3 and session.target_spec is not None
    assert np.array_equal(session.drive, np.load(tmp_path / "drive.npy"))
    assert session.snapshots["before"].drive is session.drive, "steps share their patterns as before"
    store.discard(saved)
    assert store.crashed_sessions() == []


def test_a_clock_that_is_set_takes_no_session_from_its_owner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that jumps changes when processes seem to have begun, and the dates of what is saved."""
    store, session = SessionStore(tmp_path), EditingSession(bench.small_system())
    autosave = store.start_autosave(session)
    session.change("Gap", {"gap": 2e-3})
    assert autosave.flush()
    for jump_s in (7200.0, -7200.0):
        present, started = time.time(), psutil.Process().create_time()
        with monkeypatch.context() as clock:
            clock.setattr(time, "time", lambda now=present + jump_s: now)
            clock.setattr(psutil.Process, "create_time", lambda self, began=started + jump_s: began)
            assert store.crashed_sessions() == [], "its owner is still alive"
            session.change("Gap", {"gap": 2e-3 + 1e-7 * jump_s / 7200})
            assert autosave.flush()
            assert len(store.saved_sessions()) == 1 and len(store.saved_sessions()[0].restore().history) >= 2
    assert autosave.close() is None
    session.close()
    assert store.last_session() is not None


def _wait_for_a_later_save(folder: Path) -> None:
    (path,) = folder.glob("sessions/*/session.json")
    first = path.stat().st_mtime_ns
    wait_until(lambda: path.stat().st_mtime_ns != first)


def test_looks_come_back_with_a_session(tmp_path: Path) -> None:
    session = EditingSession(bench.small_system())
    session.edit_view("Exposure", exposure_stops=1.0)
    session.edit_view("Page", page="phase")
    session.look_back()
    data = SessionData(session.history, 0, {}, looks=session.looks)
    SessionArchive(tmp_path).write(data, {"title": "", "when": 0.0})
    again = SavedSession(tmp_path, "", 0.0, 1).restore()
    assert again.view_settings == session.view_settings and again.messages.all == ()
    assert again.look_forward() == "Page" and again.view_settings.page == "phase"
    assert (again.look_back(), again.look_back(), again.look_back()) == ("Page", "Exposure", None)
    text = (tmp_path / "session.json").read_text()
    (tmp_path / "session.json").write_text(text.replace('"label": "Page"', '"label": 3'))
    damaged = SavedSession(tmp_path, "", 0.0, 1).restore()
    assert "earlier looks" in damaged.messages.all[0].text and not damaged.can_look_back


def test_closing_in_good_order_leaves_the_last_session_only(tmp_path: Path, target_spec: TargetSpec) -> None:
    store = SessionStore(tmp_path)
    for name in ("first", "second"):
        session = EditingSession(bench.small_system(name=name))
        autosave = store.start_autosave(session)
        session.edit("Target", target_spec=target_spec)
        autosave.close()
    last = store.last_session()
    assert last is not None and "second" in last.title and store.crashed_sessions() == []
    assert len(list((tmp_path / "sessions").iterdir())) == 1
    unedited = store.start_autosave(EditingSession(bench.small_system()))
    unedited.close()
    assert store.last_session() == last, "looking without an edit doesn't replace it"


def test_the_look_and_its_sides_come_back(tmp_path: Path, session: EditingSession) -> None:
    look = ViewSettings(
        plane_m=3.3e-3,
        muted=frozenset({2}),
        a=ComparisonSide("preset", "simultaneous"),
        b=TARGET,
        region=(1, 2, 3, 4),
        profile=(0.0, 1.0, 2.5, 3.0),
        score="flip",
        centre=(0.25, 0.75),
    )
    session.edit("Look", view_settings=look)
    store = SessionStore(tmp_path)
    autosave = store.start_autosave(session)
    autosave.close()
    last = store.last_session()
    assert last is not None and last.restore().view_settings == look


def test_what_is_damaged_is_left_out_and_told(tmp_path: Path, session: EditingSession) -> None:
    store = SessionStore(tmp_path)
    autosave = store.start_autosave(session)
    session.edit("Pattern", drive=np.zeros(session.drive.shape, np.float32))
    session.change("Gap", {"gap": 2e-3})
    assert autosave.flush()
    folder = autosave.folder
    table = json.loads((folder / "session.json").read_text())
    (folder / "objects" / f"{table['steps'][0]['drive']}.safetensors").write_bytes(b"damaged")
    saved = next(saved for saved in store.saved_sessions() if saved.folder == folder)
    restored = saved.restore()
    assert [step.label for step in restored.history] == ["Pattern", "Gap"] and restored.system.gap_m == 2e-3
    (message,) = restored.messages.all
    assert message.kind == "warning" and "Start" in message.text
    (folder / "session.json").write_text("{")
    with pytest.raises(UserError):
        saved.restore()
    assert store.crashed_sessions() == []
    autosave.close()


def test_an_open_session_becomes_the_saved_one_and_its_listeners_stay(tmp_path: Path, session: EditingSession) -> None:
    store = SessionStore(tmp_path)
    autosave = store.start_autosave(session)
    session.change("Gap", {"gap": 2e-3})
    session.pin("mine")
    autosave.close()
    other, heard = EditingSession(bench.small_system(), seed=9), []
    other.add_listener(lambda change: heard.append(change.kinds))
    last = store.last_session()
    assert last is not None
    last.restore_into(other)
    assert other.system.gap_m == 2e-3 and other.undo() == "Gap" and list(other.snapshots) == ["mine"]
    assert {"system", "drive", "look", "target", "snapshots", "history"} <= heard[0]


def test_what_an_optimisation_had_found_is_pinned_after_a_crash(tmp_path: Path, session: EditingSession) -> None:
    autosave = SessionStore(tmp_path).start_autosave(session)
    found = session.document.with_changes({"drive": np.zeros(session.drive.shape, np.float32), "origin": "half way"})
    session.set_preview(session.document, found)
    assert autosave.flush()
    (saved,) = [saved for saved in SessionStore(tmp_path).saved_sessions() if saved.folder == autosave.folder]
    pinned = saved.restore().snapshots["Unfinished optimisation"]
    assert pinned.origin == "half way" and pinned.drive.max() == 0
    autosave.close()


def test_only_what_is_referred_to_stays_on_the_disk(tmp_path: Path, session: EditingSession) -> None:
    store = SessionStore(tmp_path)
    autosave = store.start_autosave(session)
    session.edit("Pattern", drive=np.zeros(session.drive.shape, np.float32))
    assert autosave.flush()
    session.undo()
    session.change("Gap", {"gap": 2e-3})
    assert autosave.flush()
    assert len(list((autosave.folder / "objects").iterdir())) == 1
    autosave.close()


def test_a_full_disk_is_told_once_and_all_is_saved_when_there_is_space(
    tmp_path: Path, session: EditingSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("holoview.viewer.document.session_store.RETRY_S", 0.02)
    autosave = SessionStore(tmp_path).start_autosave(session)
    assert autosave.flush()
    with limit_of_file_size(600):  # a smaller file, such as a lock, can still be written
        for gap in (2e-3, 3e-3):
            session.change("Gap", {"gap": gap})
            session.end_gesture()
            assert not autosave.flush()
        session.poll()
        (message,) = session.messages.all
        assert message.kind == "error" and message.text.startswith("autosave: your work isn't saved")
        assert "can't be written: File too large; free" in message.text and "can't be written" in session.save_problem
    wait_until(lambda: autosave.flush(0.1))  # by itself, without an edit
    session.poll()
    assert session.messages.all[-1].text == "autosave: your work is saved again" and session.save_problem == ""
    (saved,) = SessionStore(tmp_path).saved_sessions()
    assert [step.document.system.gap_m for step in saved.restore().history] == [
        session.history[0].document.system.gap_m,
        2e-3,
        3e-3,
    ]
    assert autosave.close() is None


def test_whatever_fails_the_autosave_goes_on(
    tmp_path: Path, session: EditingSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("holoview.viewer.document.session_store.RETRY_S", 0.02)
    autosave = SessionStore(tmp_path).start_autosave(session)

    def fail(*_: object) -> None:
        raise RuntimeError("a library's own error")

    monkeypatch.setattr(SessionArchive, "write", fail)
    session.change("Gap", {"gap": 2e-3})
    assert not autosave.flush()
    session.poll()
    assert "RuntimeError: a library's own error" in session.messages.all[0].text and session.messages.all[0].details
    monkeypatch.undo()
    wait_until(lambda: autosave.flush(0.1))
    assert autosave.close() is None


def test_a_session_that_can_t_be_saved_at_the_end_says_so_and_keeps_what_was_saved(
    tmp_path: Path, session: EditingSession
) -> None:
    store = SessionStore(tmp_path)
    autosave = store.start_autosave(session)
    session.change("Gap", {"gap": 2e-3})
    assert autosave.flush()
    session.change("Gap", {"gap": 3e-3})
    with limit_of_file_size(600):
        failure = autosave.close()
    assert isinstance(failure, WriteError)
    (saved,) = store.saved_sessions()
    assert saved.restore().system.gap_m == 2e-3 and store.last_session() is None, "as after a crash"


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_state_folder_that_is_read_only_is_told_and_saved_to_once_it_isn_t(
    tmp_path: Path, session: EditingSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    _assert_saved_once_possible(
        tmp_path, session, monkeypatch, lambda: tmp_path.chmod(0o500), lambda: tmp_path.chmod(0o700)
    )


def test_a_state_folder_that_can_t_be_made_is_told_and_saved_to_once_it_can(
    tmp_path: Path, session: EditingSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_the_way = tmp_path / "sessions"
    _assert_saved_once_possible(tmp_path, session, monkeypatch, in_the_way.touch, in_the_way.unlink)


def _assert_saved_once_possible(
    folder: Path,
    session: EditingSession,
    monkeypatch: pytest.MonkeyPatch,
    forbid: Callable[[], None],
    allow: Callable[[], None],
) -> None:
    monkeypatch.setattr("holoview.viewer.document.session_store.RETRY_S", 0.02)
    forbid()
    autosave = SessionStore(folder).start_autosave(session)
    session.change("Gap", {"gap": 2e-3})
    assert not autosave.flush()
    session.poll()
    assert session.save_problem and SessionStore(folder).saved_sessions() == []
    allow()
    wait_until(lambda: autosave.flush(0.1))
    assert autosave.close() is None
    last = SessionStore(folder).last_session()
    assert last is not None and last.restore().system.gap_m == 2e-3


def test_two_viewers_keep_each_others_preferences(tmp_path: Path) -> None:
    path = tmp_path / "preferences.json"
    one, other = Preferences(path), Preferences(path)
    one.set("theme", "Light")
    one.add_recent_file(tmp_path / "one.png")
    other.set("text_size", 1.5)
    other.add_recent_file(tmp_path / "other.png")
    assert other.get("theme", "Dark") == "Dark"  # as it looks
    both = Preferences(path)
    assert both.get("theme", "") == "Light" and both.get("text_size", 1.0) == 1.5
    assert both.get("recent", [""]) == [str(tmp_path.resolve() / name) for name in ("other.png", "one.png")]


def test_preferences_are_kept_and_damaged_ones_begun_anew(tmp_path: Path) -> None:
    path = tmp_path / "preferences.json"
    Preferences(path).set("theme", "light")
    assert Preferences(path).get("theme", "") == "light" and Preferences(path).get("layout", "x") == "x"
    path.write_text("{{{")
    damaged = Preferences(path)
    assert damaged.get("theme", "") == "" and "preferences.json.damaged" in damaged.problem
    assert [p.name for p in tmp_path.iterdir()] == ["preferences.json.damaged"]
    assert (tmp_path / "preferences.json.damaged").read_text() == "{{{"
    assert Preferences(path).problem == ""


def test_preferences_that_cant_be_kept_hold_for_the_process(tmp_path: Path) -> None:
    (tmp_path / "home").touch()
    preferences = Preferences(tmp_path / "home" / "state" / "preferences.json")
    with pytest.raises(UserError, match="state: can't be made"):
        preferences.set("theme", "light")
    assert preferences.get("theme", "") == "light"


def test_recent_files_are_newest_first_and_those_that_are_there(tmp_path: Path) -> None:
    preferences = Preferences(tmp_path / "preferences.json")
    files = [tmp_path / name for name in ("a", "b", "c")]
    for file in files:
        file.touch()
        preferences.add_recent_file(file)
    preferences.add_recent_file(files[0])
    files[2].unlink()
    assert Preferences(tmp_path / "preferences.json").recent_files == (files[0], files[1])


def test_an_hour_of_edits_doesnt_fill_the_memory_of_the_archive(tmp_path: Path) -> None:
    """Systems and patterns that no step of the history refers to any more are forgotten, on the disk and here."""
    archive, session = SessionArchive(tmp_path), EditingSession(bench.small_system())
    for n in range(20):
        system = session.system.edit({"gap": 1e-3 + n * 1e-5})
        session.edit("Gap", undoable=False, system=system, drive=np.full(session.drive.shape, n / 20, np.float32))
        archive.write(SessionData(session.history, session.history_position, {}), {})
    assert len(list(tmp_path.glob("objects/*"))) == 1
    assert len(archive._systems) == 1 and len(archive._names) == 1


def test_further_windows_on_a_file_are_counted_until_it_is_closed(tmp_path: Path) -> None:
    """Only windows of other programs that began before, that still run, and that show the same."""
    command = [sys.executable, "-c", _PROGRAM, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None and program.stdout.readline() == "saved\n"
        os.kill(program.pid, signal.SIGSTOP)
        (folder,) = (tmp_path / "sessions").iterdir()
        folder.rename(folder.with_name("00000000-000000-0-0"))  # began before this program, whatever the clock says
        title = SavedSession(folder.with_name("00000000-000000-0-0"), "", 0.0, 0).restore().document.title
        store, session = SessionStore(tmp_path), EditingSession(bench.small_system())
        autosave = store.start_autosave(session)
        assert autosave.flush()
        counts = [store.windows_before(name) for name in (title, f"{title}.png", session.document.title)]
        program.kill()
    assert counts == [1, 0, 0], "one shows it, and a program doesn't count itself"
    assert store.windows_before(title) == 0
    assert autosave.close() is None
    session.close()
